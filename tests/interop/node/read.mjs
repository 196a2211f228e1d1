// Prints every message of an MCAP file as one line of JSON: topic, times, sequence, and the decoded fields.
import { open } from "node:fs/promises";
import { createWriteStream } from "node:fs";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";

const [, , recording, target] = process.argv;
const file = await open(recording);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const bytes = new Uint8Array(Number(length));
    await file.read(bytes, 0, bytes.length, Number(offset));
    return bytes;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) },
});

// JSON has no 64-bit integers and no NaN; typed arrays would become objects.
function plain(key, value) {
  if (typeof value === "bigint") return value.toString();
  if (typeof value === "number" && !Number.isFinite(value)) return String(value);
  return ArrayBuffer.isView(value) ? Array.from(value) : value;
}

const decoders = new Map();
const out = createWriteStream(target);
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  if (channel.messageEncoding !== "cdr") throw new Error(`message encoding ${channel.messageEncoding}`);
  if (!decoders.has(channel.schemaId)) {
    const schema = reader.schemasById.get(channel.schemaId);
    if (schema.encoding !== "ros2msg") throw new Error(`schema encoding ${schema.encoding}`);
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    decoders.set(channel.schemaId, new MessageReader(definitions));
  }
  const { logTime, publishTime, sequence, data } = message;
  const fields = decoders.get(channel.schemaId).readMessage(data);
  out.write(JSON.stringify({ topic: channel.topic, logTime, publishTime, sequence, fields }, plain) + "\n");
}
await new Promise((resolve, reject) => out.end((error) => (error ? reject(error) : resolve())));
await file.close();

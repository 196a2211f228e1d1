"""The peer of udp.py, in a process of its own: receives with pymavlink's mavutil, writes with mcap-python.

The socket gets the buffer that ours has; with mavutil's own of 256 datagrams it loses most of what comes in bursts.
"""

from __future__ import annotations

import signal
import socket
import sys
import threading
import time

from mcap.writer import CompressionType, Writer
from pymavlink import mavutil

from gcs.links.udp import RECEIVE_BUFFER_BYTES


def main(port: str, path: str) -> None:
    """Record until SIGINT; print the messages taken."""
    stopping = threading.Event()
    signal.signal(signal.SIGINT, lambda number, frame: stopping.set())
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")
    link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    count = 0
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start("ros2")
        channels: dict[tuple[int, int, str], int] = {}
        print("ready", flush=True)
        while not stopping.is_set():
            message = link.recv_match(blocking=True, timeout=0.5)
            if message is None:
                continue
            name = message.get_type()
            key = (message.get_srcSystem(), message.get_srcComponent(), name)
            if key not in channels:
                schema = writer.register_schema(name, "", b"")
                channels[key] = writer.register_channel("/mavlink/{}/{}/{}".format(*key), "cdr", schema)
            now = time.time_ns()
            body = b"\0\1\0\0" + bytes(message.get_payload())
            writer.add_message(channels[key], now, body, now, message.get_seq())
            count += 1
        writer.finish()
    print(count, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

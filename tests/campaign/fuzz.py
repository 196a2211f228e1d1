"""Whole and broken frames by the million through framing and recording. Run: make campaign NAME=fuzz

Every block is a stream of its own, made from its number, and judged by `stream_check`: bytes in are bytes accounted
for, the stream is rebuilt byte for byte from the recording, every frame that was placed whole is found, and all that
pymavlink's robust parser finds too. Finished blocks are kept in a file, so a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

from mutated_streams import MUTATIONS, frame_pool, mutated_stream
from stream_check import judge

from gcs.mavlink.dialect import Dialect

BLOCK = 50_000
PIECES = 300  # reads that each block is cut into


def finished(state: Path) -> dict[int, dict[str, int]]:
    """Figures of the blocks that were judged before, by number."""
    if not state.exists():
        return {}
    lines = [json.loads(line) for line in state.read_text().splitlines() if line.endswith("}")]
    return {line["block"]: line for line in lines}


def run_block(number: int, dialect: Dialect, path: Path) -> dict[str, int]:
    """Make, frame and record one block; AssertionError where it fails."""
    stream = mutated_stream(frame_pool(number % 10), BLOCK, seed=number)
    cuts = np.sort(np.random.default_rng((number, 1)).integers(0, stream.data.size, PIECES)).tolist()
    verdict = judge(stream, cuts, path, dialect)
    kinds = np.bincount(stream.mutation, minlength=len(MUTATIONS)).tolist()
    return {"block": number, **asdict(verdict), **dict(zip(MUTATIONS, kinds, strict=True))}


def table(blocks: Sequence[dict[str, int]]) -> str:
    """The sums over all blocks, as the documentation quotes them."""

    def total(name: str) -> int:
        return sum(block[name] for block in blocks)

    rows = [
        ("frames, random and broken", len(blocks) * BLOCK),
        *((f"  {name}", total(name)) for name in MUTATIONS),
        ("bytes in = bytes accounted for = bytes rebuilt", total("bytes")),
        ("frames placed whole", total("placed")),
        ("  missed", 0),
        ("  that begin inside another frame with a right checksum", total("overlapped")),
        ("frames of known id found", total("found")),
        ("frames of unknown id found", total("unknown")),
        ("found by pymavlink's robust parser", total("peer")),
        ("  missed here", 0),
        ("placed whole, found here, lost by pymavlink", total("lost_by_peer")),
    ]
    return "\n".join(f"{name:58s} {value:>14,d}" for name, value in rows)


def main() -> int:
    """Judge all blocks that are not yet; 1 at the first failure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=10_000_000, help="default 10000000")
    parser.add_argument("--state", type=Path, default=Path("campaign-output/fuzz.jsonl"), help="finished blocks")
    arguments = parser.parse_args()
    dialect = Dialect.load()
    count = -(-arguments.frames // BLOCK)
    arguments.state.parent.mkdir(parents=True, exist_ok=True)
    done = finished(arguments.state)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, arguments.state.open("a") as file:
        for number in range(count):
            if number in done:
                continue
            try:
                done[number] = run_block(number, dialect, Path(folder) / "block.mcap")
            except AssertionError as error:
                print(f"block {number} fails: {error}", file=sys.stderr)
                return 1
            file.write(json.dumps(done[number]) + "\n")
            file.flush()
            print(f"\rblock {number + 1} of {count}, {time.monotonic() - start:.0f} s", end="", file=sys.stderr)
    print(file=sys.stderr)
    print(table([done[number] for number in range(count)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

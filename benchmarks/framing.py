"""Framing and checksum of a buffer, and bytes to columns, against pymavlink. Run: python benchmarks/framing.py"""

from __future__ import annotations

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from telemetry import compare, telemetry

from gcs.mavlink.columns import message_columns
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer, scan


def main() -> None:
    """Print the ratios."""
    frames = [frame for _, frame in telemetry(60.0)]
    data = b"".join(frames)
    copies = 50
    large = np.frombuffer(data * copies, np.uint8)
    dialect = Dialect.load()

    def pymavlink_parse() -> None:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        count = sum(len(parser.parse_buffer(data[at : at + 4096]) or []) for at in range(0, len(data), 4096))
        assert count == len(frames)

    def whole_buffer() -> None:
        assert len(scan(large, dialect)) == len(frames) * copies

    def pieces() -> None:
        framer = Framer(dialect)
        count = sum(len(framer.feed(data[at : at + 4096])[1]) for at in range(0, len(data), 4096))
        assert count == len(frames)

    def columns() -> None:
        found = scan(large, dialect)
        gathered = message_columns(found, dialect)
        assert sum(len(part) for part in gathered.values()) == len(found)

    peer = "pymavlink parse_buffer, 4 KiB"
    one, many = float(len(frames)), float(len(frames) * copies)
    for name, amount, own in (
        ("scan, whole buffer", many, whole_buffer),
        ("Framer, 4 KiB", one, pieces),
        ("scan and columns", many, columns),
    ):
        compare("framing and checksum", "frames", {peer: one, name: amount}, {peer: pymavlink_parse, name: own})


if __name__ == "__main__":
    main()

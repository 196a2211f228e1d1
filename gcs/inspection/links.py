"""What a recording shows of its links: signatures, and what the telemetry radios reported."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import DialectError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import MAGIC_V2, SIGNED, Framer
from gcs.mavlink.signing import SignatureChecker, SignatureCounts, SignatureMemory
from gcs.recording.reader import RUN_NOISE, Recording

_RADIO_MESSAGES = ("RADIO_STATUS", "RADIO")
_LEVELS = ("rssi", "remrssi", "noise", "remnoise", "txbuf")
_COUNTERS = ("rxerrors", "fixed")


@dataclass
class LinkCounts:
    """One link's bytes, those in no frame, its checksum failures, and its frames by their signatures.

    bad_crc: None where the dialect that identifies them among noise is neither in the recording nor known by its name.
    """

    signatures: SignatureCounts
    bytes: int = 0
    raw_bytes: int = 0
    bad_crc: int | None = None

    def to_json(self) -> dict[str, int | None]:
        """The counts by the names that REST uses."""
        return {
            "bytes": self.bytes,
            "raw_bytes": self.raw_bytes,
            "bad_crc": self.bad_crc,
            **self.signatures.to_json(),
        }


def dialect_of(recording: Recording) -> Dialect | None:
    """The dialect that its frames were found by: of the definition that is attached, or of its name."""
    for name in recording.dialects():
        with TemporaryDirectory(prefix="gcs-") as folder, suppress(DialectError):
            for file in recording.attachments():
                if file.name == Path(file.name).name and file.name.endswith(".xml"):
                    (Path(folder) / file.name).write_bytes(file.data)
            own = Path(folder) / f"{name}.xml"
            return Dialect.load(str(own) if own.is_file() else name)
    return None


def link_counts(recording: Recording, key: bytes | None) -> dict[str, LinkCounts]:
    """What each link brought, signatures judged anew with `key`; only counted where there is none."""
    memory = SignatureMemory()
    checkers = {link: SignatureChecker(key, memory) for link in recording.links()}
    counts = {link: LinkCounts(checker.counts) for link, checker in checkers.items()}
    for _, parts in groupby(recording.wire_pieces(), lambda part: part.chunk):
        arrived: list[tuple[int, str, bytes]] = []
        for part in parts:
            noise = part.pieces[:, 3] == RUN_NOISE
            counts[part.link].bytes += part.data.size
            counts[part.link].raw_bytes += int(part.pieces[noise, 2].sum())
            frames = part.pieces[~noise]
            start = frames[:, 1]
            signed = (part.data[start] == MAGIC_V2) & (part.data[start + 2] == SIGNED)
            checkers[part.link].counts.unsigned += int(np.count_nonzero(~signed))
            for at, first, length in frames[signed, :3].tolist():
                arrived.append((at, part.link, part.data[first : first + length].tobytes()))
        # Links stand behind one another in a chunk; judged is what came first.
        for at, link, frame in sorted(arrived, key=lambda entry: entry[0]):
            checkers[link].judge(frame, at)
    _count_bad(recording, counts)
    return counts


def _count_bad(recording: Recording, counts: dict[str, LinkCounts]) -> None:
    """Count what looks like a frame but for its checksum, as the recorder did: of the links that had noise."""
    for entry in counts.values():
        entry.bad_crc = 0
    noisy = {link for link, entry in counts.items() if entry.raw_bytes}
    if not noisy:
        return
    dialect = dialect_of(recording)
    if dialect is None:
        for link in noisy:
            counts[link].bad_crc = None
        return
    framers = {link: Framer(dialect) for link in noisy}
    found = dict.fromkeys(noisy, 0)
    for part in recording.wire_pieces():
        if part.link in noisy:
            found[part.link] += framers[part.link].feed(part.data.tobytes())[1].bad_crc
    for link in noisy:
        counts[link].bad_crc = found[link] + framers[link].flush()[1].bad_crc


def radios(recording: Recording) -> list[dict[str, Any]]:
    """Each telemetry radio's reports: lowest, median and highest levels, and how far its counters went.

    Levels are the radio's own units; `rem…` is its partner's.
    """
    return [
        {
            "system": columns.system,
            "component": columns.component,
            "message": name,
            "reports": len(columns),
            **{level: _spread(columns[level]) for level in _LEVELS},
            **{counter: _growth(columns[counter]) for counter in _COUNTERS},
        }
        for name in _RADIO_MESSAGES
        for columns in recording.columns(name)
    ]


def _spread(values: NDArray[Any]) -> dict[str, float]:
    return {"min": float(values.min()), "median": float(np.median(values)), "max": float(values.max())}


def _growth(counter: NDArray[Any]) -> int:
    """How far a 16-bit counter went, wrapping and starting anew as it does."""
    steps = np.diff(counter.astype(np.int64))
    return int(np.where(steps >= 0, steps, np.where(steps < -(1 << 15), steps + (1 << 16), counter[1:])).sum())


def radio_text(radio: dict[str, Any]) -> str:
    """The same in a line."""
    levels = ", ".join(f"{level} {radio[level]['min']:.0f} to {radio[level]['max']:.0f}" for level in _LEVELS)
    return (
        f"radio {radio['system']}, {radio['component']}: {radio['reports']} reports, {levels}, "
        f"{radio['rxerrors']} packets lost, {radio['fixed']} repaired"
    )

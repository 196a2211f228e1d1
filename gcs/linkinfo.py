"""What a recording tells of its links: signatures, and what the telemetry radios reported."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.framing import MAGIC_V2, SIGNED
from gcs.recording.reader import RUN_NOISE, Recording
from gcs.signing import SignatureChecker, SignatureCounts, SignatureMemory

_RADIO_MESSAGES = ("RADIO_STATUS", "RADIO")
_LEVELS = ("rssi", "remrssi", "noise", "remnoise", "txbuf")
_COUNTERS = ("rxerrors", "fixed")


@dataclass
class LinkCounts:
    """One link's bytes in no frame, and its frames by their signatures."""

    raw_bytes: int
    signatures: SignatureCounts

    def to_json(self) -> dict[str, int]:
        """The counts by the names that REST uses."""
        return {"raw_bytes": self.raw_bytes, **self.signatures.to_json()}


def link_counts(recording: Recording, key: bytes | None) -> dict[str, LinkCounts]:
    """What each link brought, signatures judged anew with `key`; only counted where there is none."""
    memory = SignatureMemory()
    checkers = {link: SignatureChecker(key, memory) for link in recording.links()}
    counts = {link: LinkCounts(0, checker.counts) for link, checker in checkers.items()}
    for _, parts in groupby(recording.wire_pieces(), lambda part: part.chunk):
        arrived: list[tuple[int, str, bytes]] = []
        for part in parts:
            noise = part.pieces[:, 3] == RUN_NOISE
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
    return counts


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

"""What came over each link of a recording, byte by byte."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs.recording.reader import Recording


def wire_streams(recording: Recording) -> dict[str, Iterator[tuple[int, bytes]]]:
    """Per link its bytes exactly as they came, in pieces (UTC of reception in ns, bytes) of one time each."""
    return {link: _stream(recording, link) for link in recording.links()}


def _stream(recording: Recording, link: str) -> Iterator[tuple[int, bytes]]:
    for part in recording.wire_pieces():
        if part.link != link:
            continue
        data = part.data.tobytes()
        times = part.pieces[:, 0]
        starts = np.flatnonzero(np.diff(times, prepend=times[0] - 1))
        ends = np.append(part.pieces[starts[1:], 1], len(data))
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            yield int(times[start]), data[int(part.pieces[start, 1]) : end]

"""One recording as the files it consists of: begun with what is known by then, split by size, ended with the rest."""

from __future__ import annotations

import glob
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Attachment
from numpy.typing import NDArray

from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Frames
from gcs.recording.storage import StorageOptions
from gcs.recording.writer import Counts, Lost, McapWriter

#: Metadata of a recording by name; each is pairs of text.
Metadata = Mapping[str, Mapping[str, str]]
#: Name of the metadata that say, one entry each, what is to be known of a flight as a whole.
WARNINGS = "warnings"

# A crash may cost one second: the rest goes to the tick that closes the chunk, to writing it, and to a busy machine.
_CHUNK_SECONDS = 0.3
# At ordinary rates these are the ten seconds that a disk may stand still.
_WAITING_CHUNKS = 32
_PART = re.compile(r"(?P<stem>.+)\.part(?P<number>\d+)")


@dataclass(frozen=True)
class Provenance:
    """What stands in every part of a recording: metadata by name, and files."""

    metadata: Metadata = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()


def part_path(first: Path, number: int) -> Path:
    """Path of a part: `ID.mcap`, `ID.part2.mcap`, `ID.part3.mcap`."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number}.mcap")


def part_of(path: Path) -> tuple[str, int]:
    """(id, number of the part) by a file's name."""
    match = _PART.fullmatch(path.stem)
    return (match["stem"], int(match["number"])) if match else (path.stem, 1)


class RecordingParts:
    """A recording being written. `parts`: its files so far. Errors are those of `McapWriter`.

    now_ns: UTC of its beginning.
    """

    def __init__(
        self, path: Path, dialect: Dialect, options: StorageOptions, provenance: Provenance, now_ns: int
    ) -> None:
        self._dialect = dialect
        self._options = options
        self._provenance = provenance
        self._now_ns = now_ns
        self._refuse_other_parts(path)
        self.parts = [path]
        self._writer = McapWriter(
            path,
            dialect,
            chunk_seconds=_CHUNK_SECONDS,
            sync=options.sync,
            reserve_bytes=options.reserve_bytes,
            waiting=_WAITING_CHUNKS,
        )
        self._describe_part()

    def _refuse_other_parts(self, first: Path) -> None:
        for path in sorted(first.parent.glob(f"{glob.escape(first.stem)}.part*.mcap")):
            if part_of(path)[1] > 1:
                raise RecordingError(
                    f"{path} is a part of an earlier recording; choose another name, or remove it first"
                )

    def _describe_part(self, **more: str) -> None:
        """Said at the start of each file, so that a crash does not take it away."""
        part = {
            "flight": self.parts[0].stem,
            "part": str(len(self.parts)),
            "previous": self.parts[-2].name if len(self.parts) > 1 else "",
            **more,
        }
        for name, values in {"recording": {}, **self._provenance.metadata}.items():
            self._writer.metadata(name, {**part, **values} if name == "recording" else values)
        for file in self._provenance.attachments:
            self._writer.attach(file.name, file.media_type, file.data, self._now_ns)

    @property
    def path(self) -> Path:
        """The first file."""
        return self.parts[0]

    @property
    def size(self) -> int:
        """Bytes of all parts on disk."""
        return sum(path.stat().st_size for path in self.parts if path.exists())

    @property
    def counts(self) -> Counts:
        """What has been handed in, in all parts."""
        return self._writer.counts

    @property
    def lost(self) -> Lost:
        """What the disk did not take."""
        return self._writer.lost

    def write(self, link: str, buffer: NDArray[np.uint8], frames: Frames, received_ns: int | NDArray[np.int64]) -> None:
        """Append what one link received, in a new part if this one is large enough."""
        if self._options.split_bytes is not None and self._writer.size >= self._options.split_bytes:
            following = self._following
            self._writer.roll(following)
            self.parts.append(following)
            self._describe_part()
        self._writer.write(link, buffer, frames, received_ns)

    @property
    def newest_ns(self) -> int:
        """Newest time of reception so far, UTC; 0 before the first."""
        return self._writer.newest_ns

    def clock_set_back(self, now_ns: int) -> None:
        """Go on in a new part, whose times begin anew: within a file they never step back. now_ns: its beginning."""
        following = self._following
        self._now_ns = now_ns
        self._writer.roll(following, new_time=True)
        self.parts.append(following)
        self._describe_part(begun_by="clock set back")

    @property
    def _following(self) -> Path:
        return part_path(self.parts[0], len(self.parts) + 1)

    def tick(self, now_ns: int) -> None:
        """Have what waits written when it has waited long enough."""
        self._writer.tick(now_ns)

    def close(self, ending: Metadata) -> None:
        """Add what is known only at the end, and complete the file."""
        for name, values in ending.items():
            self._writer.metadata(name, values)
        self._writer.close()

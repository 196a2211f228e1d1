"""The parts of one recording, split by size, read as the one that they are."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from mcap.records import Attachment, Channel, Schema

from gcs.errors import RecordingError
from gcs.recording.container import Container, Damage, Group
from gcs.recording.parts import part_of
from gcs.recording.records import ChunkInfo


class JoinedContainer:
    """Several files with common numbers of channels, in order; as `Container`.

    A part that cannot be opened counts as damage. RecordingError if none can, or if they are not of one recording.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.path = paths[0]
        self.containers: list[Container] = []
        self._unopened: list[str] = []
        for path in paths:
            try:
                self.containers.append(Container(path))
            except RecordingError as error:
                self._unopened.append(str(error))
        if not self.containers:
            raise RecordingError(self._unopened[0])
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        for part in self.containers:
            for number, channel in part.channels.items():
                if self.channels.setdefault(number, channel) != channel:
                    raise RecordingError(f"{part.path} is not of the same recording as {self.path}; name it on its own")
            self.schemas.update(part.schemas)
        self.chunks: list[ChunkInfo] = [chunk for part in self.containers for chunk in part.chunks]
        self.metadata = [entry for part in self.containers for entry in part.metadata]

    @property
    def attachments(self) -> list[Attachment]:
        """Files inside the recording, of several with one name the last."""
        return list({file.name: file for part in self.containers for file in part.attachments}.values())

    @property
    def message_counts(self) -> dict[int, int] | None:
        """Messages per channel, None if a part has no summary."""
        total: dict[int, int] = {}
        for part in self.containers:
            if part.message_counts is None:
                return None
            for channel, count in part.message_counts.items():
                total[channel] = total.get(channel, 0) + count
        return total

    @property
    def damage(self) -> Damage:
        """What of all parts could not be used."""
        found = [part.damage for part in self.containers]
        return Damage(
            chunks=sum(one.chunks for one in found),
            bytes=sum(one.bytes for one in found),
            truncated=bool(self._unopened) or any(one.truncated for one in found),
            notes=[
                *(f"{part.path.name}: {note}" for part in self.containers for note in part.damage.notes),
                *self._unopened,
            ],
            inside=next((one.inside for one in found if one.inside), ""),
        )

    def release(self) -> None:
        """Give back the content that is kept in memory."""
        for part in self.containers:
            part.release()

    def groups(self) -> Iterator[Group]:
        """All messages, some chunks at a time, in file order."""
        for part in self.containers:
            yield from part.groups()

    def selected_groups(
        self,
        channels: Collection[int],
        start_ns: int | None = None,
        end_ns: int | None = None,
        group_bytes: int | None = None,
    ) -> Iterator[Group]:
        """As `Container.selected_groups`, part after part."""
        for part in self.containers:
            yield from part.selected_groups(channels, start_ns, end_ns, group_bytes)


def by_recording(paths: Sequence[Path]) -> list[list[Path]]:
    """The files of each recording, parts of one by their names (`ID.mcap`, `ID.part2.mcap`) together and in order."""
    recordings: dict[tuple[Path, str], dict[int, Path]] = {}
    for path in paths:
        stem, number = part_of(path)
        recordings.setdefault((path.parent, stem), {})[number] = path
    return [[parts[number] for number in sorted(parts)] for parts in recordings.values()]


def all_parts(path: Path) -> list[Path]:
    """The files of the recording whose first is `path`, in order; of a later part that alone."""
    stem, number = part_of(path)
    if number != 1 or not path.is_file():
        return [path]
    others = [(part_of(other), other) for other in path.parent.glob("*.mcap")]
    return [path, *(other for (name, part), other in sorted(others) if name == stem and part > 1)]

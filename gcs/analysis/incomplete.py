"""Messages on recordings that were cut off: beside their result, or where what is left of them does not do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gcs.errors import RecordingError
from gcs.recording.joined import by_recording
from gcs.recording.reader import Recording
from gcs.recording.repair import COMPLETED
from sysid.errors import SegmentError, SignalError, SysidError

_CURE = "wait for its end, copy the whole file again, or record the flight anew"


def cut_off(recording: Recording) -> str:
    """One clause that says where a recording without an end stops; empty for one that has had it from the start."""
    where = f"{recording.duration_s:.1f} s after its first message"
    if COMPLETED in recording.metadata():
        return f"{recording.path} was cut off {where} before it was taken in"
    if not recording.truncated:
        return ""
    return f"{recording.path} is incomplete: still being written, or cut off {where}"


@contextmanager
def with_warnings(gathered: Iterable[str]) -> Iterator[None]:
    """Errors of an analysis carry what was noticed before them as notes (`Exception.add_note`), each line once."""
    try:
        yield
    except SysidError as error:
        for line in dict.fromkeys(gathered):
            error.add_note(line)
        raise


@contextmanager
def naming_cuts(paths: Sequence[Path]) -> Iterator[None]:
    """Errors of an analysis of these recordings say which of them were cut off. Raises RecordingError for those."""
    try:
        yield
    except (SegmentError, SignalError) as error:
        cuts = [clause for parts in by_recording(paths) if (clause := cut_off(Recording(parts)))]
        if not cuts:
            raise
        if isinstance(error, SegmentError):
            # Which part to take is no question where the flight is not there.
            reason = str(error).partition(": ")[2].partition(";")[0]
            text = f"{'; '.join(cuts)}, and what is left does not do ({reason}); {_CURE}"
        else:
            text = f"{error}; {'; '.join(cuts)}; if that is why, {_CURE}"
        named = RecordingError(text)
        for line in getattr(error, "__notes__", ()):
            named.add_note(line)
        raise named from None

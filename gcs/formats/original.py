"""The log that a recording was imported from, as it was."""

from __future__ import annotations

from pathlib import Path

import zstandard

from gcs.errors import RecordingError
from gcs.recording.joined import all_parts
from gcs.recording.reader import Recording

# Endings of the log that each format of an import is exported as.
_ENDINGS = {"dataflash": ".bin", "dataflash text": ".log", "ulog": ".ulg"}


def export_original(recording: Path, target: Path) -> None:
    """Write the log that is attached, if it is of the ending of `target`. RecordingError where there is none."""
    opened = Recording(all_parts(recording))
    notes = opened.metadata().get("import", {})
    wanted = target.suffix.lower()
    if _ENDINGS.get(notes.get("format", "")) != wanted:
        raise RecordingError(
            f"{recording} holds no {wanted} log; only a recording imported from one can be exported as {wanted}"
        )
    name = f"{notes.get('source', '')}.zst"
    attached = next((entry for entry in opened.attachments() if entry.name == name), None)
    if attached is None:
        raise RecordingError(f"{recording} lacks {name}, the log that it was imported from; it is damaged there")
    try:
        target.write_bytes(zstandard.decompress(attached.data))
    except zstandard.ZstdError as error:
        raise RecordingError(f"{recording}: {name} in it is damaged ({error})") from None
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror}") from None

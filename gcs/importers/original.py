"""The log that a recording was imported from, as it was."""

from __future__ import annotations

from pathlib import Path

import zstandard

from gcs.errors import RecordingError
from gcs.recording.reader import Recording

_ENDING = ".zst"


def export_original(recording: Path, target: Path) -> None:
    """Write the attached log that has the ending of `target`. RecordingError where there is none, or no writing."""
    wanted = target.suffix.lower()
    for attachment in Recording(recording).attachments():
        if attachment.name.lower().endswith(wanted + _ENDING):
            try:
                data = zstandard.decompress(attachment.data)
                target.write_bytes(data)
            except zstandard.ZstdError as error:
                raise RecordingError(f"{recording}: {attachment.name} in it is damaged ({error})") from None
            except OSError as error:
                raise RecordingError(f"{target} cannot be written: {error.strerror}") from None
            return
    raise RecordingError(
        f"{recording} holds no {wanted} log; only a recording imported from one can be exported as {wanted}"
    )

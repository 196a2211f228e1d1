"""What a result says of how it was made."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from gcs.analysis.made import made

# FIPS 180-4, the example of one block.
ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_files_are_told_by_their_hash_and_settings_by_name(tmp_path: Path) -> None:
    file = tmp_path / "flight.mcap"
    file.write_bytes(b"abc")
    found = made({"method": "oe", "from": None, "to": 0.0}, [file, file])
    assert found["files"] == [{"name": "flight.mcap", "sha256": ABC}]
    assert found["settings"] == {"method": "oe", "to": 0.0}
    assert found["software"]["numpy"] == metadata.version("numpy")
    age = datetime.now(UTC) - datetime.fromisoformat(found["utc"])
    assert -1.0 <= age.total_seconds() < 3600.0

"""What a result says of how it was made."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from gcs.analysis.provenance import code_digest, made

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


def test_another_number_in_the_code_is_another_analysis(tmp_path: Path) -> None:
    digests = set()
    for name, limit in (("one", 2.0), ("same", 2.0), ("other", 3.0)):
        (tmp_path / name / "sysid").mkdir(parents=True)
        (tmp_path / name / "sysid" / "rules.py").write_text(f"LIMIT = {limit}\n", encoding="utf-8")
        digests.add(code_digest(tmp_path / name))
    assert len(digests) == 2
    assert made({}, [])["software"]["analysis"] == code_digest() not in digests

"""Schemathesis, which calls the interface as its description allows and as it does not, in sequences too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import httpx
from patience import PATIENCE_S
from processes import run, service

# `make campaign-api` gives it longer.
SECONDS = int(os.environ.get("FUZZ_SECONDS", "60"))
CHECKS = ",".join(
    ("not_a_server_error", "status_code_conformance", "content_type_conformance", "response_schema_conformance")
)


def test_no_call_breaks_the_service_or_gets_what_is_not_described(tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    flown = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 6, "--record", log)
    assert flown.returncode == 0, flown.stderr
    with service("--data", tmp_path / "data", "--vehicle", "iitb-mav") as url:
        upload = httpx.post(f"{url}/api/flights?name={log.name}", content=log.read_bytes(), timeout=PATIENCE_S)
        assert upload.status_code == 201
        command = [
            str(Path(sys.executable).with_name("st")),
            "run",
            f"{url}/openapi.json",
            "--checks",
            CHECKS,
            "--max-time",
            str(SECONDS),
            "--continue-on-failure",
            "--request-timeout",
            "60",
            "--exclude-path",
            "/api/live/stream",
        ]  # fmt: skip - it has no end
        longest = SECONDS + PATIENCE_S
        called = subprocess.run(command, capture_output=True, text=True, timeout=longest, cwd=tmp_path, check=False)
        print(called.stdout[called.stdout.rfind("= SUMMARY") :])
        assert called.returncode == 0, called.stdout[-5000:] + called.stderr[-2000:]
        assert httpx.get(f"{url}/api/health", timeout=PATIENCE_S).json()["status"] == "ok"

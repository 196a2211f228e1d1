"""Schemathesis, which calls the interface as its description allows and as it does not, in sequences too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from processes import run, service

# `make campaign NAME=api` gives it longer.
SECONDS = int(os.environ.get("FUZZ_SECONDS", "60"))
CHECKS = ",".join(
    ("not_a_server_error", "status_code_conformance", "content_type_conformance", "response_schema_conformance")
)


ROLES = ("viewer", "operator", "admin")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.mcap"
    flown = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 6, "--record", path)
    assert flown.returncode == 0, flown.stderr
    return path


def fuzzed(url: str, folder: Path, seconds: int, *options: str) -> subprocess.CompletedProcess[str]:
    """Schemathesis against a service, for some seconds."""
    command = [
        str(Path(sys.executable).with_name("st")),
        "run",
        f"{url}/openapi.json",
        "--checks",
        CHECKS,
        "--max-time",
        str(seconds),
        "--continue-on-failure",
        "--request-timeout",
        "60",
        "--exclude-path",
        "/api/live/stream",
        *options,
    ]  # fmt: skip - it has no end
    called = subprocess.run(
        command, capture_output=True, text=True, timeout=seconds + PATIENCE_S, cwd=folder, check=False
    )
    print(called.stdout[called.stdout.rfind("= SUMMARY") :])
    return called


def test_no_call_breaks_the_service_or_gets_what_is_not_described(tmp_path: Path, log: Path) -> None:
    with service("--data", tmp_path / "data", "--vehicle", "iitb-mav") as url:
        upload = httpx.post(f"{url}/api/flights?name={log.name}", content=log.read_bytes(), timeout=PATIENCE_S)
        assert upload.status_code == 201
        called = fuzzed(url, tmp_path, SECONDS)
        assert called.returncode == 0, called.stdout[-5000:] + called.stderr[-2000:]
        assert httpx.get(f"{url}/api/health", timeout=PATIENCE_S).json()["status"] == "ok"


def test_nor_does_a_call_by_who_may_not_make_it(tmp_path: Path, log: Path) -> None:
    """Without a token, as a viewer, as an operator and as an admin; what each of them may is another test's."""
    data = tmp_path / "data"
    tokens = {}
    for role in ROLES:
        added = run("gcs", "token", "add", role, "--role", role, "--data", data)
        assert added.returncode == 0, added.stderr
        tokens[role] = added.stdout.split()[-1]
    with service("--data", data, "--vehicle", "iitb-mav") as url:
        by = {role: {"Authorization": f"Bearer {token}"} for role, token in tokens.items()}
        upload = httpx.post(
            f"{url}/api/flights?name={log.name}", content=log.read_bytes(), timeout=PATIENCE_S, headers=by["operator"]
        )
        assert upload.status_code == 201
        # A token that was good before is so whatever wrong ones come from the same address.
        for role, headers in by.items():
            assert httpx.get(f"{url}/api/me", timeout=PATIENCE_S, headers=headers).json()["role"] == role
        for headers in ({}, *by.values()):
            options = [word for name, value in headers.items() for word in ("--header", f"{name}: {value}")]
            called = fuzzed(url, tmp_path, SECONDS // 4, *options)
            assert called.returncode == 0, (headers, called.stdout[-5000:] + called.stderr[-2000:])
        assert httpx.get(f"{url}/api/health", timeout=PATIENCE_S).json()["status"] == "ok"
        assert httpx.get(f"{url}/api/flights", timeout=PATIENCE_S, headers=by["viewer"]).status_code == 200

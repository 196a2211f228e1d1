"""The compose file: its rules by reading it, and its very commands run on this machine without Docker."""

import json
import os
import re
import socket
import subprocess
import sys
import tomllib
from ipaddress import ip_address, ip_network
from operator import add
from pathlib import Path
from typing import Any

import httpx
import pytest
from distributed import Client
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from patience import PATIENCE_S
from ruamel.yaml import YAML
from traffic import wait_until

pytestmark = pytest.mark.whole_flight

ROOT = Path(__file__).resolve().parents[2]
TOKEN = "token-of-the-compose-test"


@pytest.fixture
def compose() -> dict[str, Any]:
    return dict(YAML(typ="safe").load(ROOT / "docker-compose.yml"))


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def local(command: list[str]) -> list[str]:
    """The command with the executables of this environment."""
    return [str(Path(sys.executable).with_name(command[0])), *command[1:]]


def test_the_token_has_no_default(compose: dict[str, Any]) -> None:
    assert compose["services"]["gcs"]["environment"]["GCS_TOKEN"].startswith("${GCS_TOKEN:?")
    example = (ROOT / ".env.example").read_text()
    assert re.search(r"^GCS_TOKEN=$", example, re.MULTILINE)


def test_no_secret_is_one_that_everybody_knows(compose: dict[str, Any]) -> None:
    assert compose["services"]["store"]["environment"]["ROOT_SECRET_KEY"] == "${FLEET_SECRET:-}"
    assert compose["services"]["worker"]["environment"]["AWS_SECRET_ACCESS_KEY"] == "${FLEET_SECRET:-}"


def test_the_image_runs_as_an_ordinary_user_and_flights_survive_in_a_volume(compose: dict[str, Any]) -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    users = [line.split()[1] for line in lines if line.startswith("USER ")]
    assert users
    assert users[-1] not in ("root", "0")
    station = compose["services"]["gcs"]
    assert station["volumes"] == ["flights:/data", "loops:/cache"]
    assert {"flights", "loops"} <= set(compose["volumes"])
    command = station["command"]
    assert command[command.index("--data") + 1] == "/data"


def test_what_the_image_copies_exists_and_is_not_ignored() -> None:
    ignore = (ROOT / ".dockerignore").read_text().splitlines()
    for line in (ROOT / "Dockerfile").read_text().splitlines():
        if line.startswith("COPY "):
            for source in line.split()[1:-1]:
                assert (ROOT / source).exists(), source
                assert f"!{source}" in ignore


def test_the_vehicle_sends_to_the_port_on_which_the_station_listens(compose: dict[str, Any]) -> None:
    services = compose["services"]
    station, vehicle = services["gcs"]["command"], services["sim_vehicle"]["command"]
    port = station[station.index("--connect") + 1].rpartition(":")[2]
    assert vehicle[vehicle.index("--out") + 1] == f"udpout:gcs:{port}"
    assert f"{port}:{port}/udp" in services["gcs"]["ports"]
    assert services["sim_vehicle"]["depends_on"]["gcs"]["condition"] == "service_healthy"


def test_containers_may_do_little_and_take_a_bounded_share(compose: dict[str, Any]) -> None:
    for name, service in compose["services"].items():
        assert service["read_only"] is True, name
        assert service["tmpfs"], name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["mem_limit"], name
        assert service["pids_limit"] > 0, name
        mounted = {volume.split(":")[0] for volume in service["volumes"]}
        assert {one for one in mounted if not one.startswith("./")} <= set(compose["volumes"]), name
    assert "/api/ready" in compose["services"]["gcs"]["healthcheck"]["test"][-1]
    kept = [line for line in (ROOT / "Dockerfile").read_text().splitlines() if "chown station" in line]
    assert kept == ["    && chown station /data /cache"]  # what a volume begins with


def test_https_is_there_for_who_asks_for_it(compose: dict[str, Any]) -> None:
    proxy = compose["services"]["caddy"]
    assert proxy["profiles"] == ["tls"]
    assert proxy["cap_add"] == ["NET_BIND_SERVICE"]
    (file,) = (volume.split(":")[0] for volume in proxy["volumes"] if volume.startswith("./"))
    # The station believes the proxy alone, and reaches it, and is reached, on no other address.
    address = proxy["networks"]["front"]["ipv4_address"]
    assert compose["services"]["gcs"]["environment"]["FORWARDED_ALLOW_IPS"] == address
    assert ip_address(address) in ip_network(compose["networks"]["front"]["ipam"]["config"][0]["subnet"])
    # Every address there is given by the file: one that Docker gave might be the proxy's.
    fronted = [one["networks"]["front"]["ipv4_address"] for one in compose["services"].values()
               if "front" in (one.get("networks") or ())]  # fmt: skip
    assert len(set(fronted)) == len(fronted) == 2
    (name,) = compose["services"]["gcs"]["networks"]["front"]["aliases"]
    assert proxy["environment"]["GCS_UPSTREAM"] == f"{name}:8000"
    text = (ROOT / file).read_text()
    assert "reverse_proxy {$GCS_UPSTREAM:127.0.0.1:8000}" in text
    assert text.count("{") == text.count("}")
    profiles = {name: service.get("profiles", []) for name, service in compose["services"].items()}
    assert not profiles["gcs"]
    assert not profiles["sim_vehicle"]
    assert all(profiles[name] == ["fleet"] for name in ("scheduler", "worker", "store"))


def test_what_the_image_runs_is_locked_by_version_and_hash_and_listed_with_licences() -> None:
    lines = (ROOT / "Dockerfile").read_text()
    assert re.search(r"^FROM python:3\.11-slim@sha256:[0-9a-f]{64}$", lines, re.MULTILINE)
    assert "--require-hashes --requirement deploy/requirements.lock" in lines
    assert "--no-deps --no-build-isolation" in lines
    lock = (ROOT / "deploy/requirements.lock").read_text().replace("\\\n", " ")
    locked = {}
    for line in lock.splitlines():
        name, _, rest = line.partition("==")
        assert rest.count("--hash=sha256:") >= 1, line
        locked[name] = rest.split()[0]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = project["project"]["dependencies"] + project["project"]["optional-dependencies"]["fleet"]
    for requirement in map(Requirement, wanted + project["build-system"]["requires"]):
        assert requirement.specifier.contains(locked[canonicalize_name(requirement.name)]), requirement
    # What is tested is what the image runs.
    for line in (ROOT / "deploy" / "constraints.txt").read_text().splitlines():
        name, _, version = line.partition("==")
        assert locked.get(canonicalize_name(name), version) == version, line
    parts = json.loads((ROOT / "deploy/sbom.cdx.json").read_text())
    assert parts["bomFormat"] == "CycloneDX"
    listed = {canonicalize_name(one["name"]): one for one in parts["components"]}
    assert all(listed[name]["version"] == version for name, version in locked.items())
    assert all(listed[name].get("licenses") for name in ("numpy", "scipy", "pymavlink", "fastapi"))


def test_a_batch_runs_on_what_the_fleet_profile_starts(compose: dict[str, Any], tmp_path: Path) -> None:
    """The scheduler's and two workers' own commands, with other addresses and a folder of this machine."""
    services, port = compose["services"], free_port(socket.SOCK_STREAM)
    address = f"tcp://127.0.0.1:{port}"
    places = {"0.0.0.0": "127.0.0.1", "8786": str(port), "tcp://scheduler:8786": address, "/tmp": str(tmp_path)}
    replicas = services["worker"]["deploy"]["replicas"]
    assert replicas == 2
    commands = [services["scheduler"]["command"], *[services["worker"]["command"]] * replicas]
    started = [
        subprocess.Popen([places.get(word, word) for word in local(one)], cwd=tmp_path, stderr=subprocess.DEVNULL)
        for one in commands
    ]
    try:
        with Client(address, timeout=PATIENCE_S) as client:
            client.wait_for_workers(replicas, timeout=PATIENCE_S)
            assert client.submit(add, 2, 3).result(PATIENCE_S) == 5
        kind, *health = services["scheduler"]["healthcheck"]["test"]
        assert kind == "CMD"
        ready = [word.replace("8786", str(port)) for word in local(health)]
        assert subprocess.run(ready, capture_output=True, check=False).returncode == 0
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.wait(PATIENCE_S)


@pytest.mark.whole_flight
def test_the_commands_of_the_compose_file_record_a_flight(compose: dict[str, Any], tmp_path: Path) -> None:
    """Only addresses, ports and the folder differ from what the containers run."""
    services = compose["services"]
    web, udp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    places = {"/data": str(tmp_path), "udpin:0.0.0.0:14550": f"udpin:127.0.0.1:{udp}", "8000": str(web)}
    station_command = [places.get(word, word) for word in local(services["gcs"]["command"])]
    vehicle_command = [
        word.replace("udpout:gcs:14550", f"udpout:127.0.0.1:{udp}")
        for word in local(services["sim_vehicle"]["command"])
    ]
    environment = {**os.environ, "GCS_TOKEN": TOKEN}
    kind, *health = services["gcs"]["healthcheck"]["test"]
    assert kind == "CMD"
    health = [word.replace(":8000/", f":{web}/") for word in local(health)]
    log = (tmp_path / "station.log").open("w")
    with log, subprocess.Popen(station_command, env=environment, stdout=log, stderr=log, cwd=tmp_path) as station:
        try:
            wait_until(lambda: subprocess.run(health, capture_output=True, check=False).returncode == 0)
            url = f"http://127.0.0.1:{web}"
            assert httpx.get(f"{url}/api/flights", timeout=PATIENCE_S).status_code == 401
            with subprocess.Popen(vehicle_command, stdout=log, stderr=log, cwd=tmp_path) as vehicle:
                headers = {"Authorization": f"Bearer {TOKEN}"}
                with httpx.Client(base_url=url, headers=headers, timeout=PATIENCE_S) as client:

                    def flying() -> dict[str, Any] | None:
                        assert vehicle.poll() is None, (tmp_path / "station.log").read_text()
                        flights = client.get("/api/flights").json()["flights"]
                        return flights[0] if flights and flights[0]["messages"] > 500 else None

                    flight = wait_until(flying)
                    assert flight["system"] is not None
                    (link,) = client.get("/api/links").json()
                    assert link["dropped"] == link["bad_crc"] == 0
                vehicle.terminate()
        finally:
            station.terminate()
            station.wait(PATIENCE_S)
    assert station.returncode == 0
    assert list((tmp_path / "flights").glob("*.mcap"))

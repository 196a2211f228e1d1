"""The compose file: its rules by reading it, and its very commands run on this machine without Docker."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from patience import PATIENCE_S
from ruamel.yaml import YAML
from traffic import wait_until

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
    assert proxy["environment"]["GCS_UPSTREAM"] == "gcs:8000"
    (file,) = (volume.split(":")[0] for volume in proxy["volumes"] if volume.startswith("./"))
    text = (ROOT / file).read_text()
    assert "reverse_proxy {$GCS_UPSTREAM:127.0.0.1:8000}" in text
    assert text.count("{") == text.count("}")
    assert not any("profiles" in service for name, service in compose["services"].items() if name != "caddy")


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

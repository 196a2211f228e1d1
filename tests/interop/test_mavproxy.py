"""MAVProxy, the ground station of ArduPilot's developers, meets two simulated vehicles,

which wait for it to arm them as docs/reference/simulator.md shows."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import PATIENCE_S
from processes import free_port, run, start
from pymavlink import mavutil
from tuned_result import a_result

from sim_vehicle.model.model_file import read_model


class MAVProxy:
    """A session in MAVProxy's terminal: what was typed, and what it printed."""

    def __init__(self, port: int, home: Path) -> None:
        arguments = ["--master", f"udpin:127.0.0.1:{port}", "--no-state", "--source-system", "255"]
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-m", "MAVProxy.mavproxy", *arguments],
            cwd=home,
            env={**os.environ, "HOME": str(home)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.printed = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        while text := self.process.stdout.read(1):
            self.printed += text

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def wait_for(self, text: str, typing: str = "") -> None:
        """Wait until `text` is printed; meanwhile type a line every second."""
        deadline, typed = time.monotonic() + PATIENCE_S, time.monotonic()
        while text not in self.printed:
            if typing and time.monotonic() - typed > 1.0:
                typed = time.monotonic()
                self.type(typing)
            assert self.process.poll() is None, self.printed
            assert time.monotonic() < deadline, f"{text!r} was not printed, but:\n{self.printed}"
            time.sleep(0.05)


@contextmanager
def mavproxy(port: int, home: Path) -> Iterator[MAVProxy]:
    session = MAVProxy(port, home)
    with session.process:
        try:
            yield session
        finally:
            session.process.kill()


@pytest.fixture
def session(tmp_path: Path) -> Iterator[MAVProxy]:
    port = free_port()
    vehicles = ["fly", "--taxi", "--wait-arm", "--vehicles", 2, "--out", f"udpout:127.0.0.1:{port}"]
    with mavproxy(port, tmp_path) as opened:
        simulator = start("sim-vehicle", vehicles)
        with simulator:
            try:
                yield opened
            finally:
                simulator.kill()
                simulator.communicate(timeout=PATIENCE_S)


def test_it_lists_both_vehicles_fetches_their_parameters_and_arms(session: MAVProxy) -> None:
    session.wait_for("Detected vehicle 1:1 on link 0")
    session.wait_for("Detected vehicle 2:1 on link 0")
    session.wait_for("Received 18 parameters")
    session.type("param show SIM_WING_AREA")
    session.wait_for("SIM_WING_AREA    0.2")
    session.type("param set SR0_EXTRA1 5")
    session.wait_for("SR0_EXTRA1 = 5.0", typing="param fetch SR0_EXTRA1")
    session.type("arm throttle")
    session.wait_for("Got COMMAND_ACK: COMPONENT_ARM_DISARM: ACCEPTED")
    session.wait_for("\nARMED")
    session.type("disarm")
    session.wait_for("Got COMMAND_ACK: COMPONENT_ARM_DISARM: DENIED")
    assert session.printed.index("\nARMED") < session.printed.index("DISARM: DENIED")


class Plane(threading.Thread):
    """An autopilot that does nothing but keep parameters, by pymavlink."""

    def __init__(self, port: int, parameters: dict[str, float]) -> None:
        super().__init__(daemon=True)
        self.parameters = parameters
        self.done = threading.Event()
        self._link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1)

    def run(self) -> None:
        beaten = -1.0
        while not self.done.is_set():
            if time.monotonic() > beaten + 0.5:
                beaten = time.monotonic()
                mavlink = mavutil.mavlink
                self._link.mav.heartbeat_send(mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4)
            message = self._link.recv_match(
                type=["PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"], blocking=True, timeout=0.1
            )
            if message is None:
                continue
            if message.get_type() == "PARAM_REQUEST_LIST":
                for name in self.parameters:
                    self._send(name)
                continue
            name = message.param_id
            if message.get_type() == "PARAM_SET":
                self.parameters[name] = message.param_value
            self._send(name if name else list(self.parameters)[message.param_index])
        self._link.close()

    def _send(self, name: str) -> None:
        names = list(self.parameters)
        self._link.mav.param_value_send(name.encode(), self.parameters[name], 9, len(names), names.index(name))


def test_it_loads_the_parameters_that_a_flight_proposes(tmp_path: Path) -> None:
    result, file = tmp_path / "result.json", tmp_path / "plane.param"
    result.write_text(json.dumps(a_result(read_model("iitb-mav"))))
    done = run("gcs", "tune", result, "--for", "ardupilot", "-o", file, "--json")
    assert done.returncode == 0, done.stderr
    proposed = {one["name"]: one["value"] for one in json.loads(done.stdout)["parameters"]}
    port = free_port()
    with mavproxy(port, tmp_path) as opened:
        plane = Plane(port, dict.fromkeys(proposed, 0.125))
        plane.start()
        opened.wait_for(f"Received {len(proposed)} parameters", typing="param fetch")
        opened.type(f"param load {file}")
        opened.wait_for(f"Loaded {len(proposed)} parameters")
        plane.done.set()
        plane.join(PATIENCE_S)
    assert "Invalid line" not in opened.printed
    assert plane.parameters == {name: pytest.approx(value, rel=1e-6) for name, value in proposed.items()}

"""The simulator as a PX4's aircraft, over a real TCP socket, flown by a stand-in for PX4's SITL."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from px4_autopilot import GPS, HEARTBEAT, SENSOR, TRUTH, Px4
from sitl_autopilot import euler

from sim_vehicle.cli.main import main
from sim_vehicle.errors import SinkError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.wind import WindField
from sim_vehicle.model.model_file import read_model
from sim_vehicle.sitl.physics import AutopilotFlight
from sim_vehicle.sitl.px4_server import Px4Server
from sim_vehicle.vehicle.vehicle_file import load_vehicle

pytestmark = pytest.mark.whole_flight

VEHICLE, MODEL = load_vehicle("iitb-mav"), read_model("iitb-mav")
GRAVITY = VEHICLE.environment.gravity
Fly = Callable[..., tuple[Px4, Px4Server]]


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def connected(said: list[str]) -> Iterator[Fly]:
    """A server in a thread and an autopilot that talks to it."""
    over, threads, links = threading.Event(), [], []

    def connect(rate_hz: float = 250.0, speed: float = 0.0, **settings: bool) -> tuple[Px4, Px4Server]:
        generator = np.random.default_rng(1)
        flight = AutopilotFlight(Plant(VEHICLE, MODEL), WindField(), 0.0, generator)
        server = Px4Server(flight, ("127.0.0.1", 0), rate_hz, speed, generator, said.append)
        thread = threading.Thread(target=server.serve, args=(over.is_set,))
        thread.start()
        threads.append((thread, server))
        links.append(Px4(server.address, **settings))
        return links[-1], server

    yield connect
    over.set()
    for link in links:
        link.close()
    for thread, server in threads:
        thread.join(5.0)
        server.close()


def outputs(de: float = 0.0, da: float = 0.0, dr: float = 0.0, throttle: float = 0.0) -> dict[int, float]:
    """Actuators by output: the pulse widths of these deflections, as PX4 scales them."""
    pulses = VEHICLE.servo_pwm({"elevator": de, "aileron": da, "rudder": dr, "throttle": throttle})
    motors = VEHICLE.controls["throttle"].servos
    return {
        place: (pwm - 1000.0) / 1000.0 if place in motors else (pwm - 1500.0) / 500.0 for place, pwm in pulses.items()
    }


def test_sensors_of_an_aircraft_that_stands(connected: Fly) -> None:
    link, _ = connected()
    heard = [link.sensors()]
    for _ in range(250):
        heard.append(link.exchange({}, armed=False))
    steps = np.diff([one["time_us"] for one in heard])
    # The first ones were sent while nobody had answered yet.
    assert set(steps[-200:]) == {4000}
    assert heard[-1]["updated"] == 0x1FFF
    force = np.array([one["force"] for one in heard])
    assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(GRAVITY, rel=0.01)
    assert force[:, 2].mean() < -0.95 * GRAVITY
    assert np.abs(np.array([one["rates"] for one in heard]).mean(axis=0)).max() < 1e-3
    # No reading repeats: PX4 takes a sensor whose readings repeat for dead.
    assert np.mean(np.diff([one["pressure"] for one in heard]) == 0.0) < 0.02
    assert np.mean([one["pressure"] for one in heard]) == pytest.approx(1013.25, abs=0.05)
    assert np.linalg.norm(np.mean([one["field"] for one in heard], axis=0)) == pytest.approx(0.437, abs=0.01)
    seconds = (heard[-1]["time_us"] - heard[0]["time_us"]) / 1e6
    assert link.count[GPS] == pytest.approx(10.0 * seconds, abs=2)
    assert link.count[TRUTH] == pytest.approx(50.0 * seconds, abs=2)
    assert link.count[HEARTBEAT] >= 1
    where = link.newest[GPS]
    assert (where["fix"], where["seen"]) == (3, 12)
    assert abs(where["alt"]) < 0.1


def test_time_goes_on_until_the_first_answer_and_then_waits_for_each(connected: Fly) -> None:
    link, server = connected()
    for _ in range(20):
        link.sensors()
    link.exchange({})
    while not link.is_silent(0.3):  # what was on its way
        link.sensors()
    steps = server.counts.steps
    assert link.is_silent(0.5)
    assert server.counts.steps == steps
    before = link.newest[SENSOR]["time_us"]
    assert link.exchange({})["time_us"] == before + 4000
    assert link.is_silent(0.3)


def test_it_takes_off_and_climbs_and_stands_while_disarmed(connected: Fly) -> None:
    link, _ = connected()
    link.sensors()
    for _ in range(100):
        link.exchange(outputs(throttle=1.0), armed=False)
    assert link.newest[TRUTH]["airspeed"] < 0.1
    values = MODEL.values()
    highest = 0.0
    for _ in range(250 * 14):
        truth, rates = link.newest[TRUTH], link.newest[SENSOR]["rates"]
        phi, theta, _ = euler(truth["quaternion"])
        speed = truth["airspeed"]
        pitch = 0.2 if speed > 9.0 else 0.0
        wanted = (
            np.sign(values["Cm_de"]) * (0.8 * (pitch - theta) - 0.2 * rates[1]),
            np.sign(values["Cl_da"]) * (-0.6 * phi - 0.15 * rates[0]),
            np.sign(values["Cn_dr"]) * (-0.1 * rates[2]),
        )
        link.exchange(outputs(*(float(np.clip(one, -0.3, 0.3)) for one in wanted), throttle=0.9))
        highest = max(highest, link.newest[TRUTH]["alt"])
    assert highest > 5.0
    sensors, where = link.newest[SENSOR], link.newest[GPS]
    # Barometer, pitot tube and GPS say of the same motion what the truth does.
    truth = link.newest[TRUTH]
    assert sensors["altitude"] == pytest.approx(truth["alt"], abs=3.0)
    assert np.sqrt(2.0 * sensors["pitot"] * 100.0 / 1.22) == pytest.approx(truth["airspeed"], rel=0.05)
    np.testing.assert_allclose(where["velocity"], truth["velocity"], atol=1.0)
    assert (where["lat"] - 19.1334) * 111_000.0 > 20.0


def test_who_connects_again_stands_on_the_ground_again(connected: Fly, said: list[str]) -> None:
    link, server = connected()
    link.sensors()
    for _ in range(200):
        link.exchange(outputs(throttle=1.0))
    assert link.newest[TRUTH]["airspeed"] > 0.5
    link.close()
    again = Px4(server.address)
    first = again.sensors()
    assert first["time_us"] == 1_000_000
    assert again.newest[TRUTH]["airspeed"] == 0.0
    again.close()
    deadline = time.monotonic() + 5.0
    while server.counts.connections < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert server.counts.connections == 2
    assert any("waiting for it to connect again" in line for line in said)


def test_garbage_between_frames_is_passed_over(connected: Fly) -> None:
    link, server = connected()
    link.sensors()
    link.exchange({})
    for _ in range(3):
        link.send(b"no frame \xfd\x00\xff of anybody" * 3)
        link.exchange({})
    assert server.counts.strange > 0
    for _ in range(20):
        link.exchange({})


def test_an_answer_to_older_sensors_is_none_of_these(connected: Fly) -> None:
    link, server = connected()
    link.sensors()
    for _ in range(30):
        link.exchange({})
    while not link.is_silent(0.2):
        link.sensors()
    before = link.newest[SENSOR]["time_us"]
    link.newest[SENSOR]["time_us"] = before - 4000
    link.answer({})
    assert link.is_silent(0.3)
    link.newest[SENSOR]["time_us"] = before
    assert link.exchange({})["time_us"] == before + 4000
    assert server.counts.missing == 0


def test_one_without_lockstep_is_told(connected: Fly, said: list[str]) -> None:
    link, _ = connected(lockstep=False)
    link.sensors()
    for _ in range(5):
        link.exchange({})
    assert any("built without lockstep" in line for line in said)


def test_a_port_in_use_and_wrong_rates_are_one_line(connected: Fly, capsys: pytest.CaptureFixture[str]) -> None:
    _, server = connected()
    host, port = server.address
    flight = AutopilotFlight(Plant(VEHICLE, MODEL), WindField(), 0.0, np.random.default_rng(1))
    with pytest.raises(SinkError, match=rf"TCP {host}:{port}: Address already in use; give another port with --listen"):
        Px4Server(flight, (host, port), 250.0, 1.0, np.random.default_rng(1), lambda text: None)
    assert main(["sitl", "--autopilot", "px4", "--rate", "5000"]) == 2
    assert "--rate is between 20 and 1000 Hz" in capsys.readouterr().err
    assert main(["sitl", "--speed", "2"]) == 2
    assert "--rate and --speed are of --autopilot px4" in capsys.readouterr().err


def test_the_command_serves_and_ends_with_ctrl_c() -> None:
    command = [sys.executable, "-m", "sim_vehicle", "sitl", "--autopilot", "px4", "--listen", "127.0.0.1:0"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        assert "serving on TCP 127.0.0.1:" in line
        port = int(line.partition("127.0.0.1:")[2].partition(":")[0])
        link = Px4(("127.0.0.1", port))
        link.sensors()
        for _ in range(20):
            link.exchange({})
        link.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
        assert "1 connections" in process.stderr.read()
    finally:
        process.kill()
        process.stderr.close()

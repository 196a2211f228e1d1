"""The simulator as an autopilot's aircraft, over a real UDP socket, flown by a stand-in for ArduPilot's SITL."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sitl_autopilot import Sitl, euler

from sim_vehicle.cli.main import main
from sim_vehicle.errors import SimVehicleError, SinkError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.wind import WindField
from sim_vehicle.model.model_file import read_model
from sim_vehicle.sitl.physics import AutopilotFlight
from sim_vehicle.sitl.server import SitlServer
from sim_vehicle.vehicle.vehicle_file import load_vehicle

pytestmark = pytest.mark.whole_flight

VEHICLE, MODEL = load_vehicle("iitb-mav"), read_model("iitb-mav")
GRAVITY = VEHICLE.environment.gravity
Fly = Callable[..., tuple[Sitl, SitlServer]]


def flight_of(wind: WindField | None = None, heading: float = 0.0) -> AutopilotFlight:
    plant = Plant(VEHICLE, MODEL)
    return AutopilotFlight(plant, wind or WindField(), heading, np.random.default_rng(1))


@pytest.fixture
def connected() -> Iterator[Fly]:
    """A server in a thread and an autopilot that talks to it."""
    over, threads, links = threading.Event(), [], []

    def connect(wind: WindField | None = None, heading: float = 0.0, **settings: int) -> tuple[Sitl, SitlServer]:
        server = SitlServer(flight_of(wind, heading), "127.0.0.1", 0, lambda text: None)
        thread = threading.Thread(target=server.serve, args=(over.is_set,))
        thread.start()
        threads.append((thread, server))
        links.append(Sitl(server.address, **settings))
        return links[-1], server

    yield connect
    over.set()
    for thread, server in threads:
        thread.join(5.0)
        server.close()
    for link in links:
        link.close()


def pulses(de: float = 0.0, da: float = 0.0, dr: float = 0.0, throttle: float = 0.0) -> dict[int, float]:
    return VEHICLE.servo_pwm({"elevator": de, "aileron": da, "rudder": dr, "throttle": throttle})


def held(heard: dict[str, np.ndarray], pitch: float, throttle: float) -> dict[int, float]:
    """What an autopilot does that holds wings level and a pitch angle. Signs are those of this vehicle's model."""
    phi, theta, _ = euler(heard["quaternion"])
    p, q, r = heard["gyro"]
    values = MODEL.values()
    de = np.sign(values["Cm_de"]) * (0.8 * (pitch - theta) - 0.2 * q)
    da = np.sign(values["Cl_da"]) * (-0.6 * phi - 0.15 * p)
    dr = np.sign(values["Cn_dr"]) * (-0.1 * r)
    limited = [float(np.clip(one, -0.3, 0.3)) for one in (de, da, dr)]
    return pulses(*limited, throttle)


def test_it_stands_until_the_throttle_is_opened(connected: Fly) -> None:
    link, _ = connected(heading=0.7)
    for number in range(1, 401):
        # SITL sends no pulses at first, then the throttle closed.
        heard = link.exchange({} if number < 100 else pulses())
        assert heard["timestamp"][0] == pytest.approx(number / 400.0)
    np.testing.assert_allclose(heard["position"], 0.0, atol=1e-9)
    np.testing.assert_allclose(heard["velocity"], 0.0, atol=1e-9)
    np.testing.assert_allclose(heard["gyro"], 0.0, atol=1e-9)
    phi, theta, psi = euler(heard["quaternion"])
    assert (phi, psi) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.7))
    np.testing.assert_allclose(heard["accel_body"], [GRAVITY * np.sin(theta), 0.0, -GRAVITY * np.cos(theta)], atol=1e-6)


def test_it_takes_off_climbs_and_lands(connected: Fly) -> None:
    link, _ = connected(heading=0.5)
    heard = link.exchange(pulses())
    before, at = heard, 0.0
    while -heard["position"][2] < 15.0:
        before, heard = heard, link.exchange(held(heard, 0.25, 1.0))
        at = heard["timestamp"][0]
        assert at < 60.0
        if -heard["position"][2] == 0.0:
            # On wheels it goes where it points.
            course = np.arctan2(heard["velocity"][1], heard["velocity"][0])
            assert np.hypot(*heard["velocity"][:2]) < 1.0 or course == pytest.approx(0.5, abs=0.05)
        # What the accelerometer feels is the change of velocity, less gravity, in body axes.
        change = (heard["velocity"] - before["velocity"]) * 400.0 - [0.0, 0.0, GRAVITY]
        if at > 0.1 and (heard["position"][2] == 0.0) == (before["position"][2] == 0.0):
            w, *vector = heard["quaternion"]
            felt = Rotation.from_quat([*vector, w]).inv().apply(change)
            np.testing.assert_allclose(heard["accel_body"], felt, atol=0.6)
    assert np.hypot(*heard["velocity"][:2]) > 8.0
    while heard["position"][2] < 0.0:
        heard = link.exchange(held(heard, 0.02, 0.0))
        assert heard["timestamp"][0] < 200.0
    landed = heard["timestamp"][0]
    while np.any(np.abs(heard["velocity"]) > 1e-9):
        heard = link.exchange(pulses())
        assert heard["timestamp"][0] < landed + 60.0
    for _ in range(400):
        heard = link.exchange(pulses())
    assert heard["position"][2] == 0.0
    np.testing.assert_allclose(heard["velocity"], 0.0, atol=1e-9)


def test_in_the_air_it_is_the_simulator() -> None:
    """The same commands, step by step, give the plant's own states to the last digit."""
    flight, plant = flight_of(), Plant(VEHICLE, MODEL)
    trim = plant.trim(15.0, 200.0)
    flight._state = trim.state.copy()
    flight.motion = replace(flight.motion, on_ground=False)
    state, pwm = trim.state.copy(), [0] * 16
    for number in range(400):
        shake = 0.05 * np.sin(0.05 * number)
        for output, pulse in pulses(trim.command[0] + shake, 0.02, -0.02, trim.command[3]).items():
            pwm[output - 1] = round(pulse)
        motion = flight.step(tuple(pwm), 0.0025)
        plant.step(state, flight.command(tuple(pwm)), 0.0025)
        np.testing.assert_array_equal(motion.position, state.x[:3])
        np.testing.assert_array_equal(motion.rates, state.x[10:13])
    assert not motion.on_ground


def test_frames_that_come_again_are_lost_or_foreign(connected: Fly) -> None:
    link, server = connected()
    first = link.exchange(pulses(throttle=1.0))
    again = link.exchange(pulses(throttle=1.0), again=True)
    assert again["timestamp"] == first["timestamp"]
    link.number += 3
    link.exchange(pulses(throttle=1.0))
    for data in (b"", b"\x00" * 40, link.frame({})[:-1], b"hello" * 200):
        link.send(data)
    for _ in range(200):
        heard = link.exchange(pulses(throttle=1.0))
    assert heard["velocity"][0] > 1.0
    assert (server.counts.again, server.counts.lost, server.counts.strange) == (1, 3, 4)
    link.number = 0
    heard = link.exchange(pulses())
    assert (heard["timestamp"][0], server.counts.restarts) == (pytest.approx(1.0 / 400.0), 1)
    np.testing.assert_allclose(heard["velocity"], 0.0, atol=1e-9)


@pytest.mark.parametrize(("rate", "outputs"), [(50, 16), (1200, 32)])
def test_it_steps_as_fast_as_it_is_asked_to(connected: Fly, rate: int, outputs: int) -> None:
    link, _ = connected(rate_hz=rate, outputs=outputs)
    for _ in range(rate):
        heard = link.exchange(pulses(throttle=1.0))
    assert heard["timestamp"][0] == pytest.approx(1.0, abs=1e-6)
    # A second of full thrust, on wheels that rub a little: the mass says how fast that is.
    thrust = VEHICLE.propulsion.max_thrust if VEHICLE.propulsion and VEHICLE.propulsion.max_thrust else 0.0
    assert 0.6 < heard["velocity"][0] / (thrust / VEHICLE.mass.mass) < 1.0


def test_wind_is_told_and_felt(connected: Fly) -> None:
    link, _ = connected(wind=WindField(steady=(-4.0, 1.0, 0.0), sigma=0.5))
    heard = link.exchange(pulses())
    np.testing.assert_allclose(heard["velocity_wind"], [-4.0, 1.0, 0.0])
    for _ in range(400 * 40):
        heard = link.exchange(held(heard, 0.2, 1.0))
        if -heard["position"][2] > 20.0:
            break
    ground, air = heard["velocity"], heard["velocity"] - heard["velocity_wind"]
    assert np.linalg.norm(air) > np.linalg.norm(ground) + 2.0


def test_what_cannot_be_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    server = SitlServer(flight_of(), "127.0.0.1", 0, lambda text: None)
    with pytest.raises(SinkError, match="give another port with --listen"):
        SitlServer(flight_of(), "127.0.0.1", server.address[1], lambda text: None)
    server.close()
    bare = replace(VEHICLE, controls={name: replace(one, servos=()) for name, one in VEHICLE.controls.items()})
    with pytest.raises(SimVehicleError, match="elevator and throttle without a servo"):
        AutopilotFlight(Plant(bare, MODEL), WindField(), 0.0, np.random.default_rng(0))
    assert main(["sitl", "--listen", "9002"]) == 2
    assert capsys.readouterr().err == "sim-vehicle: --listen 9002: give HOST:PORT, as 127.0.0.1:9002\n"
    for wrong in (["--seed", "-1"], ["--set", "sensors.accel_bias_x=1"]):
        assert main(["sitl", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_the_command_flies_and_ends_with_ctrl_c() -> None:
    command = [
        sys.executable,
        "-m",
        "sim_vehicle",
        "sitl",
        "--listen",
        "127.0.0.1:0",
        "--effect",
        "stall:alpha_stall=0.2",
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as program:
        assert program.stderr is not None
        said = program.stderr.readline()
        port = int(said.split("127.0.0.1:")[1].split(":")[0])
        assert "--model JSON:127.0.0.1" in program.stderr.readline()
        link = Sitl(("127.0.0.1", port))
        for _ in range(50):
            heard = link.exchange(pulses(throttle=1.0))
        assert heard["velocity"][0] > 0.1
        link.close()
        program.send_signal(2)
        assert program.wait(20.0) == 0
        assert "50 steps" in program.stderr.read()

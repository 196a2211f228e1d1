"""The yardstick itself: flights as the field has them are true at the textbook's knobs, and each knob does its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_air import Air, air_motion
from field_filters import first_order, low_pass, low_pass_gain, vane
from field_inputs import inputs_of
from field_plant import STEP, Log, Servo, ServoMotion, fly_field
from field_sensors import Field, sense
from field_truth import projection
from jsbsim_flight import linear_aircraft

AIRCRAFT = linear_aircraft()
TIMES = np.arange(2501) * STEP


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    inputs = inputs_of("3211", 12.0, np.random.default_rng(1))
    air = Air(gust=0.6, rolling=1.0)
    return fly_field(tmp_path_factory.mktemp("jsbsim"), AIRCRAFT, inputs, 1, servo=Servo(0.03, 0.03, 0.002), air=air)


def test_the_aerodynamics_are_the_model_in_moving_air_too(log: Log) -> None:
    found = projection(log, AIRCRAFT.vehicle.geometry)
    for name, value in AIRCRAFT.model.values().items():
        assert found[name] == pytest.approx(value, abs=1e-6, rel=1e-4), name


def test_forces_and_moments_are_the_motion_s_own(log: Log) -> None:
    m, arm = AIRCRAFT.vehicle.mass, AIRCRAFT.vehicle.propulsion
    assert arm is not None
    p, q, r = log["p"], log["q"], log["r"]
    roll = m.Ixx * log["pdot"] - m.Ixz * (log["rdot"] + p * q) + (m.Izz - m.Iyy) * q * r
    pitch = m.Iyy * log["qdot"] + (m.Ixx - m.Izz) * p * r + m.Ixz * (p**2 - r**2) - arm.line[2] * log["thrust"]
    np.testing.assert_allclose(roll, log["l_aero_moment"], atol=1e-4)
    np.testing.assert_allclose(pitch, log["m_aero_moment"], atol=1e-4)
    # The logged rates are what the logged accelerations add up to: motion, forces and surfaces are of one instant.
    np.testing.assert_allclose(np.diff(q), STEP * 0.5 * (log["qdot"][1:] + log["qdot"][:-1]), atol=5e-4)


def test_textbook_sensors_read_the_truth(log: Log) -> None:
    signals = sense(log, AIRCRAFT.vehicle, Field(), 1, "textbook").signals
    own = {name: name for name in ("p", "q", "r", "phi", "theta", "psi", "thrust", "air_density")}
    for key, name in {**own, "de": "sent_de", "da": "sent_da", "dr": "sent_dr", "throttle": "sent_throttle"}.items():
        np.testing.assert_allclose(signals[key].values, log[name][::5], atol=1e-12)
    at = AIRCRAFT.vehicle.sensors.alpha_vane.position
    flow = log["alpha"] - at[0] * log["q"] / log["V"] + at[1] * log["p"] / log["V"]
    np.testing.assert_allclose(signals["alpha"].values, flow[::5], atol=1e-12)
    np.testing.assert_allclose(signals["alpha"].time_s, log.time_s[::5], atol=1e-9)


KNOBS: dict[str, tuple[dict[str, object], set[str]]] = {
    "imu": ({"filter_hz": 20.0, "vibration": 1.0, "force_bias": 0.1}, {"ax", "ay", "az", "p", "q", "r"}),
    "gyro": ({"rate_noise": 0.01, "rate_drift": 0.01, "g_sensitivity": 1e-3}, {"p", "q", "r"}),
    "vane": ({"vane_scale": 0.1, "vane_hz_natural": 8.0, "vane_friction": 0.002}, {"alpha", "beta"}),
    "vane clock": ({"vane_offset": 0.02}, {"alpha", "beta"}),
    "airspeed": ({"position_error": 0.1, "pneumatic_lag": 0.1, "airspeed_coloured": 0.1}, {"airspeed"}),
    "attitude": ({"attitude_error": 0.01, "attitude_lag": 0.02}, {"phi", "theta", "psi"}),
    "gps": ({"gps_delay": 0.2}, {"vn", "ve", "vd"}),
    "thrust": ({"thrust_scale": 0.1}, {"thrust"}),
    "dead": ({"dead": ("beta",)}, {"beta"}),
    "position": ({"positions": True}, {"de", "da", "dr"}),
}


@pytest.mark.parametrize("knob", KNOBS)
def test_a_knob_changes_its_own_signals_alone(log: Log, knob: str) -> None:
    change, own = KNOBS[knob]
    before, after = (sense(log, AIRCRAFT.vehicle, f, 1, "") for f in (Field(), replace(Field(), **change)))  # type: ignore[arg-type]
    changed = {
        name
        for name, was in before.signals.items()
        if not (np.array_equal(was.values, after.signals[name].values))
        or not np.array_equal(was.time_s, after.signals[name].time_s)
    }
    assert changed == own


def test_offsets_and_rates_are_what_they_say(log: Log) -> None:
    field = Field(vane_offset=0.02, imu_hz=25.0, gps_delay=0.2)
    signals = sense(log, AIRCRAFT.vehicle, field, 1, "").signals
    np.testing.assert_allclose(signals["alpha"].time_s, log.time_s[::5] + 0.02, atol=1e-9)
    np.testing.assert_allclose(signals["p"].values, log["p"][::10], atol=1e-12)
    np.testing.assert_allclose(signals["vn"].time_s[0], 0.2)
    np.testing.assert_allclose(signals["vn"].values, log["vn"][::50], atol=1e-9)


def test_a_burst_takes_every_message_for_a_while(log: Log) -> None:
    signals = sense(log, AIRCRAFT.vehicle, Field(bursts=20.0), 1, "").signals
    gaps = [np.diff(signals[name].time_s).max() for name in ("p", "alpha", "de", "phi", "airspeed")]
    assert min(gaps) > 0.2
    assert np.ptp(gaps) < 1e-9


def test_filters_have_their_closed_forms() -> None:
    w = 2.0 * np.pi * 3.0
    wave, late = np.sin(w * TIMES), slice(1500, None)
    lag = 0.05
    gain, phase = 1.0 / np.hypot(1.0, w * lag), -np.arctan(w * lag)
    np.testing.assert_allclose(first_order(wave, lag)[late], gain * np.sin(w * TIMES + phase)[late], atol=1e-3)
    assert np.abs(low_pass(wave, 3.0)[late]).max() == pytest.approx(low_pass_gain(3.0, 3.0), abs=2e-3)
    natural, damping = 2.0 * np.pi * 8.0, 0.3
    s = 1j * w
    ideal = natural**2 / (s**2 + 2.0 * damping * natural * s + natural**2)
    read = vane(wave, np.full(TIMES.size, natural), damping)
    np.testing.assert_allclose(read[late], np.imag(ideal * np.exp(s * TIMES))[late], atol=0.01)


@pytest.mark.parametrize("servo", [Servo(), Servo(delay=0.04), Servo(lag=0.04), Servo(delay=0.02, lag=0.03)])
def test_a_servo_follows_a_ramp_by_its_delay_and_lag(servo: Servo) -> None:
    motion = ServoMotion(servo, 0.0)
    out = np.array([motion.move(float(0.1 * t)) for t in TIMES[1:]])
    # A ramp's command stands at the end of the step over which it acts: half a step early where the servo is a lag.
    held = -STEP * 0.5 if servo.lag else 0.0
    assert TIMES[-1] - out[-1] / 0.1 == pytest.approx(servo.delay + servo.lag + held, abs=1e-5)


def test_play_is_what_is_left_behind() -> None:
    motion = ServoMotion(Servo(backlash=0.002), 0.0)
    out = np.array([motion.move(float(0.01 * np.sin(t))) for t in TIMES])
    assert out.max() == pytest.approx(0.008, abs=1e-5)


def test_gusts_have_their_size_and_start_from_nothing() -> None:
    motion = air_motion(Air(gust=0.8, length=50.0, rolling=1.0), 150_001, STEP, 17.0, 1.27, 3)
    np.testing.assert_allclose(motion.body.std(axis=0), 0.8, rtol=0.15)
    assert np.all(motion.body[0] == 0.0)
    assert 0.05 < motion.rolling.std() < 0.5
    still = air_motion(Air(), 1001, STEP, 17.0, 1.27, 3)
    assert not still.body.any()
    assert not still.rolling.any()


def test_a_flight_is_determined_by_its_family_and_seed(tmp_path: Path) -> None:
    from field_flight import field_flight

    one, two = (field_flight("short", 3, tmp_path / name) for name in "ab")
    for name, values in one.signals.signals.items():
        np.testing.assert_array_equal(values.values, two.signals.signals[name].values)
    assert all(low <= high for low, high in one.truth.values())

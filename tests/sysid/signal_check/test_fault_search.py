"""Injected mistakes are found and named; a clean flight has none. The truth is what was injected."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from signal_mistakes import GROUPS, Injection, times
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, OutputFit, Refusal, SensorError
from sysid.errors import SignalError
from sysid.numerics.autoregression import apply_whitening_filter, autoregression
from sysid.numerics.fractional_delay import held_back, read_later
from sysid.signal_check.check import SignalCheck, check_signals, in_time
from sysid.signal_check.fault import Mistake
from sysid.signal_check.kinematic_residuals import integrate
from sysid.signal_check.sensor_assessment import verdicts
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.sensor_layout import SensorLayout

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
STICK = load_vehicle("ultrastick25e")


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 21)[0]


def checked(flight: FlightSignals) -> SignalCheck:
    return check_signals([prepare(flight, VEHICLE)], VEHICLE)


@pytest.mark.parametrize("effects", [(), ("turbulence:sigma=1.0,length=30", "steady_wind:north=3,east=-2,down=0")])
def test_a_clean_flight_has_no_mistakes(effects: tuple[str, ...]) -> None:
    assert checked(fly_mav("multisine", 22, effects=effects)[0]).findings() == []


def scaled(names: tuple[str, ...], factor: float) -> Injection:
    return Injection(names, "unit", f"{factor:.3g}", times(names, factor))


def exchanged(one: str, other: str) -> Injection:
    return Injection((one, other), "axis", "", lambda s: {one: s[other].values, other: s[one].values})


@pytest.mark.parametrize(
    ("injection", "sentence"),
    [
        (scaled(("theta",), 180 / np.pi), "theta looks like degrees: scale it by 0.01745"),
        (scaled(GROUPS["gyros"], 1e3), "p, q and r look like mrad/s"),
        (scaled(GROUPS["accelerometers"], 1e3 / 9.80665), "look like milli-g"),
        (scaled(("airspeed",), 3.6), "airspeed looks like km/h"),
        (scaled(("beta",), -1.0), "beta has the wrong sign"),
        (exchanged("ax", "ay"), "ax, ay, az are on the wrong axes: read ay, ax, az"),
        (scaled(("p",), 1.3), "p reads 1.3 of true: scale it by 0.7"),
        (scaled(("thrust",), 1e3 / 9.80665), "looks like gram-force"),
        (scaled(("air_density",), 0.01), "which no air has"),
    ],
    ids=lambda value: value.name if isinstance(value, Injection) else "",
)
def test_wrong_units_signs_axes_and_scales_stop_the_job_with_the_cure(
    flight: FlightSignals, injection: Injection, sentence: str
) -> None:
    with pytest.raises(SignalError) as stopped:
        checked(injection.apply(flight))
    assert sentence in str(stopped.value)
    assert "\n" not in str(stopped.value)


def test_a_vane_that_moves_by_little_more_than_its_noise_can_have_the_wrong_sign(straight: FlightSignals) -> None:
    """The Ultra Stick's angle of attack: its sign was told as 261 ms of delay."""
    wrong = Injection(("alpha",), "sign", "-1", times(("alpha",), -1.0)).apply(straight)
    with pytest.raises(SignalError, match="alpha has the wrong sign"):
        check_signals([prepare(wrong, STICK)], STICK)


@pytest.fixture(scope="module")
def straight() -> FlightSignals:
    """A flight of the Ultra Stick straight north: vn moves by hardly more than its noise."""
    return fly_mav("multisine", 500, vehicle=STICK, model=read_model("ultrastick25e"))[0]


def turned_east(flight: FlightSignals) -> FlightSignals:
    """The same flight east: the heading a right angle more."""
    signals = dict(flight.signals)
    signals["psi"] = replace(signals["psi"], values=signals["psi"].values + np.pi / 2.0)
    signals["vn"] = replace(flight.signals["vn"], values=-flight.signals["ve"].values)
    signals["ve"] = replace(flight.signals["ve"], values=flight.signals["vn"].values)
    return replace(flight, signals=signals)


@pytest.mark.parametrize(
    ("name", "east", "factor", "sentence"),
    [
        ("vn", False, 100.0, "vn would be a wind of 16.. m/s and looks like cm/s: scale it by 0.01 in"),
        ("ve", True, 100.0, "ve would be a wind of 16.. m/s and looks like cm/s: scale it by 0.01 in"),
        ("vn", False, 3.6, "vn would be a wind of 4. m/s and looks like km/h: scale it by 0.2778 in"),
        # Fast motions tell these two.
        ("ve", False, 100.0, "ve (looks like cm/s|reads (9|10)[0-9.]* of true): scale it by 0.0"),
        ("vd", False, 100.0, "vd (looks like cm/s|reads (9|10)[0-9.]* of true): scale it by 0.0"),
    ],
)
def test_one_velocity_over_ground_in_a_wrong_unit_is_named(
    straight: FlightSignals, name: str, east: bool, factor: float, sentence: str
) -> None:
    wrong = scaled((name,), factor).apply(turned_east(straight) if east else straight)
    with pytest.raises(SignalError, match=sentence) as stopped:
        check_signals([prepare(wrong, STICK)], STICK)
    assert "\n" not in str(stopped.value)
    assert set(re.findall(r"\bv[ned]\b", str(stopped.value))) == {name}


def test_a_gale_is_no_mistake_and_a_velocity_that_no_unit_explains_is_named(straight: FlightSignals) -> None:
    gale = Injection(("vn",), "bias", "25", lambda s: {"vn": s["vn"].values - 25.0}).apply(straight)
    assert check_signals([prepare(gale, STICK)], STICK).findings() == []
    fast = scaled(("airspeed",), 5.0).apply(straight)
    with pytest.raises(SignalError) as stopped:
        check_signals([prepare(fast, STICK)], STICK)
    assert re.findall(r"\bv[ned]\b", str(stopped.value)) == []
    far = Injection(("vn",), "bias", "1e5", lambda s: {"vn": s["vn"].values + 1e5}).apply(straight)
    with pytest.raises(
        SignalError, match="vn would be a wind of 100000 m/s which this aircraft would not fly in: give its unit"
    ):
        check_signals([prepare(far, STICK)], STICK)


def test_a_roll_rate_that_is_quick_to_follow_is_not_late() -> None:
    """Of this flight p seemed 1.1 ± 0.1 ms late."""
    flight = fly_mav("multisine", 203, effects=("steady_wind:north=1,east=1,down=0",))[0]
    assert check_signals([prepare(flight, VEHICLE)], VEHICLE).findings() == []


def test_a_small_scale_error_of_a_gyro_is_named_and_the_flight_used(flight: FlightSignals) -> None:
    (found,) = checked(Injection(("r",), "scale", "", times(("r",), 1.1)).apply(flight)).findings()
    assert (found.signal, found.kind, found.usable) == ("r", "scale", True)
    assert found.found == pytest.approx(1.0 / 1.1, abs=4.0 * found.std)


@pytest.mark.parametrize(("group", "delay"), [("vanes", 0.02), ("imu", 0.013), ("air_data", 0.12), ("gps", 0.08)])
def test_a_late_group_is_found_with_its_delay_and_put_right(flight: FlightSignals, group: str, delay: float) -> None:
    late = Injection(GROUPS[group], "delay", "", None, delay).apply(flight)
    check = checked(late)
    (found,) = check.delays
    assert set(found.signals) <= set(GROUPS[group])
    assert found.value == pytest.approx(delay, abs=max(4.0 * found.std, 1e-3))
    assert checked_again(late, check) == []


def checked_again(flight: FlightSignals, check: SignalCheck) -> list[object]:
    prepared = in_time([prepare(flight, VEHICLE)], VEHICLE, check)
    return list(check_signals(prepared, VEHICLE).findings())


def test_late_vanes_of_one_flight_are_late_where_another_has_none() -> None:
    """What only some flights have is judged by those: nothing else is to be blamed for it."""
    late = ("sensor_time_skew:delay=0.045,group=vanes",)
    both = [fly_mav("multisine", seed, duration=15.0, effects=late)[0] for seed in (5, 6)]
    kept = {name: signal for name, signal in both[1].signals.items() if name not in ("alpha", "beta")}
    check = check_signals([prepare(one, VEHICLE) for one in (both[0], replace(both[1], signals=kept))], VEHICLE)
    assert not check.mistakes
    (found,) = check.delays
    assert found.signals == ("alpha", "beta")
    assert found.value == pytest.approx(0.045, abs=4.0 * found.std)


def test_an_integral_is_exact_for_cubics() -> None:
    time = np.linspace(0.0, 1.0, 21)
    rates, found = np.stack([4.0 * time**3 - time, 3.0 * time**2]), np.empty((2, 21))
    integrate(rates, 0.05, found)
    assert found == pytest.approx(np.stack([time**4 - 0.5 * time**2, time**3]), abs=1e-12)


def test_whitening_takes_the_colour_off() -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    coloured = np.zeros(noise.size)
    for k in range(1, noise.size):
        coloured[k] = 0.9 * coloured[k - 1] + noise[k]
    taps = autoregression([coloured], 4)
    assert taps == pytest.approx([1.0, -0.9, 0.0, 0.0, 0.0], abs=0.03)
    assert np.std(apply_whitening_filter(coloured, taps)) == pytest.approx(1.0, abs=0.02)


def test_readings_are_moved_by_parts_of_a_sample() -> None:
    time = 0.02 * np.arange(200)
    late = np.sin(2.0 * np.pi * 1.5 * (time - 0.027))
    moved = read_later(late, 0.027, 0.02)
    assert moved[5:-5] == pytest.approx(np.sin(2.0 * np.pi * 1.5 * time)[5:-5], abs=1e-4)


def test_held_commands_are_moved_as_their_means() -> None:
    step = np.concatenate([np.zeros(5), np.ones(5)])
    assert held_back(step, 0.025, 0.02).tolist() == pytest.approx([0, 0, 0, 0, 0, 0, 0.75, 1, 1, 1])
    assert held_back(step, -0.02, 0.02).tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 1, 1]


def test_each_sensor_gets_a_verdict_in_words() -> None:
    after = {"airspeed": OutputFit(0.02, 0.001), "alpha": OutputFit(0.005, 0.02), "theta": OutputFit(0.3, 0.5)}
    result = CompatibilityResult(
        {
            "alpha_scale": SensorError(0.08, 0.02, "1"),
            "gyro_bias_q": SensorError(-0.0087, 0.0002, "rad/s"),
            "accel_bias_x": SensorError(0.01, 0.1, "m/s^2"),
        },
        np.zeros((3, 3)), [Refusal("accel_bias_y", "nothing turned", "aileron-doublet")], after, after, False,
        ["theta"], [], {"theta": 0.001}, 0.0, SensorLayout(), True,
    )  # fmt: skip
    told = {one.signal: (one.verdict, one.status) for one in verdicts(result)}
    assert told["alpha"] == ("alpha reads 1.080 ± 0.020 of true: corrected", "corrected")
    assert told["q"] == ("q reads 0.498 ± 0.011 deg/s low: corrected", "corrected")
    assert told["ax"] == ("ax agrees within its noise", "ok")
    assert told["ay"] == ("ay: its bias cannot be told: nothing turned", "unknown")
    assert told["airspeed"] == ("airspeed agrees within its noise", "ok")
    assert told["theta"] == ("theta disagrees with the other sensors by 0.3 (noise 0.001)", "mistake")


def test_no_cure_is_believed_that_would_need_a_lift_no_wing_has(
    flight: FlightSignals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten times the airspeed of a flight that is read right: a hundredth of the lift it flies with."""

    def told(factor: float) -> None:
        wrong = Mistake("airspeed", "unit", factor, 0.0, "", "airspeed is in another unit", ("airspeed",), False)
        monkeypatch.setattr("sysid.signal_check.check.find_mistakes", lambda parts, layout: [wrong])

    told(10.0)
    assert checked(flight).findings() == []
    told(1.0 / 3.6)
    with pytest.raises(SignalError, match="another unit"):
        checked(scaled(("airspeed",), 3.6).apply(flight))

"""Identification as one call: hidden truth found, the unexcited refused by name, bad flights told in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.manoeuvres.shapes import MANOEUVRES
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import EstimationError, SegmentError, SignalError, SysidError
from sysid.identification.linear_model import LinearModel, linearise
from sysid.identification.result_file import result_json
from sysid.identify import Identification, identify
from sysid.output_error.from_problem import fit
from sysid.problem.estimation_problem import Motion, split_runs
from sysid.problem.formulation import make_problem
from sysid.problem.model_structure import default_structure, is_longitudinal
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.record import STATES

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]

VEHICLE = load_vehicle("iitb-mav")
TRUE = read_model("iitb-mav").values()
FULL = default_structure(("de", "da", "dr"))
MAIN = (
    "CL_alpha", "CL_de", "CD_0", "CD_k", "Cm_alpha", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r",
    "Cn_dr",
)  # fmt: skip


def errors_in_std(found: Identification) -> dict[str, float]:
    """Every coefficient with a value: its distance from the truth in standard errors. A term that is not there is 0."""
    told = {}
    for name, entry in found.model.coefficients.items():
        if entry.value is not None:
            assert own_bar(entry) > 0.0
            told[name] = (entry.value - TRUE.get(name, 0.0)) / own_bar(entry)
    return told


def changed(signals: FlightSignals, **changes: Callable[[Array], Array] | None) -> FlightSignals:
    """The flight with some signals changed, or taken away by None."""
    kept = dict(signals.signals)
    for name, change in changes.items():
        if change is None:
            kept.pop(name, None)
        else:
            kept[name] = replace(kept[name], values=change(kept[name].values.copy()))
    return replace(signals, signals=kept)


def cut(signals: FlightSignals, end_s: float) -> FlightSignals:
    """The first seconds of the flight."""
    kept = {
        name: replace(entry, time_s=entry.time_s[entry.time_s < end_s], values=entry.values[entry.time_s < end_s])
        for name, entry in signals.signals.items()
    }
    return replace(signals, signals=kept)


@pytest.fixture(scope="module")
def six_axes() -> FlightSignals:
    return fly_mav("multisine", 1)[0]


@pytest.fixture(scope="module")
def found(six_axes: FlightSignals) -> Identification:
    return identify([six_axes], VEHICLE)


@pytest.fixture(scope="module")
def elevator_alone() -> Identification:
    return identify([fly_mav("elevator-multisine", 3)[0]], VEHICLE, systematic=False)


def test_every_derivative_of_a_multisine_flight_is_told_and_true(found: Identification) -> None:
    z = errors_in_std(found)
    assert set(z) == set(FULL)
    assert max(abs(z[name]) for name in MAIN) < 4.0
    assert max(map(abs, z.values())) < 4.5
    assert np.sqrt(np.mean(np.square(list(z.values())))) < 1.6


def test_the_main_derivatives_are_told_to_a_few_percent(found: Identification) -> None:
    for name in MAIN:
        entry = found.model.coefficients[name]
        assert entry.extra["statistical_std"] < 0.05 * abs(TRUE[name]), name


def test_sensor_errors_are_found_too(found: Identification) -> None:
    hidden = {
        "accel_bias_x": 0.1962, "accel_bias_y": 0.1962, "accel_bias_z": 0.1962,
        "gyro_bias_p": np.deg2rad(0.25), "gyro_bias_q": np.deg2rad(0.25), "gyro_bias_r": np.deg2rad(0.25),
        "alpha_scale": 0.005, "beta_scale": 0.005,
    }  # fmt: skip
    for name, true in hidden.items():
        value, std, _ = found.sensor_errors[name]
        assert abs(value - true) < 4.0 * std, name
        assert std > 0.0


def test_nothing_that_is_well_excited_is_refused(found: Identification) -> None:
    assert not {entry.name for entry in found.refused} & set(FULL)
    assert found.model.refused() == []


def test_the_model_says_where_it_holds(found: Identification) -> None:
    low, high = found.model.validity["alpha"]
    assert low < np.radians(3.9) < high
    assert found.model.validity["airspeed"][0] < 15.0 < found.model.validity["airspeed"][1]


def test_a_flight_of_the_elevator_alone_refuses_every_lateral_derivative_by_name(
    elevator_alone: Identification,
) -> None:
    refused = {entry.name: entry for entry in elevator_alone.refused}
    lateral = {name for name in FULL if not is_longitudinal(name)}
    assert lateral <= set(refused)
    assert set(elevator_alone.model.refused()) == lateral
    for name in lateral:
        assert refused[name].reason
        assert "\n" not in refused[name].reason
        manoeuvres = refused[name].manoeuvre.split(",")
        assert set(manoeuvres) <= set(MANOEUVRES)
        assert any("aileron" in one or "rudder" in one for one in manoeuvres)


def test_a_flight_of_the_elevator_alone_tells_the_longitudinal_ones(elevator_alone: Identification) -> None:
    z = errors_in_std(elevator_alone)
    assert set(z) == {name for name in FULL if is_longitudinal(name)}
    assert max(map(abs, z.values())) < 4.0


def test_a_flight_without_the_elevator_tells_the_lateral_ones_without_bias() -> None:
    """Lift and drag are unknown then; the speed they would give must not change between samples."""
    found = identify([fly_mav("aileron-multisine,rudder-multisine", 1)[0]], VEHICLE, systematic=False)
    assert {name for name in FULL if is_longitudinal(name)} <= {entry.name for entry in found.refused}
    for name in ("Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr"):
        value = found.model.coefficients[name].value
        assert value is not None
        assert value == pytest.approx(TRUE[name], rel=0.004), name


def test_twenty_seconds_from_first_to_last_sample_are_one_free_run(six_axes: FlightSignals) -> None:
    vehicle = load_vehicle("iitb-mav")
    whole = prepare(six_axes, vehicle, start_s=0.0)
    (stretch,) = whole.stretches
    assert stretch.record.length == 1001
    states = dict.fromkeys(STATES, np.zeros(1001))
    assert [run.length for run in split_runs(stretch.record, states, Motion(True, True))[0]] == [1001]
    assert len(split_runs(stretch.record, states, Motion(True, True), run_s=19.9)[0]) == 2


def test_ten_seconds_are_enough_to_tell_something_true(six_axes: FlightSignals) -> None:
    z = errors_in_std(identify([cut(six_axes, 10.0)], VEHICLE, systematic=False))
    assert len(z) > 20
    assert max(map(abs, z.values())) < 4.5


def test_a_gap_in_a_signal_is_no_catastrophe(six_axes: FlightSignals) -> None:
    def broken(values: Array) -> Array:
        values[200:260] = np.nan
        return values

    for name in ("alpha", "q"):
        z = errors_in_std(identify([changed(six_axes, **{name: broken})], VEHICLE, systematic=False))
        assert max(map(abs, z.values())) < 4.5


def nothing(values: Array) -> Array:
    return np.full_like(values, np.nan)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"airspeed": nothing}, "airspeed "),
        ({"theta": nothing}, "theta "),
        (dict.fromkeys(("ax", "ay", "az", "p", "q", "r")), "ax, ay, az, p, q, r"),
        ({"airspeed": None}, "airspeed"),
        ({"de": None, "da": None, "dr": None}, "no control surface"),
    ],
)
def test_a_missing_signal_is_named_in_one_line(
    six_axes: FlightSignals, changes: dict[str, Callable[[Array], Array] | None], told: str
) -> None:
    with pytest.raises(SignalError) as caught:
        identify([changed(six_axes, **changes)], VEHICLE)
    assert str(caught.value).startswith("multisine-1: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_flight_that_is_none_is_told_in_one_line(six_axes: FlightSignals) -> None:
    flights: list[tuple[FlightSignals, type[SysidError]]] = [
        (cut(six_axes, 0.0), SignalError),
        (cut(six_axes, 0.6), SegmentError),
        (changed(six_axes, airspeed=np.zeros_like, vn=None), SysidError),
        (fly_mav("cruise", 1, duration=12.0)[0], SegmentError),
    ]
    for signals, kind in flights:
        with pytest.raises(kind) as caught:
            identify([signals], VEHICLE)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", ["auto", "map", "ee", "oe"])
def test_of_several_flights_one_that_is_too_short_is_left_out_and_named(six_axes: FlightSignals, method: str) -> None:
    short = replace(cut(six_axes, 0.6), name="short")
    found = identify([short, six_axes], VEHICLE, method=method, systematic=False)
    assert [one.data.name for one in found.flights] == ["multisine-1"]
    assert any(warning.startswith("left out: short: ") for warning in found.warnings)
    alone = identify([six_axes], VEHICLE, method=method, systematic=False)
    assert found.model.values() == pytest.approx(alone.model.values(), rel=1e-9)


def test_a_part_that_holds_no_data_is_told_in_one_line(six_axes: FlightSignals) -> None:
    for start, stop in ((100.0, 120.0), (5.0, 5.5), (9.0, 3.0)):
        with pytest.raises(SegmentError) as caught:
            identify([six_axes], VEHICLE, start_s=start, stop_s=stop)
        assert "\n" not in str(caught.value)


def test_an_unknown_method_is_named() -> None:
    with pytest.raises(EstimationError, match="'magic'"):
        identify([], VEHICLE, method="magic")


def test_without_a_thrust_sensor_the_throttle_tells_the_thrust(six_axes: FlightSignals) -> None:
    z = errors_in_std(identify([changed(six_axes, thrust=None)], VEHICLE, systematic=False))
    assert max(map(abs, z.values())) < 4.5


@pytest.fixture(scope="module")
def by_equations(six_axes: FlightSignals) -> tuple[Identification, list[float]]:
    """The flight by equation error, and the progress that was told."""
    seen: list[float] = []
    found = identify([six_axes], VEHICLE, method="ee", progress=lambda share, text: seen.append(share))
    return found, seen


def test_equation_error_alone_tells_the_truth_within_its_bars(
    by_equations: tuple[Identification, list[float]],
) -> None:
    found, _ = by_equations
    for name in ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr"):
        assert found.model.values()[name] == pytest.approx(TRUE[name], rel=0.02), name
    z = errors_in_std(found)
    assert set(z) == set(FULL)
    assert max(map(abs, z.values())) < 4.0
    assert np.sqrt(np.mean(np.square(list(z.values())))) < 1.6


def test_equation_error_says_what_its_regressions_rest_on(by_equations: tuple[Identification, list[float]]) -> None:
    found, _ = by_equations
    report = result_json(found)["regression"]
    assert set(report) == {"CL", "CD", "CY", "Cl", "Cm", "Cn"}
    told = {name: entry for axis in report.values() for name, entry in axis["terms"].items()}
    assert set(told) == set(FULL)
    for name in MAIN:
        assert told[name]["p_value"] < 1e-6
        if name == "CD_0":  # a constant has no transform
            continue
        other = told[name]["frequency_domain"]
        entry = found.model.coefficients[name]
        assert entry.std is not None
        assert entry.std >= told[name]["std_regression"]
        assert abs(other["value"] - told[name]["value"]) < 4.0 * np.hypot(other["std"], entry.std)
        assert name in report[name.partition("_")[0]]["structure"]["stepwise"]
    table = report["CL"]["over_alpha"]
    slope = np.polyfit(table["alpha"], table["value"], 1)[0]
    assert slope == pytest.approx(TRUE["CL_alpha"], rel=0.02)
    # The aircraft is linear in all of these: nothing is to be added.
    assert {"CL_alpha2", "CL_alpha_de", "CL_beta2"} <= {test["name"] for test in report["CL"]["excluded"]}
    assert not any("supports" in warning for warning in found.warnings)
    moved = found.model.coefficients["Cm_de"].extra["systematic"]
    assert moved["inertia_5pct"] == pytest.approx(0.05 * TRUE["Cm_de"], rel=0.05)
    assert moved["linkage_5pct"] == pytest.approx(-0.05 * TRUE["Cm_de"], rel=0.05)
    assert found.model.correlation is not None
    assert set(found.model.correlation.names) == set(FULL)


def test_progress_rises_to_its_end(by_equations: tuple[Identification, list[float]]) -> None:
    _, seen = by_equations
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_errors_of_the_vehicle_file_move_the_estimates_as_physics_says(
    six_axes: FlightSignals, found: Identification
) -> None:
    moved = {name: entry.extra["systematic"] for name, entry in found.model.coefficients.items()}
    value = found.model.values()
    # Moments are accelerations times inertia over dynamic pressure; a control derivative is per deflection.
    for name in ("Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr"):
        assert moved[name]["inertia_5pct"] == pytest.approx(0.05 * value[name], rel=0.01)
    for name in ("CL_alpha", "CL_de", "CD_0", "CY_beta"):
        assert abs(moved[name]["inertia_5pct"]) < 1e-3 * abs(value[name])
    for name in ("CL_alpha", "CD_0", "Cm_alpha", "Cm_de", "Cl_p", "Cn_beta"):
        assert moved[name]["density_2pct"] == pytest.approx(-0.02 * value[name], rel=0.03)
    for name in ("CL_de", "Cm_de", "Cl_da", "Cn_dr"):
        assert moved[name]["linkage_5pct"] == pytest.approx(-0.05 * value[name], rel=0.03)
    # No closed form: what an estimation with the changed vehicle, or with commands half a sample late, says.
    heavier = replace(VEHICLE, mass=replace(VEHICLE.mass, mass=1.002 * VEHICLE.mass.mass))
    again = identify([six_axes], heavier, systematic=False, method="oe").model.values()
    late = {name: six_axes.signals[name] for name in ("de", "da", "dr")}
    late = {name: replace(e, values=0.5 * e.values + 0.5 * np.roll(e.values, 1)) for name, e in late.items()}
    shifted = make_problem(
        [prepare(replace(six_axes, signals={**six_axes.signals, **late}), VEHICLE)], VEHICLE, found.compatibility
    )
    right_timing = make_problem(found.flights, VEHICLE, found.compatibility).command_first
    after = fit(replace(shifted, command_first=right_timing), found.model, list(value))
    for name in ("CL_alpha", "CD_0", "Cm_de", "CY_beta", "Cl_p"):
        beside = found.model.coefficients[name].extra
        std, late_by = beside["statistical_std"], beside["late"]["timing_10ms"]
        assert moved[name]["mass_1pct"] == pytest.approx(5.0 * (again[name] - value[name]), rel=0.1, abs=0.5 * std)
        assert abs(late_by) > 3.0 * std
        assert late_by == pytest.approx(after.value(name) - value[name], rel=0.1, abs=std)


def test_the_modes_of_the_identified_model_are_the_aircrafts(found: Identification) -> None:
    assert isinstance(found.mean.linear, LinearModel)
    at = found.mean.linear.system
    true = {mode.name: mode for mode in linearise(VEHICLE, read_model("iitb-mav"), at.airspeed, at.density).modes()}
    told = found.mean.linear.modes()
    assert {mode.name for mode in told} == set(true)
    for mode in told:
        for key in ("frequency_hz", "damping", "time_constant_s"):
            pair, expected = getattr(mode, key), getattr(true[mode.name], key)
            assert (pair is None) == (expected is None)
            if pair is not None:
                assert abs(pair[0] - expected[0]) < 4.0 * pair[1], (mode.name, key)

"""Signals that come late, die, return or never come, and arithmetic that fails: what each may cost and what not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from live_flights import pieces
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.live.recursive.axis_estimators import SlowSamples
from sysid.live.recursive.frequency_estimator import AxisEstimator, CoefficientEstimates
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

LATERAL = ("CY", "Cl", "Cn")


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 5, duration=16.0)[0]


def reports(
    flight: FlightSignals, silent: Mapping[str, tuple[float, float]], live: LiveIdentifier | None = None
) -> dict[float, LiveReport]:
    """A report each 0.4 s. silent: signal -> from when to when it does not come."""
    live = live or LiveIdentifier(load_vehicle("iitb-mav"))
    found = {}
    for samples in pieces(flight, 0.4):
        for name, (begin, end) in silent.items():
            time_s, values = samples[name]
            there = (time_s < begin) | (time_s >= end)
            samples[name] = time_s[there], values[there]
        live.take({name: entry for name, entry in samples.items() if entry[0].size})
        report = live.report()
        found[report.time_s] = report
    return found


def known(report: LiveReport) -> set[str]:
    return {name for name, one in report.coefficients.items() if one.known}


def after(found: Mapping[float, LiveReport], time_s: float) -> LiveReport:
    return found[min(at for at in found if at >= time_s)]


@pytest.mark.parametrize("name", ["airspeed", "alpha", "beta", "phi", "de", "az"])
def test_a_signal_that_comes_late_is_used_as_soon_as_it_comes(flight: FlightSignals, name: str) -> None:
    whole = known(after(reports(flight, {}), 12.0))
    late = known(after(reports(flight, {name: (0.0, 3.0)}), 12.0))
    assert len(whole) >= 24
    assert len(late) >= len(whole) - 2, whole - late


def test_a_vane_that_dies_leaves_the_longitudinal_axes_alone_and_what_was_known_stands(flight: FlightSignals) -> None:
    found = reports(flight, {"beta": (9.0, np.inf)})
    before, end = after(found, 8.5), found[max(found)]
    assert end.time_s > 15.5
    assert known(before) <= known(end)
    assert end.coefficients["Cm_alpha"].std < 0.9 * before.coefficients["Cm_alpha"].std
    assert end.coefficients["Cn_beta"].known
    assert [line for line in end.warnings if "(beta)" in line] == [
        f"there is no sideslip vane (beta): {axis} stands still" for axis in LATERAL
    ]
    assert end.changes == ()


def test_a_vane_that_comes_back_goes_on_where_it_was(flight: FlightSignals) -> None:
    found = reports(flight, {"beta": (6.0, 11.0)})
    before, end = after(found, 5.5), found[max(found)]
    assert end.coefficients["Cl_p"].std < before.coefficients["Cl_p"].std
    assert not any("beta" in line for line in end.warnings)
    assert end.changes == ()


@pytest.mark.parametrize("names", [("phi", "theta", "psi"), ("thrust", "rpm", "throttle"), ("da",)])
def test_other_signals_that_die_cost_only_what_needs_them(flight: FlightSignals, names: tuple[str, ...]) -> None:
    there = [name for name in names if name in flight.signals]
    end = after(reports(flight, dict.fromkeys(there, (9.0, np.inf))), 15.0)
    assert end.coefficients["Cm_alpha"].known
    assert end.changes == ()


def test_nothing_is_kept_without_end_of_signals_that_nobody_can_use(flight: FlightSignals) -> None:
    silent, blind = LiveIdentifier(load_vehicle("iitb-mav")), LiveIdentifier(load_vehicle("iitb-mav"))
    reports(flight, {"az": (0.0, np.inf)}, silent)
    assert len(silent._waiting) <= 7
    reports(flight, dict.fromkeys(("phi", "theta", "psi"), (0.0, np.inf)), blind)
    assert len(blind._sparse) < 20
    for second in range(2000):  # a receiver alone, without an aircraft around it
        time_s = second + np.arange(5) / 5.0
        silent.take(dict.fromkeys(("vn", "ve", "vd"), (time_s, time_s)))
    assert len(silent._sparse) <= 1000


@pytest.mark.parametrize("error", [OverflowError, FloatingPointError, np.linalg.LinAlgError, ValueError])
def test_arithmetic_that_fails_in_one_axis_costs_one_report_of_that_axis(
    flight: FlightSignals, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    reports(flight, {}, live)
    estimate = AxisEstimator.estimate

    def failing(self: AxisEstimator, *arguments: object) -> CoefficientEstimates | None:
        if "Cm_alpha" in self.names:
            raise error("out of\nrange")
        return estimate(self, *arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(AxisEstimator, "estimate", failing)
        report = live.report()
    assert not report.coefficients["Cm_alpha"].known
    assert report.coefficients["CL_alpha"].known
    assert [line for line in report.warnings if line.startswith("Cm ")] == [
        f"Cm is left out once: its arithmetic failed ({error.__name__}: out of range)"
    ]
    report = live.report()
    assert report.coefficients["Cm_alpha"].known
    assert not any(line.startswith("Cm ") for line in report.warnings)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_reading_beyond_all_measure_is_survived(flight: FlightSignals) -> None:
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    last = known(list(reports(flight, {}, live).values())[-1])
    end = live.time_s
    for count, samples in enumerate(pieces(flight, 0.4)):
        shifted = {name: (time_s + end + 0.02, values) for name, (time_s, values) in samples.items()}
        if count == 3:
            for name in ("az", "q", "alpha", "p"):
                shifted[name] = (shifted[name][0], np.full(shifted[name][0].size, 1e200))
        live.take(shifted)
        report = live.report()
    assert len(known(report)) >= len(last) - 2
    assert np.isfinite(report.coefficients["CL_alpha"].value)


def test_what_fails_beside_the_estimates_is_said_and_ends_nothing(
    flight: FlightSignals, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(self: SlowSamples, axes: object) -> None:
        raise FloatingPointError("overflow")

    live = LiveIdentifier(load_vehicle("iitb-mav"))
    monkeypatch.setattr(SlowSamples, "hand_on", failing)
    report = list(reports(flight, {}, live).values())[-1]
    assert any("left out of what watches for changes" in line for line in report.warnings)
    assert report.coefficients["CL_alpha"].known

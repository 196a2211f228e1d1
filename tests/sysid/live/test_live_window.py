"""The last half minute by the estimator of after the flight: right behind field sensors, whatever the stamps."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import FieldFlight, field_flight
from live_flights import Here, half_elevator, pieces
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.live.posterior_window import (
    FIRST_S,
    FIRST_WITHOUT_ALPHA_S,
    WINDOW_S,
    SlidingWindow,
    WindowEstimate,
    estimate_window,
)
from sysid.posterior.closed_loop import SHORTEST_LOOP_S
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

SHIFTS_S = (0.0, 0.003, 0.007, 0.012, 0.020)


class Later(Here):
    """Answers when asked to."""

    def __init__(self) -> None:
        self.waiting: list[Future[WindowEstimate]] = []

    def submit(self, function: Callable[..., WindowEstimate], /, *arguments: object) -> Future[WindowEstimate]:
        self.waiting.append(Future())
        return self.waiting[-1]


def told(signals: FlightSignals, vehicle: Vehicle, until_s: float = np.inf) -> list[LiveReport]:
    live, reports = LiveIdentifier(vehicle, Here()), []
    for count, samples in enumerate(pieces(signals, 0.1), 1):
        live.take(samples)
        if count % 10 == 0:
            reports.append(live.report())
            if reports[-1].time_s > until_s:
                break
    return reports


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> FieldFlight:
    return field_flight("mild", 1, tmp_path_factory.mktemp("field"))


@pytest.fixture(scope="module")
def reports(field: FieldFlight) -> list[LiveReport]:
    return told(field.signals, field.vehicle)


def test_bars_hold_behind_servos_vanes_and_links_of_the_field(field: FieldFlight, reports: list[LiveReport]) -> None:
    known = {name: reports[-1].coefficients[name] for name in field.excited if reports[-1].coefficients[name].known}
    assert len(known) >= 0.8 * len(field.excited)
    misses = {
        name: max(low - known[name].value, known[name].value - high, 0.0) / known[name].std
        for name, (low, high) in field.truth.items()
        if name in known
    }
    assert max(misses.values()) < 3.0
    assert np.mean([miss < 1.96 for miss in misses.values()]) > 0.9
    servo = next(one for one in reports[-1].nuisances if one.name == "servo_lag" and one.group == "lateral")
    assert servo.std < 0.7 * servo.prior_std


def test_an_aircraft_without_vanes_is_known_after_twenty_seconds(field: FieldFlight) -> None:
    kept = {name: one for name, one in field.signals.signals.items() if name not in ("alpha", "beta")}
    reports = told(replace(field.signals, signals=kept), field.vehicle, 24.0)
    begin = next(report.time_s for report in reports if np.isfinite(report.time_s))
    for report in reports:
        if report.time_s < begin + FIRST_WITHOUT_ALPHA_S - 1.0:
            assert not any(one.known for one in report.coefficients.values())
    assert any("after 20 s of flight" in one.why for one in reports[5].coefficients.values())
    known = {name: one for name, one in reports[-1].coefficients.items() if one.known and name in field.excited}
    assert len(known) >= 0.6 * len(field.excited)
    for name, one in known.items():
        low, high = field.truth[name]
        assert max(low - one.value, one.value - high) < 3.5 * one.std, name


def test_an_aircraft_without_a_sideslip_vane_is_known_as_soon_as_with_one(field: FieldFlight) -> None:
    kept = {name: one for name, one in field.signals.signals.items() if name != "beta"}
    reports = told(replace(field.signals, signals=kept), field.vehicle, 14.0)
    known = {name: one for name, one in reports[-1].coefficients.items() if one.known and name in field.excited}
    assert len(known) >= 0.5 * len(field.excited)
    for name, one in known.items():
        low, high = field.truth[name]
        assert max(low - one.value, one.value - high) < 3.5 * one.std, name


def test_nothing_is_told_before_the_first_window(reports: list[LiveReport]) -> None:
    begin = reports[0].time_s
    for report in reports:
        if report.time_s < begin + FIRST_S - 1.0:
            assert not any(one.known for one in report.coefficients.values())
    words = [one.why for one in reports[3].coefficients.values()]
    assert any("first estimate comes after 8 s of flight" in why for why in words)


def test_an_autopilot_that_answers_gusts_is_looked_for_before_a_number_is_known(tmp_path: Path) -> None:
    """After 10 s roll damping was known as a tenth of what it is, twelve bars off: what flew the aircraft."""
    flight = field_flight("closed-loop", 0, tmp_path)
    seen = told(flight.signals, flight.vehicle, until_s=22.0)
    early = [one for report in seen if report.time_s < SHORTEST_LOOP_S for one in report.coefficients.values()]
    assert not any(one.known for one in early)
    assert any("whether an autopilot answers" in one.why for one in early)
    last = {name: one for name, one in seen[-1].coefficients.items() if one.known and name in flight.truth}
    assert len(last) >= 5
    for name, one in last.items():
        low, high = flight.truth[name]
        assert max(low - one.value, one.value - high) < 4.0 * one.std, name


def test_commands_stamped_later_move_no_coefficient_by_half_a_bar_and_come_after_their_cause() -> None:
    signals, vehicle = fly_mav("multisine", 3)[0], load_vehicle("iitb-mav")
    plain = {name: (one.time_s, one.values) for name, one in signals.signals.items()}
    begin, end = float(plain["az"][0][0]) + 0.5, float(plain["az"][0][-1]) - 0.2
    found = []
    for shift in SHIFTS_S:
        moved = {n: (t + shift if n in ("de", "da", "dr", "throttle") else t, v) for n, (t, v) in plain.items()}
        found.append(estimate_window(vehicle, moved, begin, end))
        delays = [one for one in found[-1].nuisances if one.name in ("servo_delay", "command_clock")]
        assert all(one.value >= 0.0 for one in delays)
    for name, first in found[0].coefficients.items():
        for other in found[1:]:
            if first.known and other.coefficients[name].known:
                assert abs(other.coefficients[name].value - first.value) < 0.5 * first.std, (name, first, other)


def test_after_a_change_the_window_begins_anew() -> None:
    reports = told(half_elevator(fly_mav("multisine", 4)[0], 14.0), load_vehicle("iitb-mav"))
    change = next(report for report in reports if report.changes)
    known = [report.coefficients["Cm_de"] for report in reports]
    assert reports[-1].changes[0].coefficient == "Cm_de"
    assert any(one.known for one, report in zip(known, reports, strict=True) if report.time_s < 13.0)
    behind = [one for one, report in zip(known, reports, strict=True) if 0.0 <= report.time_s - change.time_s < 4.0]
    assert not any(one.known for one in behind)


def window(runner: Here, flight: FlightSignals) -> SlidingWindow:
    one = SlidingWindow(load_vehicle("iitb-mav"), runner)
    one.take({name: (signal.time_s, signal.values) for name, signal in flight.signals.items()})
    return one


def known_window() -> tuple[SlidingWindow, Later, WindowEstimate]:
    """One that has its first estimate, until 12 s; what it asks for, and that estimate."""
    flight, later = fly_mav("multisine", 5)[0], Later()
    one = window(later, flight)
    columns = {name: (signal.time_s, signal.values) for name, signal in flight.signals.items()}
    first = estimate_window(load_vehicle("iitb-mav"), columns, 1.0, 12.0)
    one.flown(0.0, 12.0)
    one.work()
    later.waiting[0].set_result(replace(first, cost_s=0.1))
    one.work()
    return one, later, first


def test_an_estimate_under_way_is_waited_for_and_one_of_before_a_change_is_not_taken() -> None:
    flight, later = fly_mav("multisine", 5)[0], Later()
    one = window(later, flight)
    one.flown(0.0, FIRST_S + 1.0)
    one.work()
    one.flown(FIRST_S + 1.0, FIRST_S + 9.0)
    one.work()
    assert len(later.waiting) == 1
    assert one.statuses() == {}
    one.begin_anew(FIRST_S)
    later.waiting[0].set_result(WindowEstimate(0.0, FIRST_S, 0.1, {}))
    one.work()
    assert one.found is None
    assert one.cost_s == 0.1


def test_a_lost_estimate_is_told_and_what_was_known_stands() -> None:
    one, later, first = known_window()
    one.flown(12.0, 30.0)
    one.work()
    later.waiting[1].set_exception(EOFError("ended"))
    one.work()
    assert one.found is not None
    assert one.found.problem == "the estimate was lost (EOFError: ended)"
    status, known = one.statuses()["Cm_de"], first.coefficients["Cm_de"]
    assert (status.value, status.known) == (known.value, False)
    assert status.std > known.std
    assert status.why.endswith("since then the estimate was lost (EOFError: ended)")


def test_what_is_not_excited_any_more_is_last_known_with_a_bar_that_grows() -> None:
    one, later, first = known_window()
    known = first.coefficients["Cm_de"]
    assert known.known
    lost = replace(known, known=False, why="de has not moved")
    one.flown(12.0, 60.0)
    one.work()
    later.waiting[1].set_result(replace(first, begin_s=30.0, end_s=60.0, coefficients={"Cm_de": lost}))
    one.work()
    status = one.statuses()["Cm_de"]
    assert not status.known
    assert status.value == known.value
    assert status.std == pytest.approx(known.std * np.sqrt(1.0 + (60.0 - 12.0) / WINDOW_S))
    assert status.why.startswith("last known at 12 s as ")
    assert status.why.endswith("since then de has not moved")


def test_a_window_in_which_nothing_moves_says_so_and_what_to_fly() -> None:
    flight = fly_mav("multisine", 5)[0]
    columns = {name: (one.time_s, one.values) for name, one in flight.signals.items()}
    columns |= {name: (columns[name][0], np.full_like(columns[name][1], 0.01)) for name in ("de", "da", "dr")}
    found = estimate_window(load_vehicle("iitb-mav"), columns, 1.0, 12.0)
    assert found.problem == ""
    assert {one.why for one in found.coefficients.values()} == {"no surface has moved from 1 to 12 s"}
    assert all(one.fly and not one.known for one in found.coefficients.values())


def test_a_window_without_airspeed_says_what_is_missing() -> None:
    flight = fly_mav("multisine", 5)[0]
    columns = {name: (one.time_s, one.values) for name, one in flight.signals.items() if name != "airspeed"}
    found = estimate_window(load_vehicle("iitb-mav"), columns, 1.0, 12.0)
    assert found.coefficients == {}
    assert "no airspeed" in found.problem


def test_a_window_that_contradicts_what_was_known_does_not_replace_it() -> None:
    """As one does in which an autopilot moves the surfaces; one that agrees does."""
    one, later, first = known_window()
    before = one.statuses()["Cl_p"]
    for value, std, stays in (
        (5.0 * before.value, 3.0 * before.std, True),
        (1.02 * before.value, 9.0 * before.std, False),
    ):
        said = replace(first.coefficients["Cl_p"], value=value, std=std)
        one.flown(12.0, 30.0)
        one.work()
        later.waiting[-1].set_result(
            replace(first, end_s=29.0, cost_s=0.1, coefficients={**first.coefficients, "Cl_p": said})
        )
        one.work()
        now = one.statuses()["Cl_p"]
        assert now.known is not stays
        if stays:
            assert now.value == before.value
            assert "contradicts that, and no change has been seen" in now.why
        one, later, first = known_window()

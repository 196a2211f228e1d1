"""A flight on its model without satellites: closed forms, winds drawn here, flights of another engine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import fly_plan, plan_of
from simulated import fly_mav

from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SegmentError, SignalError
from sysid.identification.repaired_flight import meant
from sysid.identify import identify
from sysid.problem.free_run import Fixed
from sysid.signals.flight import FlightSignals
from sysid.validation.coasting import CHI2_95, Coast, _WindFilter, coast

WIND = ("steady_wind:north=4,east=-3",)


def on_model(signals: FlightSignals, seconds: float, start_s: float | None = None, **changed: float) -> Coast:
    craft, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    entries = {name: Coefficient(value) for name, value in changed.items()}
    model = replace(model, coefficients={**model.coefficients, **entries})
    return coast(meant(signals, craft).prepared, craft, Fixed(flatten(craft, model), {}), seconds, start_s)


def test_in_a_steady_wind_the_model_stays_where_the_aircraft_is() -> None:
    signals, flown = fly_mav("multisine", 5, effects=WIND, duration=60.0)
    found = on_model(signals, 30.0)
    assert found.time_s[-1] - found.time_s[0] == pytest.approx(30.0, abs=0.6)
    assert found.wind == pytest.approx((4.0, -3.0), abs=0.5)
    # What was flown, by the simulator's own position.
    begin, end = (np.searchsorted(flown.time_s, at) for at in (found.time_s[0], found.time_s[-1]))
    truth = [flown.truth[name][end] - flown.truth[name][begin] for name in ("north", "east")]
    assert found.aircraft[-1] == pytest.approx(truth, abs=3.0)
    assert found.drift[-1] < 0.03 * found.distance
    assert found.inside
    assert np.all(np.diff(np.trace(found.covariance, axis1=1, axis2=2)) > 0.0)


def test_a_wrong_model_takes_its_angle_for_wind() -> None:
    """A side force that is there in no flight: the nose seems to point beside the wind."""
    signals, _ = fly_mav("multisine", 5, effects=WIND, duration=60.0)
    right, wrong = on_model(signals, 20.0, 22.0), on_model(signals, 20.0, 22.0, CY_beta=-0.4, CY_0=0.1)
    assert right.drift[-1] < 10.0
    # A constant angle is one with the heading's, which the flight before shows; the wind then is off instead.
    assert abs(wrong.wind[0] - right.wind[0]) + abs(wrong.wind[1] - right.wind[1]) > 1.0


def test_the_ellipse_holds_winds_of_its_kind() -> None:
    """Winds drawn here: a mean, a walk, gusts with memory; straight flight, then a turn."""
    gust, memory, wander, noise, step = 0.6, 10.0, 0.5, 0.05, 0.5
    random = np.random.default_rng(0)
    inside = []
    for _ in range(300):
        heading = np.concatenate([np.full(160, 0.3), np.linspace(0.3, 2.0, 80)]) + random.uniform(0.0, 6.0)
        air = 15.0 * np.column_stack([np.cos(heading), np.sin(heading)])
        scale, off = 0.03 * random.standard_normal(), 0.05 * random.standard_normal()
        wind = random.normal(0.0, 4.0, 2) + np.cumsum(
            wander * np.sqrt(step / 60.0) * random.standard_normal((240, 2)), 0
        )
        kept, gusts = np.exp(-step / memory), [gust * random.standard_normal(2)]
        for _ in range(239):
            gusts.append(kept * gusts[-1] + gust * np.sqrt(1.0 - kept**2) * random.standard_normal(2))
        across = np.column_stack([-air[:, 1], air[:, 0]])
        ground = (1.0 + scale) * air + off * across + wind + np.array(gusts)
        made = _WindFilter(np.array([gust, memory, wander, noise]), step)
        made.run(air[:120], ground[:120] + noise * random.standard_normal((120, 2)))
        made.forget_position()
        for one in air[120:]:
            made.carry(one)
        miss = made.x[:2] - step * ground[120:].sum(axis=0)
        inside.append(miss @ np.linalg.solve(made.P[:2, :2], miss) < CHI2_95)
    assert 0.92 < np.mean(inside) < 0.98


def test_on_another_engine_s_flight_it_drifts_far_less_than_inertia_and_within_its_ellipse(tmp_path: Path) -> None:
    plan = replace(plan_of("mild", 3), seconds=130.0)
    flight = fly_plan(plan, 3, tmp_path, "flight")
    found = identify([flight.signals], flight.vehicle)
    model = Fixed(flatten(flight.vehicle, found.model.with_starts()), {})
    prepared = meant(flight.signals, flight.vehicle).prepared
    coasts = [coast(prepared, flight.vehicle, model, 60.0, start) for start in (40.0, 55.0, 68.0)]
    assert all(one.inside for one in coasts)
    assert sum(one.drift[-1] for one in coasts) < 0.3 * sum(one.inertial_drift[-1] for one in coasts)


def test_what_does_not_fit_is_said() -> None:
    signals, _ = fly_mav("multisine", 5, effects=WIND, duration=60.0)
    with pytest.raises(SegmentError, match="in flight from 0 to 60 s: 45 s from 15 s on, and 20 s before"):
        on_model(signals, 45.0)
    without = FlightSignals("f", {name: one for name, one in signals.signals.items() if name not in ("vn", "ve")})
    with pytest.raises(SignalError, match="coasting needs vn, ve"):
        on_model(without, 20.0)
    # Where the aircraft was is not made up.
    lost = dict(signals.signals)
    for name in ("vn", "ve"):
        kept = (lost[name].time_s < 40.0) | (lost[name].time_s > 47.0)
        lost[name] = replace(lost[name], time_s=lost[name].time_s[kept], values=lost[name].values[kept])
    with pytest.raises(SegmentError, match=r"GPS has a gap of 7\.[0-9] s there"):
        on_model(FlightSignals("f", lost), 20.0, 35.0)
    assert on_model(FlightSignals("f", lost), 10.0, 49.5).drift[-1] < 10.0
    with pytest.raises(SegmentError, match="are not in it"):
        on_model(signals, 20.0, float("nan"))

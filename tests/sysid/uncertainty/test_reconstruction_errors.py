"""A part of the motion that is measured instead of simulated: what is open of it, and what is not told with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility, moved_by
from sysid.errors import SysidError
from sysid.identify import Identification, identify
from sysid.problem.formulation import make_problem
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.record import STATES
from sysid.uncertainty.reconstruction_errors import SOURCE, shifted

pytestmark = pytest.mark.whole_flight

VEHICLE, TRUE = load_vehicle("iitb-mav"), read_model("iitb-mav").values()


def frozen(flight: FlightSignals, *surfaces: str) -> FlightSignals:
    """The flight with channels that repeat one value."""
    still = {
        name: replace(flight.signals[name], values=np.full_like(flight.signals[name].values, 0.01)) for name in surfaces
    }
    return replace(flight, signals={**flight.signals, **still})


def scores(found: Identification, shares: bool) -> dict[str, float]:
    """Errors of the coefficients over their standard errors, with or without what is open of the measured motion."""
    told = {}
    for name, entry in found.model.coefficients.items():
        if entry.value is not None and entry.std is not None:
            share = entry.extra.get("bench", {}).get(SOURCE, 0.0)
            std = own_bar(entry) if shares else np.sqrt(own_bar(entry) ** 2 - share**2)
            told[name] = (entry.value - TRUE.get(name, 0.0)) / std
    return told


def test_intervals_hold_where_airspeed_is_measured_and_not_simulated() -> None:
    """Airspeed known to 0.3 % moves Cl_da and Cn_dr by twenty times what the noise of such a flight leaves open."""
    found = [
        identify([frozen(fly_mav("multisine", seed, duration=14.0)[0], "de")], VEHICLE, systematic=False)
        for seed in (2, 4, 5)
    ]
    held = [z for one in found for z in scores(one, shares=True).values()]
    alone = [scores(one, shares=False)[name] for one in found for name in ("Cl_da", "Cn_dr")]
    assert len(held) == 3 * 18
    assert 0.8 < np.sqrt(np.mean(np.square(held))) < 1.6
    assert max(np.abs(held)) < 4.0
    assert np.sqrt(np.mean(np.square(alone))) > 8.0


@pytest.mark.parametrize(("surface", "lost", "given"), [("de", ("CL", "CD", "Cm"), 18), ("dr", ("CY", "Cl", "Cn"), 10)])
def test_coefficients_beside_a_dead_channel_are_refused_with_the_reason(
    surface: str, lost: tuple[str, ...], given: int
) -> None:
    flight = frozen(fly_mav("multisine", 1, duration=14.0)[0], surface)
    found = identify([flight], VEHICLE, method="oe", systematic=False)
    refused = {one.name: one.reason for one in found.refused if one.name in found.model.coefficients}
    assert {name.split("_")[0] for name in refused} == set(lost)
    assert all(f"channel of {surface} is dead" in reason for reason in refused.values())
    assert any(text.startswith(f"{surface}: repeats one value, yet") for text in found.warnings)
    told = scores(found, shares=True)
    assert len(told) == given
    assert max(map(abs, told.values())) < 4.0


def test_where_all_that_moved_is_dead_nothing_is_told() -> None:
    flight = frozen(fly_mav("elevator-3211", 3, duration=12.0)[0], "de")
    with pytest.raises(SysidError, match="channel is dead") as told:
        identify([flight], VEHICLE, method="oe", systematic=False)
    assert "\n" not in str(told.value)


def test_sensor_errors_move_the_measured_motion_as_smoothing_it_anew_does() -> None:
    prepared = [prepare(frozen(fly_mav("multisine", 2, duration=14.0)[0], "de"), VEHICLE)]
    compatible = check_compatibility(prepared)
    problem = make_problem(prepared, VEHICLE, compatible, dead={"de": ""})
    parts = [stretch.data for flight in prepared for stretch in flight.stretches]
    record = problem.records[0]
    for name, state in (
        ("airspeed_scale", "u"), ("airspeed_bias", "u"), ("alpha_bias", "w"), ("theta_bias", "theta"),
        ("gyro_bias_q", "q"),
    ):  # fmt: skip
        size = compatible.parameters[name].std
        before, after = (one.states[0][state] for one in moved_by(parts, compatible, [{name: 0.0}, {name: size}]))
        smoothed = (after - before)[: record.length]
        ours = (shifted(record, {name: size}).imposed_states - record.imposed_states)[
            record.start :, STATES.index(state)
        ]
        assert ours.mean() == pytest.approx(smoothed.mean(), rel=0.15)


def test_aerodynamics_outside_the_structure_are_still_seen_beside_a_measured_motion() -> None:
    model = read_model("iitb-mav").with_coefficient("Cn_beta3", 0.15).with_coefficient("Cl_beta3", -0.15)
    flight = fly_mav("aileron-3211,rudder-3211", 1, model=model, duration=24.0)[0]
    found = identify([flight], VEHICLE, systematic=False)
    assert any("beta3" in text and "what the structure does not hold" in text for text in found.warnings)
    # Symmetric in sideslip, the terms leave the moments at none of it where they are.
    told = scores(found, shares=True)
    assert max(abs(told[name]) for name in ("CY_0", "Cl_0", "Cn_0")) < 4.0

"""The verdict of a flight: what each thing that speaks against it does to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model.aerodynamic_terms import AXES
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.identify import identify
from sysid.quality.estimate_rules import SeenEstimate, with_estimate, with_no_aircraft
from sysid.quality.flight_quality import CARE, LATERAL, LONGITUDINAL, POOR, Quality, Reason, once
from sysid.quality.flight_rules import SeenFlight, quality_of
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.preparation import prepare
from sysid.validation.statistics import validate

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
ALL = "elevator-3211,aileron-doublet,rudder-doublet"


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 5)[0]


def changed(flight: FlightSignals, **signals: Signal | None) -> FlightSignals:
    every = {**flight.signals, **{name: one for name, one in signals.items() if one is not None}}
    return replace(flight, signals={name: one for name, one in every.items() if signals.get(name, one) is not None})


def thinned(one: Signal, step: int) -> Signal:
    return replace(one, time_s=one.time_s[::step], values=one.values[::step])


def judged(*flights: FlightSignals, vehicle: Vehicle = VEHICLE, gusts: float = 0.0) -> Quality:
    return quality_of([SeenFlight(flight, prepare(flight, vehicle), vehicle, gusts, False) for flight in flights])


def test_a_flight_as_it_should_be_is_good(flight: FlightSignals) -> None:
    found = judged(flight)
    assert (found.verdict, found.reasons, found.not_flown) == ("good", (), ())
    assert found.to_json() == {
        "verdict": "good", "reasons": [], "axes": {axis: {"verdict": "good", "reasons": []} for axis in AXES},
    }  # fmt: skip


def test_a_flight_that_lacks_some_axes_is_good_for_the_others_alone(flight: FlightSignals) -> None:
    still = replace(flight.signals["de"], values=np.zeros_like(flight.signals["de"].values))
    found = judged(changed(flight, de=still))
    assert found.verdict == "care"
    assert [found.of_axis(axis) for axis in ("Cm", "Cn")] == ["poor", "good"]


@pytest.mark.parametrize(("hz", "verdict", "words"), [(25, "care", "come at 25 Hz"), (5, "poor", "come at 5 Hz")])
def test_slow_sensors(hz: int, verdict: str, words: str, flight: FlightSignals) -> None:
    imu = {name: thinned(flight.signals[name], 50 // hz) for name in ("ax", "ay", "az", "p", "q", "r")}
    found = quality_of([SeenFlight(changed(flight, **imu), prepare(flight, VEHICLE), VEHICLE, 0.0, False)])
    assert found.verdict == verdict
    assert any(words in one.text and one.advice for one in found.reasons)


def test_lost_samples_are_a_share_of_the_time(flight: FlightSignals) -> None:
    q = flight.signals["q"]
    kept = (q.time_s < 5.0) | (q.time_s > 6.0)
    gaps = replace(q, time_s=q.time_s[kept], values=q.values[kept])
    found = quality_of([SeenFlight(changed(flight, q=gaps), prepare(flight, VEHICLE), VEHICLE, 0.0, False)])
    (reason,) = found.reasons
    assert reason.verdict == CARE
    # A second of the twenty that the flight lasts, and one gap.
    assert "5% of the time is without gyros (1 gap, the longest 1" in reason.text


def test_another_aircrafts_file_is_seen_by_weight_against_lift(flight: FlightSignals) -> None:
    heavy = replace(VEHICLE, mass=replace(VEHICLE.mass, mass=30.0 * VEHICLE.mass.mass))
    found = judged(flight, vehicle=heavy)
    assert found.verdict == POOR
    assert "another aircraft" in found.reasons[0].sentence
    assert all(one["verdict"] == POOR for one in found.to_json()["axes"].values())


@pytest.mark.parametrize("factor", [5.0, 0.1])
def test_another_aircrafts_file_is_seen_by_what_the_lift_gains_with_the_angle(
    factor: float, flight: FlightSignals
) -> None:
    """Where the lift that its weight asks for is one that aircraft fly with."""
    mass = replace(VEHICLE.mass, mass=factor * VEHICLE.mass.mass)
    found = judged(flight, vehicle=replace(VEHICLE, mass=mass))
    (reason,) = [one for one in found.reasons if "per radian of angle of attack" in one.text]
    assert (reason.verdict, "another aircraft" in reason.advice) == (POOR, True)


def test_a_mass_wrong_by_half_is_no_other_aircraft(flight: FlightSignals) -> None:
    """Nor is a vane that tells little, or one of another scale."""
    rng, alpha = np.random.default_rng(0), flight.signals["alpha"]
    noise = replace(alpha, values=np.std(alpha.values) * rng.standard_normal(alpha.values.size) / 100.0)
    bent = replace(alpha, values=0.7 * alpha.values)
    wrong = [replace(VEHICLE, mass=replace(VEHICLE.mass, mass=one * VEHICLE.mass.mass)) for one in (0.7, 1.5)]
    cases = [judged(flight, vehicle=one) for one in wrong] + [
        judged(changed(flight, alpha=one)) for one in (noise, bent)
    ]
    assert not [one for found in cases for one in found.reasons if "another aircraft" in one.advice]


def test_missing_vanes_rough_air_and_a_shaking_accelerometer_ask_for_care(flight: FlightSignals) -> None:
    az = flight.signals["az"]
    shaken = replace(az, values=az.values + 5.0 * np.random.default_rng(0).standard_normal(az.values.size))
    cases = {
        "no vane of the angle of attack": judged(changed(flight, alpha=None)),
        "gusts of 1.2 m/s": judged(flight, gusts=1.2),
        "az shakes by": judged(changed(flight, az=shaken)),
    }
    for words, found in cases.items():
        assert found.verdict == CARE, words
        assert any(words in one.text for one in found.reasons), words


def test_readings_at_the_end_of_the_range_are_told(flight: FlightSignals) -> None:
    az = flight.signals["az"]
    hit = az.values.copy()
    hit[200:210] = -4.0 * 9.80665
    found = judged(changed(flight, az=replace(az, values=hit)))
    assert any("az is cut off at 4.0 g, 10 times" in one.text for one in found.reasons)


def test_what_no_surface_flew_is_poor_and_does_not_spoil_the_rest() -> None:
    elevator = fly_mav("elevator-3211", 2)[0]
    found = judged(elevator)
    assert {axis: found.of_axis(axis) for axis in LATERAL} == dict.fromkeys(LATERAL, POOR)
    assert all(found.of_axis(axis) != POOR for axis in LONGITUDINAL)
    assert found.verdict != POOR
    assert judged(elevator, fly_mav("aileron-doublet,rudder-doublet", 2)[0]).not_flown == ()


def test_what_one_of_several_flights_moved_has_moved() -> None:
    aileron, rudder = (fly_mav(f"{name}-doublet", 2)[0] for name in ("aileron", "rudder"))
    assert any(one.text == "rudder did not move" for one in judged(aileron).reasons)
    texts = [one.text for one in judged(aileron, rudder).reasons]
    assert not any("did not move" in text or "move together" in text for text in texts)


def model(**values: tuple[float, float] | None) -> Model:
    return Model(
        "x", {n: Coefficient(None, refused="why") if v is None else Coefficient(*v) for n, v in values.items()}
    )


def with_model(found: Model, **more: object) -> Quality:
    before = with_no_aircraft(Quality((), AXES), found)
    given: dict[str, object] = {"feedback": {}, "misfit": "", "left_over": "", "mistakes": (), "validation": None}
    return with_estimate(before, SeenEstimate(model=found, refused=(), **{**given, **more}))  # type: ignore[arg-type]


def test_a_lift_slope_of_no_wing_and_a_damping_that_drives_are_too_poor() -> None:
    lift = with_model(model(CL_0=(0.3, 0.01), CL_alpha=(0.037, 0.002)))
    assert (lift.verdict, lift.axes) == (POOR, ("CL",))
    assert "no wing" in lift.reasons[0].text
    assert "another aircraft" in lift.reasons[0].advice
    roll = with_model(model(Cl_p=(0.4, 0.02), Cl_beta=(-0.1, 0.01), Cl_da=(-0.2, 0.01), CY_beta=(-0.5, 0.01)))
    assert (roll.of_axis("Cl"), roll.of_axis("CY"), roll.verdict) == (POOR, "good", CARE)
    assert all("no wing" in lift.refusal(axis) for axis in ("CL", "CD", "Cm"))
    assert (roll.refusal("Cl") != "", roll.refusal("CY")) == (True, "")
    unsure = with_model(model(Cl_p=(0.01, 0.02), Cl_beta=(-0.1, 0.01), Cl_da=(-0.2, 0.01)))
    assert unsure.of_axis("Cl") != POOR


def test_refused_and_loose_derivatives_ask_for_care_and_none_at_all_is_too_poor() -> None:
    part = with_model(model(Cm_alpha=(-0.8, 0.02), Cm_q=None, Cm_de=(-1.0, 0.4)))
    assert part.verdict == CARE
    assert {"Cm_q is refused", "poorly known: Cm_de to ±0.4"} == {one.text for one in part.reasons}
    assert with_model(model(Cm_alpha=None, Cm_q=None, Cm_de=None)).verdict == POOR


def test_what_a_flight_held_out_says_reaches_the_verdict() -> None:
    time = np.arange(0.0, 10.0, 0.02)
    z = np.sin(time)
    bad = validate({"Cm": z, "CL": z}, {"Cm": -z, "CL": z})
    found = with_model(model(Cm_alpha=(-0.8, 0.02), CL_alpha=(5.0, 0.1)), validation=bad)
    assert (found.of_axis("Cm"), found.of_axis("CL"), found.verdict) == (POOR, "good", CARE)


def test_several_reasons_of_one_kind_are_said_once() -> None:
    one = Quality((Reason(CARE, "slow"), Reason(POOR, "dead", "mend it")), AXES)
    assert [reason.sentence for reason in once([*one.reasons, *one.reasons])] == ["dead; mend it", "slow"]


def test_an_identification_carries_the_verdict_of_flight_and_estimate() -> None:
    flight = fly_mav(ALL, 3)[0]
    slow = {name: thinned(flight.signals[name], 2) for name in ("ax", "ay", "az", "p", "q", "r")}
    found = identify([changed(flight, **slow)], VEHICLE, systematic=False)
    assert found.quality.verdict == CARE
    assert any("25 Hz" in one.text for one in found.quality.reasons)


def test_what_one_flight_lacks_is_not_said_of_axes_that_another_flew() -> None:
    lateral = changed(fly_mav("aileron-doublet,rudder-doublet", 2)[0], beta=None)
    longitudinal = changed(fly_mav("elevator-3211", 2)[0], beta=None)
    slow = {name: thinned(longitudinal.signals[name], 3) for name in ("ax", "ay", "az", "p", "q", "r")}
    slowed = changed(longitudinal, **slow)
    both = judged(lateral, slowed)
    assert both.not_flown == ()
    assert not any("sideslip is reconstructed" in one.text for one in both.reasons)

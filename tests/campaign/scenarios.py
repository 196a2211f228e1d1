"""What the identification campaign flies, what it asks of each flight, and the bound of that flight."""

from __future__ import annotations

import sys
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from flight_bounds import (
    GPS,
    LATERAL_OUTPUTS,
    LONGITUDINAL_OUTPUTS,
    Experiment,
    bound_of,
    bounds,
    calm_information,
    slopes,
    true_model,
)
from gust_bounds import gust_information, gust_model, linear_path
from paper_tables import COEFFICIENTS, SENSORS
from simulated import signals_of

from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.problem.model_structure import default_structure
from sysid.signals.flight import FlightSignals
from sysid.signals.record import OUTPUTS

# Not the estimator's integration step, so that its error of integration counts as an error of the estimate.
STEP_S = 0.0021
GUST_LENGTH_M = 20.0
PULSE_RAD = np.radians(2.0)
# The bound in gusts takes longer than the estimate and differs little from flight to flight: it is computed for each
# so many of them.
GUST_BOUND_EVERY = 8


@dataclass(frozen=True)
class Scenario:
    """One kind of flight.

    plan: what is flown. vehicle: name of a bundled one. structure: coefficients asked for, None for the default ones.
    own_model: give the aircraft's own model as structure. sensors: errors asked for, None lets the flight decide.
    lateral: whether lateral motion is excited (in gusts the autopilot's ailerons do it). without: signals that the
    recording lacks. gust: sigma, m/s.
    """

    title: str
    plan: Plan
    vehicle: str = "iitb-mav"
    structure: tuple[str, ...] | None = None
    own_model: bool = False
    sensors: tuple[str, ...] | None = None
    lateral: bool = True
    without: tuple[str, ...] = ()
    gust: float = 0.0

    def asked(self) -> Model | None:
        """The structure that the estimator is given, None for its own."""
        if self.own_model:
            return read_model(self.vehicle)
        if self.structure is None:
            return None
        full = read_model(self.vehicle)
        return Model(full.name, {name: full.coefficients[name] for name in self.structure})


def _pulse_train() -> Plan:
    single = replace(manoeuvre("elevator-pulse"), duration=4.0)
    return Plan(tuple(replace(single, amplitude=sign * PULSE_RAD) for sign in (1.0, -1.0, 1.0, -1.0, 1.0)))


_ELEVATOR, _SIX_AXES = plan_of(["elevator-multisine"]), plan_of(["multisine"])
SCENARIOS: dict[str, Scenario] = {
    "pulse": Scenario(
        "paper's pulse, 10 s, paper's structure and sensor errors", plan_of(["elevator-pulse"]),
        structure=COEFFICIENTS, sensors=SENSORS, lateral=False,
    ),
    "train": Scenario("train of elevator pulses", _pulse_train(), lateral=False),
    "multisine": Scenario("elevator multisine", _ELEVATOR, lateral=False),
    "six-axis": Scenario("multisine on all surfaces", _SIX_AXES),
    "no-vanes": Scenario("multisine on all surfaces, no vanes", _SIX_AXES, without=("alpha", "beta")),
    "aerosonde": Scenario("multisine on all surfaces, Aerosonde", _SIX_AXES, "aerosonde", own_model=True),
    "ultrastick": Scenario("multisine on all surfaces, UltraStick 25e", _SIX_AXES, "ultrastick25e", own_model=True),
    "gusts": Scenario("multisine on all surfaces, gusts of 0.3 m/s", _SIX_AXES, gust=0.3),
    "gusts-elevator": Scenario("elevator multisine, gusts of 0.3 m/s", _ELEVATOR, gust=0.3),
}  # fmt: skip


def fly_scenario(scenario: Scenario, seed: int) -> tuple[FlightSignals, FlownFlight, Vehicle]:
    """One flight: sensors with every error of Table II, resolution included, commands in whole microseconds."""
    vehicle = load_vehicle(scenario.vehicle)
    model = read_model(scenario.vehicle)
    if scenario.gust:
        model = model.with_effect(*parse_effect(f"turbulence:sigma={scenario.gust}:length={GUST_LENGTH_M}"))
    generator = np.random.default_rng(seed)
    suite = SensorSuite(vehicle, generator=generator)
    flown = fly(Plant(vehicle, model, max_step=STEP_S), scenario.plan, suite=suite, generator=generator)
    signals = signals_of(flown, vehicle, f"seed {seed}")
    kept = {name: signal for name, signal in signals.signals.items() if name not in scenario.without}
    return FlightSignals(signals.name, kept), flown, vehicle


def experiment_of(scenario: Scenario, flown: FlownFlight, vehicle: Vehicle) -> Experiment:
    """What an efficient estimator could use of the flight."""
    full = read_model(scenario.vehicle)
    structure = scenario.structure or (
        tuple(full.coefficients) if scenario.own_model else default_structure(("de", "da", "dr"))
    )
    outputs = (*LONGITUDINAL_OUTPUTS, *(LATERAL_OUTPUTS if scenario.lateral else ()))
    # Velocity over ground tells of a motion that is free in all axes; with known lateral motion it would know the wind
    # through readings whose errors do not count.
    if scenario.lateral:
        outputs += tuple(name for name in GPS if name in OUTPUTS)
    measured = tuple(name for name in outputs if name not in scenario.without)
    return Experiment(flown, vehicle, true_model(full, structure), measured, scenario.lateral)


def true_values(scenario: Scenario, flown: FlownFlight) -> dict[str, float]:
    """Everything hidden from the estimator, by the names of its result; a coefficient that the aircraft lacks is 0."""
    structure = default_structure(("de", "da", "dr"))
    winds = ("wind_north", "wind_east", "wind_down")
    return dict.fromkeys((*structure, *winds), 0.0) | read_model(scenario.vehicle).values() | dict(flown.sensor_errors)


def bounds_of(
    scenario: Scenario, seed: int, flown: FlownFlight, vehicle: Vehicle, estimated: Collection[str]
) -> dict[str, float]:
    """Bound of every coefficient and sensor error, where the sensor errors in `estimated` are unknown.

    That of a sensor error which is not among them is for estimating it beside them. Empty in flights with gusts but for
    one of GUST_BOUND_EVERY.
    """
    if scenario.gust and seed % GUST_BOUND_EVERY:
        return {}
    experiment = experiment_of(scenario, flown, vehicle)
    told = slopes(experiment)
    if scenario.gust:
        dt = float(flown.time_s[1] - flown.time_s[0])
        gusts = gust_model(scenario.gust, GUST_LENGTH_M, vehicle.flight.airspeed, dt)
        information = gust_information(told, linear_path(experiment), gusts)
    else:
        information = calm_information(told)
    unknown = [*experiment.coefficients, *(name for name in experiment.errors if name in estimated)]
    found = bounds(told.names, information, unknown)
    candidates = scenario.sensors if scenario.sensors is not None else experiment.errors
    for name in candidates:
        if name in experiment.errors and name not in found:
            found[name] = bound_of(told.names, information, unknown, name)
    return found

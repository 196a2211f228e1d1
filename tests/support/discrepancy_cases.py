"""Flights with one effect (or two, or none) hidden from the discrepancy job, and the baseline it is handed.

A case is flown by the simulator with an integration step of its own, every error of Table II, resolution included, and
servos that lag in truth and baseline alike unless the lag is what is hidden. Half of the seeds fly in turbulence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from effect_sizes import Value, effect_text, values_at
from made_up import MADE_UP, MadeUpPlant
from separating_flights import PLANS
from simulated import signals_of

from sim_vehicle.effects import EFFECTS, Need, parse_effect
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly, wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.multisine import optimised_phases
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import CONTROLS, Segment
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightSignals

# Not the estimator's integration step, so that its error of integration counts as an error of the estimate.
STEP_S = 0.004
SERVO_LAG_S = 0.05
BASELINE_SHARE = 0.1
GUST_LENGTH_M = 20.0
GUSTS = (0.1, 0.2, 0.3)  # m/s
MOST_WIND = 2.0  # m/s
LENGTH_S = 20.0
# Throttle takes the slow harmonics that its motor follows; the surfaces share the rest up to 2.5 Hz.
_THROTTLE = (1, 3, 5, 8)
_SURFACES = tuple(n for n in range(2, 51) if n not in _THROTTLE)
HARMONICS = {axis: _SURFACES[i::3] for i, axis in enumerate(CONTROLS[:3])} | {"throttle": _THROTTLE}
AMPLITUDES = {"elevator": 0.035, "aileron": 0.035, "rudder": 0.05, "throttle": 0.19}
# What a flight without a thrust sensor does not record.
_OF_THRUST = ("thrust", "rpm", "adc5")


@dataclass(frozen=True)
class Kind:
    """A kind of flight.

    without: signals that are not recorded. elevator: share of the usual amplitude.
    """

    title: str
    without: tuple[str, ...] = ()
    elevator: float = 1.0


KINDS = {
    "multisine": Kind("multisine on all surfaces and throttle"),
    "no-thrust": Kind("the same, thrust known from the throttle alone", _OF_THRUST),
    "gentle": Kind("the same with a smaller elevator, so that a stall is met and left again", elevator=0.65),
}


@dataclass(frozen=True)
class Case:
    """One trial. effects: (name, share of the way from the least to the greatest size) of what is hidden.

    gust: sigma, m/s. exact: whether the baseline's coefficients are true. kind: of KINDS. made_up: of MADE_UP, physics
    that no catalogue holds. unlisted: whether the job's catalogue lacks the effects. also: of PLANS, flown as well.
    bench: the effect that a test on the ground has measured; it is in the baseline where it is there, else ruled out.
    """

    effects: tuple[tuple[str, float], ...]
    seed: int
    gust: float
    kind: str = "multisine"
    exact: bool = False
    made_up: str = ""
    unlisted: bool = False
    also: str = ""
    bench: str = ""

    @property
    def key(self) -> str:
        """Its name in files."""
        what = "+".join(f"{name}@{share:g}" for name, share in self.effects) or self.made_up or "none"
        extra = "/exact" * self.exact + "/unlisted" * self.unlisted + f"/{self.also}" * bool(self.also)
        extra += f"/bench {self.bench}" * bool(self.bench)
        return f"{what}/{self.kind}/{self.gust:g}{extra}/{self.seed}"

    @property
    def truth_key(self) -> str:
        """What the flight can tell depends on this alone, near enough."""
        return replace(self, unlisted=False, also="", bench="").key.rsplit("/", 1)[0]

    def values(self) -> dict[str, dict[str, Value]]:
        """Parameters of what is hidden, by effect."""
        return {name: values_at(name, share) for name, share in self.effects}


def kind_for(effect: str) -> str:
    """The kind of flight that shows an effect."""
    if Need.THRUST_BY_THROTTLE in EFFECTS[effect].needs:
        return "no-thrust"
    return "gentle" if effect == "stall" else "multisine"


def gust_for(seed: int) -> float:
    """Turbulence of the flights of a seed: none for even ones."""
    return 0.0 if seed % 2 == 0 else GUSTS[seed // 2 % len(GUSTS)]


def with_effects(model: Model, effects: Mapping[str, Mapping[str, Value]]) -> Model:
    """The model with these effects added."""
    for name, values in effects.items():
        model = model.with_effect(*parse_effect(effect_text(name, values)))
    return model


def true_model(case: Case, *, air: bool = True) -> Model:
    """The aircraft as it flies. air: with its turbulence."""
    model = with_effects(read_model("iitb-mav"), {"actuator_lag": {"tau": SERVO_LAG_S}} | case.values())
    if air and case.gust and not any(name == "turbulence" for name, _ in case.effects):
        model = with_effects(model, {"turbulence": {"sigma": case.gust, "length": GUST_LENGTH_M}})
    return model


def baseline_model(case: Case) -> Model:
    """What the job is handed: the truth without what is hidden, its coefficients off by up to BASELINE_SHARE."""
    model = off_by(structure(case), 0.0 if case.exact else BASELINE_SHARE, case.seed)
    return with_effects(model, {name: value for name, value in case.values().items() if name == case.bench})


def ruled_out(case: Case) -> tuple[str, ...]:
    """What a test on the ground has shown not to be there."""
    return (case.bench,) if case.bench and case.bench not in case.values() else ()


def structure(case: Case) -> Model:
    """The truth without what is hidden and without the air."""
    hidden = [name for name, _ in case.effects]
    terms = {p.name for name in hidden if EFFECTS[name].is_coefficient for p in EFFECTS[name].parameters}
    full = true_model(case, air=False)
    kept = {name: entry for name, entry in full.coefficients.items() if name not in terms}
    return replace(full, coefficients=kept, effects=tuple(e for e in full.effects if e.name not in hidden))


def off_by(model: Model, share: float, seed: int) -> Model:
    """The model with every coefficient off by up to `share` of itself."""
    generator = np.random.default_rng([seed, 7])
    for name, value in model.values().items():
        model = model.with_coefficient(name, value * (1.0 + share * generator.uniform(-1.0, 1.0)))
    return model


def plan_for(kind: str, *, held_out: bool, seed: int = 0) -> Plan:
    """The manoeuvres. held_out: the flight to judge by, which begins elsewhere in the period and turns signs around."""
    shift = 0.0
    size = 1.0
    if held_out:
        generator = np.random.default_rng([seed, 11])
        shift, size = float(generator.uniform(0.2, 0.8)), -0.85
    phases = {
        axis: tuple(
            phase + 2.0 * np.pi * n * shift for n, phase in zip(numbers, optimised_phases(numbers), strict=True)
        )
        for axis, numbers in HARMONICS.items()
    }
    multisine = Segment(
        "multisine", LENGTH_S + 3.0, length=LENGTH_S, axes=CONTROLS, harmonics=HARMONICS, phases=phases,
        amplitudes={
            axis: size * peak * (KINDS[kind].elevator if axis == "elevator" else 1.0)
            for axis, peak in AMPLITUDES.items()
        },
    )  # fmt: skip
    return Plan((multisine,))


def fly_case(
    case: Case, vehicle: Vehicle, *, held_out: bool = False, also: bool = False
) -> tuple[FlightSignals, FlownFlight]:
    """Fly one of the case's two flights, or the one flown as well: what a recording carries, and the truth."""
    generator = np.random.default_rng([case.seed, 2 if also else int(held_out)])
    if case.made_up:
        plant: Plant = MadeUpPlant(vehicle, true_model(case), MADE_UP[case.made_up])
    else:
        plant = Plant(vehicle, true_model(case), max_step=STEP_S)
    suite = SensorSuite(vehicle, generator=generator)
    speed, course = generator.uniform(0.0, MOST_WIND), generator.uniform(0.0, 2.0 * np.pi)
    wind = wind_of(plant, (float(speed * np.cos(course)), float(speed * np.sin(course)), 0.0))
    plan = PLANS[case.also] if also else plan_for(case.kind, held_out=held_out, seed=case.seed)
    flown = fly(plant, plan, suite=suite, generator=generator, wind=wind)
    signals = signals_of(flown, vehicle, "also" if also else "judge" if held_out else "fit")
    kept = {name: signal for name, signal in signals.signals.items() if name not in KINDS[case.kind].without}
    return FlightSignals(signals.name, kept), flown


def fly_calm(case: Case, vehicle: Vehicle, model: Model) -> FlownFlight:
    """The case's flight to fit, flown by a model in still air: what the truth's sensitivities are taken at."""
    suite = SensorSuite(vehicle, generator=np.random.default_rng(0), noise="none")
    plan = plan_for(case.kind, held_out=False)
    return fly(Plant(vehicle, model, max_step=STEP_S), plan, suite=suite, generator=np.random.default_rng(0))


def off_by_values(case: Case) -> dict[str, float]:
    """Baseline less truth, by coefficient."""
    true = structure(case).values()
    return {name: value - true[name] for name, value in baseline_model(case).values().items()}


def the_vehicle() -> Vehicle:
    """The aircraft of every case."""
    return load_vehicle("iitb-mav")

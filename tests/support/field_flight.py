"""Test flights as the field has them: an aircraft in JSBSim, its servos, air, sensors and links, and the truth.

A family and a seed determine a flight. Sizes come from the literature and from what such parts are sold with, chosen
before any estimate was looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from field_air import Air
from field_inputs import inputs_of
from field_plant import SURFACES, Hold, Log, Servo, fly_field
from field_sensors import Field, sense
from field_truth import truth_of
from jsbsim_flight import linear_aircraft, table_aircraft

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals

FAMILIES = ("mild", "typical", "rough", "short", "closed-loop", "slow", "odd", "stock")
MICROSECOND = 0.436 / 500.0  # rad of one, by the vehicle file
# Natural frequency, Hz, with which a vane of damping 0.7 lags 60 ms: 2 damping / omega.
VANE_LAG_HZ = 2.0 * 0.7 / (2.0 * np.pi * 0.060)
LONGITUDINAL = ("CL_alpha", "CL_de", "CD_k", "Cm_alpha", "Cm_q", "Cm_de")
LATERAL = (
    *("CY_beta", "Cl_beta", "Cl_p", "Cl_r", "Cn_beta", "Cn_p", "Cn_r"),
    *("CY_dr", "Cl_da", "Cl_dr", "Cn_da", "Cn_dr"),
)


@dataclass(frozen=True)
class FieldFlight:
    """One flight: what is recorded, what the estimator is told of the aircraft, and the truth.

    truth: coefficient -> smallest and largest value that is right. excited: coefficients that its inputs can tell.
    seconds: length of the flight.
    """

    signals: FlightSignals
    vehicle: Vehicle
    truth: dict[str, tuple[float, float]]
    excited: tuple[str, ...]
    seconds: float
    log: Log


@dataclass(frozen=True)
class Plan:
    """What a family draws for one flight. wrong: share of the vehicle file's errors (see `told`)."""

    kind: str
    seconds: float
    servo: Servo
    air: Air
    hold: Hold
    field: Field
    wrong: float
    surfaces: tuple[str, ...] = SURFACES
    size: float = 1.0


def plan_of(family: str, seed: int) -> Plan:
    """The flight's draw."""
    g = np.random.default_rng([seed, 21, FAMILIES.index(family)])
    strength = {"mild": 0.4, "rough": 1.7}.get(family, 1.0)
    kind = str(g.choice(["multisine", "doublet", "3211"]))
    seconds = {"short": g.uniform(8.0, 12.0), "closed-loop": g.uniform(60.0, 300.0)}.get(family, g.uniform(25.0, 60.0))
    rough = min(strength, 1.2)
    servo = Servo(
        delay=g.uniform(0.02, 0.06) if strength >= 1.0 else 0.02,
        lag=g.uniform(0.02, 0.05) * rough,
        backlash=float(np.radians(g.uniform(0.05, 0.15))) * strength,
        rate_limit=6.0 if strength > 1.0 else 0.0,
        droop=float(np.random.default_rng([seed, 24, FAMILIES.index(family)]).uniform(0.0, 0.04)) * rough,
    )
    air = Air(
        gust=g.uniform(0.3, 0.8) * strength,
        length=g.uniform(50.0, 150.0),
        rolling=1.0,
        wind=tuple(g.uniform(-4.0, 4.0, 2).tolist()),
        wander=0.4 * strength,
        thermal=g.uniform(0.0, 1.0) * strength,
    )
    hold = Hold(hz=250.0 if g.uniform() < 0.5 else 50.0)
    field = sensors_of(g, strength)
    plan = Plan(kind, float(seconds), servo, air, hold, field, 0.0 if family == "mild" else 0.5 * strength)
    if family == "closed-loop":
        hold = Hold(0.35, 0.40, 0.06, 0.08, 0.10, plan.hold.hz)
        return replace(plan, kind="hold", hold=hold)
    if family == "slow":
        return replace(plan, seconds=float(g.uniform(40.0, 90.0)), field=at_rate(field, 10.0))
    if family == "odd":
        return _odd(plan, seed)
    return plan


# Aircraft that come with JSBSim, textbook sensors and surfaces as measured, all at one rate, Hz.
STOCK_RATES = {f"stock-{rate}-hz": float(rate) for rate in (20, 50, 100)}

# Textbook flights with one imperfection each: what it is, of the plant or of the sensors.
STEPS: dict[str, dict[str, Any]] = {
    "textbook": {},
    "servo-lag": {"servo": Servo(lag=0.040)},
    "vane-lag": {"field": {"vane_hz_natural": VANE_LAG_HZ, "vane_damping": 0.7}},
    "servo-and-vane-lag": {
        "servo": Servo(lag=0.040),
        "field": {"vane_hz_natural": VANE_LAG_HZ, "vane_damping": 0.7},
    },
    "command-delay": {"servo": Servo(delay=0.030)},
    "stamps": {"field": {"vane_offset": 0.007}},
}


def at_rate(field: Field, hz: float) -> Field:
    """The same with every message at one rate."""
    names = ("imu_hz", "vane_hz", "airspeed_hz", "attitude_hz", "command_hz", "thrust_hz")
    return replace(field, **dict.fromkeys(names, hz))


def textbook() -> Field:
    """Sensors of the reference paper's Table II, without their biases."""
    return Field(
        force_noise=0.0785,
        rate_noise=float(np.radians(0.03)),
        vane_noise=float(np.radians(0.3)),
        attitude_noise=float(np.radians(0.05)),
        airspeed_noise=0.02,
        thrust_noise=0.02,
        gps_noise=0.1,
    )


def step_plan(step: str, seed: int) -> Plan:
    """A textbook flight with one imperfection of STEPS; "+gusts" behind its name adds gusts."""
    name, _, gusts = step.partition("+")
    change = STEPS[name]
    return Plan(
        "multisine",
        30.0,
        change.get("servo", Servo()),
        Air(gust=0.6, rolling=1.0) if gusts else Air(),
        Hold(hz=50.0),
        replace(textbook(), **change.get("field", {})),
        0.0,
    )


def sensors_of(g: np.random.Generator, strength: float) -> Field:
    """Sensors of a small autopilot; strength 1 is the usual."""
    rate = float(g.choice([25.0, 50.0])) if strength >= 1.0 else 50.0
    other = float(g.choice([10.0, 25.0, 50.0])) if strength >= 1.0 else 50.0
    sign = g.choice([-1.0, 1.0], 4)
    return Field(
        imu_hz=rate,
        vane_hz=max(other, 25.0) if strength <= 1.0 else other,
        airspeed_hz=other,
        attitude_hz=max(other, 25.0),
        command_hz=rate,
        thrust_hz=other,
        vane_offset=float(g.normal(0.0, 0.015)) * strength,
        airspeed_offset=float(g.normal(0.0, 0.02)) * strength,
        attitude_offset=float(g.normal(0.0, 0.01)) * strength,
        command_offset=float(g.normal(0.0, 0.004)) * strength,
        phases=True,
        jitter=0.001 * strength,
        bursts=1.0 if strength > 1.0 else 0.3 if strength == 1.0 else 0.0,
        filter_hz=float(g.uniform(18.0, 40.0)),
        vibration=float(g.uniform(0.3, 1.5)) * strength,
        line_hz=float(g.uniform(70.0, 110.0)),
        force_noise=0.06,
        force_bias=0.10 * strength,
        force_drift=0.02 * strength,
        rate_noise=0.003,
        rate_bias=0.003 * strength,
        rate_drift=0.001 * strength,
        cross_axis=0.01 * strength,
        g_sensitivity=1e-4 * strength,
        attitude_noise=0.001,
        attitude_error=float(np.radians(0.7)) * strength,
        attitude_correlation=float(g.uniform(5.0, 20.0)),
        attitude_lag=0.01 * strength,
        attitude_lean=0.05 * strength,
        vane_hz_natural=float(g.uniform(5.0, 12.0)),
        vane_damping=float(g.uniform(0.2, 0.5)),
        vane_scale=float(sign[0] * g.uniform(0.0, 0.10)) * min(strength, 1.2),
        vane_bias=float(np.radians(0.5)) * strength,
        vane_friction=float(np.radians(0.1)) * strength,
        vane_noise=float(np.radians(0.15)),
        airspeed_scale=float(sign[1] * g.uniform(0.0, 0.02)) * strength,
        position_error=float(sign[2] * g.uniform(0.0, 0.10)) * strength,
        pneumatic_lag=float(g.uniform(0.03, 0.15)) * min(strength, 1.0),
        airspeed_noise=0.1,
        airspeed_coloured=0.15 * strength,
        gps_delay=0.2,
        gps_noise=0.1,
        pulse=MICROSECOND,
        thrust_scale=float(sign[3] * g.uniform(0.0, 0.10)) * min(strength, 1.0) if strength >= 1.0 else 0.0,
        thrust_noise=0.03,
    )


def _odd(plan: Plan, seed: int) -> Plan:
    """A dead vane, channels of zeros, one axis left alone: in turn."""
    kinds: tuple[Plan, ...] = (
        replace(plan, field=replace(plan.field, dead=("beta",))),
        replace(plan, field=replace(plan.field, zeros=("ay",))),
        replace(plan, surfaces=("de",)),
        replace(plan, field=replace(plan.field, zeros=("p", "r")), surfaces=("de",)),
        replace(plan, field=replace(plan.field, dead=("alpha",))),
    )
    return kinds[seed % len(kinds)]


def told(vehicle: Vehicle, share: float, seed: int) -> Vehicle:
    """What the estimator is told: at share 1 mass up to 2 %, inertias 8 %, the centre of gravity 5 mm off."""
    g = np.random.default_rng([seed, 22])
    mass = vehicle.mass
    off = {"mass": 0.02, "Ixx": 0.08, "Iyy": 0.08, "Izz": 0.08}
    wrong = {key: getattr(mass, key) * (1.0 + share * size * float(g.uniform(-1.0, 1.0))) for key, size in off.items()}
    known = {f.name for f in fields(mass)}
    doubt = {f"{key}_std": share * size * getattr(mass, key) / np.sqrt(3.0) for key, size in off.items()}
    shift = share * 0.005 * g.uniform(-1.0, 1.0, 3)
    moved = {}
    for key in vehicle.sensors.firsts():
        sensor = vehicle.sensors[key]
        moved[key] = replace(sensor, position=tuple((np.array(sensor.position) + shift).tolist()))
    return replace(
        vehicle,
        mass=replace(mass, **wrong, **{key: value for key, value in doubt.items() if key in known}),
        sensors=replace(vehicle.sensors, **moved),
    )


def field_flight(family: str, seed: int, folder: Path) -> FieldFlight:
    """Fly one flight of a family; `folder` takes JSBSim's files."""
    if family == "stock" or family in STOCK_RATES:
        from field_stock import stock_flight

        return stock_flight(seed, STOCK_RATES.get(family))
    if family.startswith("step/"):
        return fly_plan(step_plan(family.removeprefix("step/"), seed), seed, folder, f"{family}-{seed}")
    return fly_plan(plan_of(family, seed), seed, folder, f"{family}-{seed}")


def fly_plan(plan: Plan, seed: int, folder: Path, name: str) -> FieldFlight:
    """Fly what was drawn, with the linear aircraft and the one of tables in turn."""
    aircraft = table_aircraft() if seed % 2 else linear_aircraft()
    generator = np.random.default_rng([seed, 23])
    inputs = inputs_of(plan.kind, plan.seconds, generator, plan.surfaces, plan.size)
    log = fly_field(folder, aircraft, inputs, seed, servo=plan.servo, air=plan.air, hold=plan.hold)
    vehicle = told(aircraft.vehicle, plan.wrong, seed)
    excited = (*(LONGITUDINAL if "de" in plan.surfaces else ()), *(LATERAL if "da" in plan.surfaces else ()))
    signals = sense(log, aircraft.vehicle, plan.field, seed, name)
    return FieldFlight(signals, vehicle, truth_of(log, aircraft), excited, float(log.time_s[-1]), log)

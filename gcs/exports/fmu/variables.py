"""The FMU's variables, in the order of their value references: inputs, parameters, coefficients, outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gcs.exports.exported import Exported, described
from sim_vehicle.flight.plant import OUTPUTS as MOTION
from sim_vehicle.flight.plant import Plant
from sim_vehicle.physics.layout import U
from sim_vehicle.physics.rotation import euler_angles
from sim_vehicle.vehicle.propulsion import rotor_scale

# Outputs are those of the simulator, less what an FMU has as inputs or would only repeat.
_NOT_SHOWN = frozenset({"de", "da", "dr", "throttle", "rpm", "rho", "p_dot", "q_dot", "r_dot"})
OUTPUTS = tuple(name for name in MOTION if name not in _NOT_SHOWN)
_WORDS = {
    "V": "airspeed", "alpha": "angle of attack", "beta": "sideslip", "p": "roll rate", "q": "pitch rate",
    "r": "yaw rate", "phi": "roll angle", "theta": "pitch angle", "psi": "heading", "thrust": "thrust",
    **{f"a{axis}": f"specific force along {axis}" for axis in "xyz"},
    **{name: f"position {name}" for name in ("north", "east", "down")},
    **{f"v{word[0]}": f"velocity over ground, {word}" for word in ("north", "east", "down")},
    "CL": "lift coefficient", "CD": "drag coefficient", "CY": "side force coefficient",
    "Cl": "rolling moment coefficient", "Cm": "pitching moment coefficient", "Cn": "yawing moment coefficient",
}  # fmt: skip
_UNITS = {
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), "rad"), **dict.fromkeys("pqr", "rad/s"),
    **dict.fromkeys(("V", "vn", "ve", "vd"), "m/s"), **dict.fromkeys(("ax", "ay", "az"), "m/s2"),
    **dict.fromkeys(("north", "east", "down"), "m"), "thrust": "N",
}  # fmt: skip
# Effect parameters that are variables: value reference's name in the source, and the unit.
OF_EFFECTS = {
    "mass_error.scale": ("V_MASS_ERROR", ""), "inertia_error.scale": ("V_INERTIA_ERROR", ""),
    "cg_shift.x": ("V_CG_SHIFT", "m"), "thrust_scale.scale": ("V_THRUST_SCALE", ""),
    "thrust_speed_loss.dT_dV": ("V_THRUST_BY_SPEED", "N.s/m"), "thrust_line_offset.z_T": ("V_THRUST_LINE", "m"),
    "propwash_elevator.k": ("V_PROPWASH", ""), "elastic_tail.k": ("V_ELASTIC_TAIL", ""),
    "reynolds_drag.n": ("V_REYNOLDS", ""), "actuator_lag.tau": ("V_ACTUATOR_LAG", "s"),
    "stall.alpha_stall": ("V_STALL_ALPHA", "rad"), "stall.sharpness": ("V_STALL_SHARPNESS", ""),
}  # fmt: skip
# The largest integration step, s.
_STEP_S = 0.0025


@dataclass(frozen=True)
class Variable:
    """name: dotted, as FMI's naming convention has it. symbol: its place's name in the source. start: None of an
    output.
    """

    name: str
    symbol: str
    causality: str
    start: float | None
    unit: str = ""
    words: str = ""
    std: float | None = None


def variables(model: Exported, effects: Mapping[str, Mapping[str, float]]) -> list[Variable]:
    """All of a model's variables; the flight begins trimmed at the vehicle file's airspeed and height."""
    vehicle = model.vehicle
    known = {name: entry for name, entry in model.model.coefficients.items() if entry.value is not None}
    flown = tuple(one for one in model.model.effects if one.name in effects)
    trim = Plant(vehicle, replace(model.model, coefficients=known, effects=flown)).trim()
    x, command = trim.state.x, trim.command
    phi, theta, psi = euler_angles(*x[6:10])
    mass, geometry, environment, propulsion = vehicle.mass, vehicle.geometry, vehicle.environment, vehicle.propulsion
    assert propulsion is not None  # a Plant has one
    surfaces = ("elevator deflection", "aileron deflection", "rudder deflection", "throttle, 0 to 1")
    found = [
        Variable(name, f"V_{name.upper()}", "input", float(value), "" if name == "throttle" else "rad", words)
        for name, value, words in zip(("de", "da", "dr", "throttle"), command, surfaces, strict=True)
    ]
    found += [
        Variable(
            name, "" if place else "V_NAMED", "input", 0.0, "", f"deflection of {name}, as the vehicle file has it"
        )
        for place, name in enumerate(vehicle.named_controls)
    ]
    found += [
        Variable(f"wind.{one}", f"V_WIND_{one.upper()}", "input", 0.0, "m/s", f"velocity of the air, {one}")
        for one in ("north", "east", "down")
    ]
    start = {
        "north": (x[0], "m"), "east": (x[1], "m"), "down": (x[2], "m"), "u": (x[U], "m/s"), "v": (x[U + 1], "m/s"),
        "w": (x[U + 2], "m/s"), "phi": (phi, "rad"), "theta": (theta, "rad"), "psi": (psi, "rad"),
        "p": (x[10], "rad/s"), "q": (x[11], "rad/s"), "r": (x[12], "rad/s"),
    }  # fmt: skip
    found += [
        Variable(
            f"start.{name}", f"V_START_{name.upper()}", "parameter", float(value), unit, f"{name} at the beginning"
        )
        for name, (value, unit) in start.items()
    ]
    constants = [
        ("mass", "V_MASS", mass.mass, "kg", ""),
        *((name, f"V_{name.upper()}", getattr(mass, name), "kg.m2", "") for name in ("Ixx", "Iyy", "Izz", "Ixz")),
        ("S", "V_S", geometry.S, "m2", "wing area"), ("b", "V_B", geometry.b, "m", "wing span"),
        ("c", "V_C", geometry.c, "m", "chord"), ("gravity", "V_GRAVITY", environment.gravity, "m/s2", ""),
        ("air_density", "V_AIR_DENSITY", environment.air_density or 0.0, "kg/m3",
         "0: that of the standard atmosphere at the height -down"),
        ("max_thrust", "V_MAX_THRUST", propulsion.max_thrust or 0.0, "N", "where no curve gives the thrust"),
        ("propeller.diameter", "V_DIAMETER", propulsion.diameter or 0.0, "m", ""),
        ("propeller.full_revolutions", "V_FULL_REVOLUTIONS", rotor_scale(propulsion) / (2.0 * math.pi), "1/s",
         "at full throttle"),
        ("motor_lag.tau", "V_MOTOR_LAG", effects.get("motor_lag", {}).get("tau", propulsion.tau), "s", ""),
        ("max_step", "V_MAX_STEP", _STEP_S, "s", "largest integration step within a communication step"),
    ]  # fmt: skip
    found += [
        Variable(name, symbol, "parameter", float(value), unit, words) for name, symbol, value, unit, words in constants
    ]
    stds = {name: entry.std for name, entry in model.estimates.items()}
    for name, (symbol, unit) in OF_EFFECTS.items():
        effect, _, parameter = name.partition(".")
        value = effects.get(effect, {}).get(parameter, 0.0)
        found.append(Variable(name, symbol, "parameter", value, unit, described(name), stds.get(name)))
    found += [
        Variable(name, "", "parameter", value, "", described(name), stds.get(name))
        for name, value in model.model.flown().items()
    ]
    return [*found, *(Variable(name, "", "output", None, _UNITS.get(name, ""), _WORDS[name]) for name in OUTPUTS)]


def by_causality(found: Sequence[Variable], causality: str) -> list[int]:
    """Value references of the variables of a causality."""
    return [place for place, one in enumerate(found) if one.causality == causality]

"""The catalogue of effects, and the flat vector in which the compiled code finds their parameters."""

from __future__ import annotations

from collections.abc import Mapping

from sim_vehicle.effects import (
    actuator,
    elastic_tail,
    environment,
    inertia,
    motor_lag,
    propeller,
    propwash_elevator,
    reynolds_drag,
    sensor,
    stall,
    thrust_line_offset,
    thrust_scale,
    thrust_speed_loss,
    unsteady_lift,
)
from sim_vehicle.effects.base import CoefficientEffect, Effect, Parameter, Stage
from sim_vehicle.effects.coefficient import COEFFICIENT_EFFECTS
from sim_vehicle.errors import ModelFileError

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        *COEFFICIENT_EFFECTS,
        stall.STALL,
        propwash_elevator.PROPWASH_ELEVATOR,
        elastic_tail.ELASTIC_TAIL,
        reynolds_drag.REYNOLDS_DRAG,
        unsteady_lift.UNSTEADY_LIFT,
        thrust_line_offset.THRUST_LINE_OFFSET,
        thrust_speed_loss.THRUST_SPEED_LOSS,
        thrust_scale.THRUST_SCALE,
        motor_lag.MOTOR_LAG,
        propeller.PROPELLER_TORQUE,
        propeller.P_FACTOR,
        propeller.PROPELLER_GYROSCOPIC,
        propeller.PROPELLER_NORMAL_FORCE,
        actuator.ACTUATOR_LAG,
        actuator.ACTUATOR_RATE_LIMIT,
        actuator.ACTUATOR_DELAY,
        actuator.ACTUATOR_BACKLASH,
        actuator.ELEVATOR_GAIN,
        sensor.VANE_LAG,
        sensor.VANE_UPWASH,
        sensor.VANE_RATE_ERROR,
        sensor.AIRSPEED_ERROR,
        sensor.PITOT_LAG,
        sensor.ACCELEROMETER_MISALIGNMENT,
        sensor.ACCELEROMETER_OFFSET,
        sensor.IMU_SCALE,
        sensor.ATTITUDE_LAG,
        environment.STEADY_WIND,
        environment.TURBULENCE,
        environment.WIND_SHEAR,
        environment.DENSITY_ERROR,
        inertia.MASS_ERROR,
        inertia.INERTIA_ERROR,
    )
}


def _lay_out() -> tuple[dict[tuple[str, str], int], int]:
    slots: dict[tuple[str, str], int] = {}
    for effect in EFFECTS.values():
        if effect.is_coefficient:
            continue
        for name in ("on", *(parameter.name for parameter in effect.parameters)):
            slots[effect.name, name] = len(slots)
    return slots, len(slots)


_SLOTS, SLOT_COUNT = _lay_out()


def slot(effect: str, parameter: str = "on") -> int:
    """Index in the effect vector of a parameter, or of the switch that says whether the effect is present."""
    return _SLOTS[effect, parameter]


def effect_called(name: str) -> Effect:
    """The effect of that name; ModelFileError lists the names there are."""
    if name not in EFFECTS:
        raise ModelFileError(f"unknown effect {name!r}; known are {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


def parse_effect(text: str) -> tuple[Effect, dict[str, float]]:
    """Read `NAME` or `NAME:KEY=VALUE[,KEY=VALUE]` (commas or colons between pairs).

    Returns the effect and its complete parameter values. Raises ModelFileError in one line otherwise.
    """
    name, _, rest = text.partition(":")
    effect = effect_called(name.strip())
    values: dict[str, float] = {}
    for pair in filter(None, rest.replace(":", ",").split(",")):
        key, equals, number = pair.partition("=")
        try:
            values[key.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals:
            raise ModelFileError(f"effect {text!r}: {pair!r} is not KEY=NUMBER")
    return effect, effect.complete(values)


def pack_effects(effects: Mapping[str, Mapping[str, float]]) -> list[float]:
    """The effect vector (SLOT_COUNT values) for effects given as name -> parameter -> value."""
    vector = [0.0] * SLOT_COUNT
    for name, values in effects.items():
        if EFFECTS[name].is_coefficient:
            continue
        vector[slot(name)] = 1.0
        for key, value in values.items():
            vector[slot(name, key)] = value
    return vector


__all__ = [
    "EFFECTS",
    "SLOT_COUNT",
    "CoefficientEffect",
    "Effect",
    "Parameter",
    "Stage",
    "effect_called",
    "pack_effects",
    "parse_effect",
    "slot",
]

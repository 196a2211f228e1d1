"""The catalogue of effects, and the flat vector in which the compiled code finds their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from sim_vehicle.effects import (
    actuator,
    battery_sag,
    cg_shift,
    configuration_step,
    elastic_tail,
    environment,
    ground_effect,
    inertia,
    linkage,
    mass_drop,
    motor_lag,
    propeller,
    propwash_elevator,
    reynolds_drag,
    sensor,
    sensor_time_skew,
    stall,
    thrust_line_offset,
    thrust_scale,
    thrust_sensor_hysteresis,
    thrust_speed_loss,
    unsteady_lift,
    wind_shear,
)
from sim_vehicle.effects.base import CoefficientEffect, Effect, Need, Parameter, Remembers, Stage
from sim_vehicle.effects.coefficient_effects import COEFFICIENT_EFFECTS
from sim_vehicle.effects.confusable_effects import CONFUSIONS
from sim_vehicle.errors import ModelFileError

EFFECTS: dict[str, Effect] = {
    effect.name: replace(effect, separations=tuple(CONFUSIONS.get(effect.name, {}).items()))
    for effect in (
        *COEFFICIENT_EFFECTS,
        stall.STALL,
        propwash_elevator.PROPWASH_ELEVATOR,
        elastic_tail.ELASTIC_TAIL,
        reynolds_drag.REYNOLDS_DRAG,
        unsteady_lift.UNSTEADY_LIFT,
        configuration_step.CONFIGURATION_STEP,
        ground_effect.GROUND_EFFECT,
        thrust_line_offset.THRUST_LINE_OFFSET,
        thrust_speed_loss.THRUST_SPEED_LOSS,
        thrust_scale.THRUST_SCALE,
        motor_lag.MOTOR_LAG,
        battery_sag.BATTERY_SAG,
        propeller.PROPELLER_TORQUE,
        propeller.P_FACTOR,
        propeller.PROPELLER_GYROSCOPIC,
        propeller.PROPELLER_NORMAL_FORCE,
        actuator.ACTUATOR_LAG,
        actuator.ACTUATOR_RATE_LIMIT,
        actuator.ACTUATOR_DELAY,
        actuator.ACTUATOR_BACKLASH,
        actuator.ELEVATOR_GAIN,
        linkage.LINKAGE_NONLINEARITY,
        linkage.SERVO_DEADBAND,
        sensor.VANE_LAG,
        sensor.VANE_UPWASH,
        sensor.VANE_RATE_ERROR,
        sensor.AIRSPEED_ERROR,
        sensor.PITOT_LAG,
        sensor.ACCELEROMETER_MISALIGNMENT,
        sensor.ACCELEROMETER_OFFSET,
        sensor.IMU_SCALE,
        sensor.ATTITUDE_LAG,
        sensor_time_skew.SENSOR_TIME_SKEW,
        thrust_sensor_hysteresis.THRUST_SENSOR_HYSTERESIS,
        environment.STEADY_WIND,
        environment.TURBULENCE,
        wind_shear.WIND_SHEAR,
        environment.DENSITY_ERROR,
        inertia.MASS_ERROR,
        mass_drop.MASS_DROP,
        inertia.INERTIA_ERROR,
        cg_shift.CG_SHIFT,
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


_SLOTS, _OWN = _lay_out()
# Effects by which sensors lag, each by a lag of the first order of its own, and the readings that they act on.
SENSOR_LAGS = {one.name: one.outputs for one in EFFECTS.values() if one.memory is Remembers.LAG and one.outputs}
# Behind the effects' own: the time at the first sample that is flown, s from the flight's first stamp.
START_TIME = _OWN
# And how measured thrust changes where the motion's airspeed is another than the one it was measured at: about this
# airspeed [m/s], by so much per m/s [N s/m], and by so much more per square of it [N s2/m2].
THRUST_AIRSPEED, THRUST_SLOPE, THRUST_BEND = _OWN + 1, _OWN + 2, _OWN + 3
SLOT_COUNT = _OWN + 4


def slot(effect: str, parameter: str = "on") -> int:
    """Index in the effect vector of a parameter, or of the switch that says whether the effect is present."""
    return _SLOTS[effect, parameter]


def effect_called(name: str) -> Effect:
    """The effect of that name; ModelFileError lists the names there are."""
    if name not in EFFECTS:
        raise ModelFileError(f"unknown effect {name!r}; known are {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


def parse_effect(text: str) -> tuple[Effect, dict[str, float]]:
    """Read `NAME` or `NAME:KEY=VALUE[,KEY=VALUE]` (commas or colons between pairs; some values are names).

    Returns the effect and its complete parameter values. Raises ModelFileError in one line otherwise.
    """
    name, _, rest = text.partition(":")
    effect = effect_called(name.strip())
    choices = {parameter.name for parameter in effect.parameters if parameter.choices}
    values: dict[str, float | str] = {}
    for pair in filter(None, rest.replace(":", ",").split(",")):
        key, equals, given = (part.strip() for part in pair.partition("="))
        if equals and key in choices:
            values[key] = given
            continue
        try:
            values[key] = float(given)
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
    "SENSOR_LAGS",
    "SLOT_COUNT",
    "START_TIME",
    "THRUST_AIRSPEED",
    "THRUST_BEND",
    "THRUST_SLOPE",
    "CoefficientEffect",
    "Effect",
    "Need",
    "Parameter",
    "Remembers",
    "Stage",
    "effect_called",
    "pack_effects",
    "parse_effect",
    "slot",
]

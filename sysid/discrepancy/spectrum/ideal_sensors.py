"""Flights of the textbooks; flights as the field gives them: servos with a delay or a lag, no force with white noise.

What a textbook's aircraft does not have is no unknown of it, so that a lag, a play or a delay is an effect like others.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from sim_vehicle.vehicle.controls import Control
from sim_vehicle.vehicle.sensors import Sensor
from sim_vehicle.vehicle.strict_toml import NOT_SAID, Known
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.posterior.estimates import NuisanceEstimate, PosteriorEstimate
from sysid.posterior.nuisance_priors import AIRSPEED_SCALE
from sysid.posterior.reported_spectrum import NoiseSpectrum

# A servo's lag and delay, s, and half its play, rad, from which on they are none of a textbook: a delay of more than
# half a sample of commands that are held; small servos in small linkages have twice of such a play.
_LEAST = {"servo_lag": 0.005, "servo_delay": 0.012, "servo_backlash": 2e-4}
_SEEN = 3.0  # standard errors
# Outputs that a gust, a vibration and a filter colour first, and the logarithm of the largest over the smallest density
# (95 and 5 % of the frequencies) that white noise stays below: up to 0.6 in textbook gusts, 0.7 and more of an
# autopilot's sensors.
_FORCES, _WHITE = ("ax", "ay"), 0.65
# Nuisance -> the part that does it and what its vehicle file calls it.
_OF_PARTS = {
    "servo_lag": ("controls", "lag"), "servo_delay": ("controls", "delay"), "servo_backlash": ("controls", "backlash"),
    "vane_clock": ("vanes", "delay"), AIRSPEED_SCALE: ("airspeed", "scale"),
}  # fmt: skip
# Standard deviations of what is usual, from which on something is not.
_UNUSUAL = 3.0
_NONE = Known(0.0, 0.0)
Part = TypeVar("Part", Control, Sensor)


def has_actuator_lag_and_coloured_noise(found: PosteriorEstimate) -> bool:
    """Whether in a group of axes servos have a delay, a lag or play, and no force leaves white noise in either.

    One thing alone may be what a model lacks; a flight with both is none of the textbooks, whatever the model lacks. In
    the group that lacks something nothing is known of servos.
    """
    white = any(one.output in _FORCES and _spread(one) < _WHITE for one in found.noise)
    return not white and any(_has_actuator_nuisance(one) for one in found.nuisances)


def beyond_usual(found: PosteriorEstimate) -> frozenset[str]:
    """Names of what servos, vanes and the pitot were found to do that their kind does not: such a thing is an effect,
    and not what every aircraft has.
    """
    names = set()
    for group in found.groups.values():
        model, result = group.posterior.model, group.result
        for i, one in enumerate(model.unknowns, len(model.parameters)):
            std = float(np.sqrt(result.covariance[i, i]))
            if one.name in _OF_PARTS and abs(result.theta[i] - one.mean) > _UNUSUAL * one.std and std < 0.5 * one.std:
                names.add(one.name)
    return frozenset(names)


def without_nuisances(vehicle: Vehicle, names: Collection[str]) -> Vehicle:
    """The vehicle whose servos, vanes and pitot do none of these, where its file says nothing else."""
    of_controls = [_OF_PARTS[name][1] for name in names if _OF_PARTS[name][0] == "controls"]
    of_vanes = [_OF_PARTS[name][1] for name in names if _OF_PARTS[name][0] == "vanes"]
    sensors = vehicle.sensors
    if AIRSPEED_SCALE in names:
        sensors = replace(sensors, airspeed=replace(sensors.airspeed, scale_std=sensors.airspeed.scale_std or 0.0))
    sensors = replace(
        sensors, alpha_vane=_exact(sensors.alpha_vane, *of_vanes), beta_vane=_exact(sensors.beta_vane, *of_vanes)
    )
    controls = {name: _exact(one, *of_controls) for name, one in vehicle.controls.items()}
    return replace(vehicle, controls=controls, sensors=sensors)


def with_ideal_sensors(vehicle: Vehicle) -> Vehicle:
    """The vehicle with servos and sensors that do at once and exactly as commanded, where its file says nothing else.

    The delay of the airspeed stays free: accelerometers determine it, whatever the model.
    """
    sensors = vehicle.sensors
    controls = {name: _exact(one, "delay", "lag", "backlash") for name, one in vehicle.controls.items()}
    sensors = replace(
        sensors,
        alpha_vane=_exact(sensors.alpha_vane, "delay", "lag"),
        beta_vane=_exact(sensors.beta_vane, "delay", "lag"),
        airspeed=replace(sensors.airspeed, scale_std=sensors.airspeed.scale_std or 0.0),
        thrust=replace(sensors.thrust, scale_std=sensors.thrust.scale_std or 0.0),
    )
    return replace(vehicle, controls=controls, sensors=sensors)


def with_airspeed_at_once(vehicle: Vehicle) -> Vehicle:
    """The vehicle with an airspeed that comes at once, where its file says nothing else."""
    airspeed = _exact(vehicle.sensors.airspeed, "delay", "lag")
    return replace(vehicle, sensors=replace(vehicle.sensors, airspeed=airspeed))


def _exact(part: Part, *keys: str) -> Part:
    changes: dict[str, Any] = {key: _NONE for key in keys if getattr(part, key) == NOT_SAID}
    return replace(part, **changes)


def _has_actuator_nuisance(one: NuisanceEstimate) -> bool:
    return one.name in _LEAST and one.value > max(_LEAST[one.name], _SEEN * one.std)


def _spread(one: NoiseSpectrum) -> float:
    low, high = np.percentile(one.density, (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))

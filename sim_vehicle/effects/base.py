"""What an effect is: a name, where it acts, and parameters with units and ranges.

An effect is physics that a baseline model may lack. Each lives in one file with its equation as a compiled function of
plain scalars; `sim_vehicle.dynamics`, `actuation` and `sensing` call these functions where the effect's slot is on.
Effects that are plain coefficients (pitch damping is Cm_q) need no code of their own: see `coefficient.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from sim_vehicle.errors import ModelFileError


class Stage(Enum):
    """Where in the chain from command to reading an effect acts."""

    AERODYNAMICS = "aerodynamics"
    PROPULSION = "propulsion"
    ACTUATOR = "actuator"
    SENSOR = "sensor"
    ENVIRONMENT = "environment"
    INERTIA = "inertia"


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    low, high: the plausible range in `unit`, used as bounds when the parameter is estimated. A positive `low` (of a
    time constant, a rate) is also the least that is simulated, and 0 means that the parameter cannot be negative.
    starts: values an estimator starts from; several where the likelihood has several hills.
    default: value taken when none is given; None means it must be given.
    fitted: False for shape constants that flights cannot tell (the sharpness of a stall).
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...] = ()
    default: float | None = None
    fitted: bool = True


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    title: a short noun phrase for people.
    separated_by: the manoeuvre that tells it from what it is easily confused with.
    needs_throttle_thrust: visible only where thrust is computed from throttle or rpm, not measured.
    alias: what it cannot be told from in any flight, or "" if nothing.
    """

    name: str
    title: str
    stage: Stage
    parameters: tuple[Parameter, ...]
    separated_by: str
    needs_throttle_thrust: bool = False
    alias: str = ""

    @property
    def is_coefficient(self) -> bool:
        """Whether the parameters are coefficients of the aerodynamic model."""
        return False

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """`values` with defaults filled in, in the order of the parameters.

        Raises ModelFileError for an unknown, missing or impossible parameter.
        """
        known = {parameter.name for parameter in self.parameters}
        for key in values:
            if key not in known:
                raise ModelFileError(f"effect {self.name} has no parameter {key}; it has {', '.join(sorted(known))}")
        complete: dict[str, float] = {}
        for parameter in self.parameters:
            value = values.get(parameter.name, parameter.default)
            if value is None:
                raise ModelFileError(f"effect {self.name} needs {parameter.name} [{parameter.unit}]")
            complete[parameter.name] = self._possible(parameter, float(value))
        return complete

    def _possible(self, parameter: Parameter, value: float) -> float:
        """`value`, or ModelFileError where no aircraft can have it."""
        if not math.isfinite(value):
            raise ModelFileError(f"effect {self.name}: {parameter.name} must be a finite number, got {value}")
        if parameter.low >= 0.0 and value < parameter.low:
            least = f"{parameter.low:g} {parameter.unit}"
            raise ModelFileError(f"effect {self.name}: {parameter.name} must be at least {least}, got {value:g}")
        if parameter.name == "scale" and value <= -1.0:
            raise ModelFileError(f"effect {self.name}: scale must be above -1, got {value:g}")
        if not parameter.fitted and value > parameter.high:
            most = f"{parameter.high:g} {parameter.unit}"
            raise ModelFileError(f"effect {self.name}: {parameter.name} must be at most {most}, got {value:g}")
        return value


@dataclass(frozen=True)
class CoefficientEffect(Effect):
    """An effect that is one or more terms of the aerodynamic model."""

    @property
    def is_coefficient(self) -> bool:
        return True

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """As for any effect, but a term that is not given stays out of the model."""
        known = {parameter.name for parameter in self.parameters}
        unknown = [key for key in values if key not in known]
        if unknown:
            raise ModelFileError(f"effect {self.name} has no parameter {unknown[0]}; it has {', '.join(sorted(known))}")
        if not values:
            raise ModelFileError(f"effect {self.name} needs a value for {' or '.join(sorted(known))}")
        return {p.name: self._possible(p, float(values[p.name])) for p in self.parameters if p.name in values}

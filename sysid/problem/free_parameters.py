"""Which numbers are estimated: coefficients, sensor errors, parameters of effects, errors of the thrust."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_vehicle.effects import EFFECTS

# Followed by a row of `Record.thrust_doubt`: an error of the thrust that is estimated.
THRUST_ERROR = "thrust_error_"


# A parameter with a larger step moves the outputs in steps of about that size.
_SMOOTH_STEP = 1e-4


@dataclass(frozen=True)
class FreeParameter:
    """One estimated number.

    kind: "coefficient", "effect", "sensor", "input". low, high: bounds. prior_std: standard deviation of a
    Gaussian prior about `prior_mean`, infinite for none. difference: step for difference quotients, where the kind's
    usual one does not do.
    """

    name: str
    kind: str
    low: float = -math.inf
    high: float = math.inf
    prior_mean: float = 0.0
    prior_std: float = math.inf
    difference: float | None = None

    @property
    def step(self) -> float:
        """Step for difference quotients, absolute."""
        if self.difference is not None:
            return self.difference
        return {"coefficient": 1e-5, "effect": 1e-5, "sensor": 1e-6}[self.kind]

    @property
    def is_stepping(self) -> bool:
        """Whether the outputs go in steps over it, so that no slope leads anywhere."""
        return self.difference is not None and self.difference > _SMOOTH_STEP


def coefficient(name: str, mean: float = 0.0, std: float = math.inf) -> FreeParameter:
    """An aerodynamic coefficient, with a prior where one is given."""
    return FreeParameter(name, "coefficient", prior_mean=mean, prior_std=std)


def sensor_error(name: str) -> FreeParameter:
    """A sensor error of SENSOR_ERRORS."""
    return FreeParameter(name, "sensor")


def thrust_error(index: int) -> FreeParameter:
    """How much of an error of the thrust there is (a row of `Record.thrust_doubt`), in its standard deviations."""
    return FreeParameter(f"{THRUST_ERROR}{index}", "input", prior_std=1.0)


def effect_parameter(effect: str, parameter: str) -> FreeParameter:
    """A parameter of an effect that is not a coefficient, named `effect.parameter`."""
    for entry in EFFECTS[effect].parameters:
        if entry.name == parameter:
            return FreeParameter(f"{effect}.{parameter}", "effect", entry.low, entry.high, difference=entry.step)
    raise KeyError(parameter)

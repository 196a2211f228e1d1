"""What an effect is: a name, where it acts, and parameters with units and ranges.

An effect is physics that a baseline model may lack. Each lives in one file with its equation as a compiled function of
plain scalars; `sim_vehicle.physics.dynamics`, `actuation` and `ideal_sensors` call these functions where the effect's
slot is on. Effects that are plain coefficients (pitch damping is Cm_q) need no code of their own: see
`aerodynamic_terms.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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


class Remembers(Enum):
    """What an effect remembers, as an estimator meets it.

    INPUT: what was commanded, which a simulation of the inputs alone knows. LAG: the motion or a reading, by a lag of
    the first order (parameter `tau`). PLAY: which way something was last pushed. LATENESS: readings, which come whole
    and late.
    """

    NONE = "none"
    INPUT = "input"
    LAG = "lag"
    PLAY = "play"
    LATENESS = "lateness"


class Need(Enum):
    """What a flight must have for an effect to show."""

    THRUST_BY_THROTTLE = "thrust that no sensor measures"
    NO_ROTOR_SPEED = "a rotor's speed that nobody counts"
    MEASURED_THRUST = "measured thrust"
    NEAR_GROUND = "flight within two spans of the ground, its height known"
    HEIGHT = "height"
    CALIBRATED_AIRSPEED = "calibrated airspeed"
    DIAMETER = "the propeller's diameter"
    ROTOR_SPEED = "the rotor's speed, counted or by its curves"


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, or one choice among names, which counts as the place of the name among `choices`.

    low, high: the plausible range in `unit`, used as bounds when the parameter is estimated. A positive `low` (of a
    time constant, a rate) is also the least that is simulated, and 0 means that the parameter cannot be negative.
    starts: values an estimator starts from; several where the likelihood has several hills.
    default: value taken when none is given; None means it must be given.
    fitted: False for shape constants that flights cannot identify (the sharpness of a stall), and for choices.
    choices: the names, empty for a number. moment: whether it is a moment of the flight, sought all over it.
    step: for difference quotients; wider than usual where outputs are smooth only on the average. usual: standard
    deviation that it has from aircraft to aircraft, of what is weighed, computed or calibrated before the flight; 0
    where nothing is known before it.
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...] = ()
    default: float | None = None
    fitted: bool = True
    choices: tuple[str, ...] = ()
    moment: bool = False
    step: float = 1e-5
    usual: float = 0.0

    def number(self, value: float | str) -> float:
        """`value` as a number: a name of `choices` as its place among them. Raises ValueError for no such name."""
        if self.choices and isinstance(value, str):
            return float(self.choices.index(value))
        return float(value)

    def shown(self, value: float) -> float | str:
        """A value as files and people have it: the name, where it is a choice."""
        return self.choices[int(value)] if self.choices else value


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    title: a short noun phrase for people.
    separated_by: the manoeuvre that distinguishes it from what it is easily confused with.
    needs: what a flight must have for it to show.
    alias: what it cannot be distinguished from in any flight, or "" if nothing; by_curvature: but for how that bends.
    phrase: what is missing in a sentence without full stop, its parameters in braces with units of people, as
    `{tau:ms}`; "" takes title and numbers.
    memory, outputs: what it remembers, and the readings that a sensor's lag acts on.
    separations: (other effect, manoeuvre) for those it is easily confused with; "" where `separated_by` does it.
    """

    name: str
    title: str
    stage: Stage
    parameters: tuple[Parameter, ...]
    separated_by: str
    needs: tuple[Need, ...] = ()
    alias: str = ""
    by_curvature: bool = False
    phrase: str = ""
    memory: Remembers = Remembers.NONE
    outputs: tuple[str, ...] = ()
    separations: tuple[tuple[str, str], ...] = ()

    @property
    def is_coefficient(self) -> bool:
        """Whether the parameters are coefficients of the aerodynamic model."""
        return False

    def manoeuvre_against(self, other: Effect) -> str:
        """The manoeuvre that distinguishes this effect from `other`."""
        own, theirs = dict(self.separations), dict(other.separations)
        return own.get(other.name) or theirs.get(self.name) or self.separated_by

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name. Raises KeyError."""
        return {parameter.name: parameter for parameter in self.parameters}[name]

    def starts(self, events: Sequence[Mapping[str, float]] = ()) -> tuple[dict[str, float], ...]:
        """Sets of start values of the fitted parameters, one for every hill of the likelihood.

        events: what may have happened in the flight, values by names of parameters; they go before the own starts of an
        effect of which one parameter is a moment, as far as it has them.
        """
        fitted = [parameter for parameter in self.parameters if parameter.fitted]
        count = max((len(parameter.starts) for parameter in fitted), default=0)
        sets = [{p.name: p.starts[min(i, len(p.starts) - 1)] for p in fitted} for i in range(count)]
        if events and any(parameter.moment for parameter in fitted):
            happened = [
                {p.name: min(max(event[p.name], p.low), p.high) for p in fitted if p.name in event} for event in events
            ]
            sets = [{**one, **event} for one in sets for event in happened]
        return tuple(sets)

    def variants(self) -> tuple[Effect, ...]:
        """The effect once for every name that it may choose, which is then its default; itself where it has none."""
        for place, parameter in enumerate(self.parameters):
            if parameter.choices and parameter.default is None:
                before, after = self.parameters[:place], self.parameters[place + 1 :]
                return tuple(
                    replace(
                        self,
                        title=f"{self.title} ({name.replace('_', ' ')})",
                        parameters=(*before, replace(parameter, default=float(i)), *after),
                    )
                    for i, name in enumerate(parameter.choices)
                )
        return (self,)

    def complete(self, values: Mapping[str, float | str]) -> dict[str, float]:
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
                wanted = f"one of {', '.join(parameter.choices)}" if parameter.choices else parameter.unit
                raise ModelFileError(f"effect {self.name} needs {parameter.name} [{wanted}]")
            complete[parameter.name] = self.possible(parameter, value)
        return complete

    def possible(self, parameter: Parameter, given: float | str) -> float:
        """`given` as a number, or ModelFileError where no aircraft can have it."""
        try:
            value = parameter.number(given)
        except ValueError:
            wanted = f"one of {', '.join(parameter.choices)}" if parameter.choices else "a number"
            raise ModelFileError(f"effect {self.name}: {parameter.name} must be {wanted}, got {given!r}") from None
        if parameter.choices and value not in range(len(parameter.choices)):
            raise ModelFileError(
                f"effect {self.name}: {parameter.name} must be one of {', '.join(parameter.choices)}, got {given!r}"
            )
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

    def complete(self, values: Mapping[str, float | str]) -> dict[str, float]:
        """As for any effect, but a term that is not given stays out of the model."""
        known = {parameter.name for parameter in self.parameters}
        unknown = [key for key in values if key not in known]
        if unknown:
            raise ModelFileError(f"effect {self.name} has no parameter {unknown[0]}; it has {', '.join(sorted(known))}")
        if not values:
            raise ModelFileError(f"effect {self.name} needs a value for {' or '.join(sorted(known))}")
        return {p.name: self.possible(p, values[p.name]) for p in self.parameters if p.name in values}

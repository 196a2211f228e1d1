"""Manoeuvres: what is added to the trimmed controls, and when.

Shapes: Klein & Morelli, Aircraft System Identification, 2nd ed., chapter 9; Jategaonkar, Flight Vehicle
System Identification, chapter 2. Widths are chosen for short-period modes of 1 to 2 Hz, usual below two
metres of span.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.errors import PlanError
from sim_vehicle.manoeuvres.multisine import harmonic_sets, optimised_phases, relative_peak_factor, synthesise
from sim_vehicle.model.aerodynamic_terms import may_name_control

Array = NDArray[np.float64]

CONTROLS = ("elevator", "aileron", "rudder", "throttle")
SURFACES = CONTROLS[:3]
_DEG = np.pi / 180.0
_ROUNDING = 1e-9  # s: an edge that falls on a tick belongs to that tick whatever the rounding of k dt


@dataclass(frozen=True)
class Segment:
    """One manoeuvre and its timing.

    duration: s, trimmed flight and free response included. start: s after which it is excited.
    amplitude: peak, rad at the surface; throttle 0 to 1; for `deceleration` the loss of speed, m/s.
    width: s, the unit pulse. length: s, the excitation (the base period of a multisine). low, high: Hz.
    axes: controls that are excited. harmonics, phases, weights, amplitudes: per axis, instead of the defaults of a
    multisine; weights are the relative amplitudes of its harmonics.
    """

    manoeuvre: str
    duration: float
    start: float = 1.0
    amplitude: float = 0.0
    width: float = 1.0
    length: float = 18.0
    low: float = 0.1
    high: float = 2.5
    axes: tuple[str, ...] = ()
    harmonics: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    phases: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    weights: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    amplitudes: Mapping[str, float] = field(default_factory=dict)

    def increments(self, time: Array, named: Sequence[str] = ()) -> Array:
        """What is added to the trimmed controls: elevator, aileron, rudder (rad), throttle (0 to 1), and those of other
        names, (N, 4 + named).

        time: (N,) s since the segment's begin. Raises PlanError for an axis that is none of these.
        """
        controls = (*CONTROLS, *named)
        out = np.zeros((time.size, len(controls)))
        if lacking := [axis for axis in self.axes if axis not in controls]:
            raise PlanError(f"{self.manoeuvre}: the vehicle has no control {lacking[0]}; it has {', '.join(controls)}")
        shape = _SHAPES[shape_of(self.manoeuvre)]
        inside = time < self.duration - _ROUNDING
        for axis in self.axes:
            out[:, controls.index(axis)] = np.where(inside, shape(self, axis, time - self.start), 0.0)
        return out

    def freed(self) -> tuple[bool, bool]:
        """Whether the autopilot lets go of (elevator and throttle, aileron and rudder) while it is excited."""
        if self.manoeuvre in ("cruise", "deceleration"):
            return False, False
        longitudinal = bool({"elevator", "throttle"} & set(self.axes))
        return longitudinal, bool({"aileron", "rudder"} & set(self.axes))

    def speed_change(self, time: float) -> float:
        """Change of the airspeed held, m/s, `time` s after the segment's begin: only `deceleration` has one."""
        if self.manoeuvre != "deceleration":
            return 0.0
        return -self.amplitude * min(max((time - self.start) / self.length, 0.0), 1.0)

    def harmonic_set(self, axis: str) -> tuple[int, ...]:
        """Harmonic numbers of the base period `length` that excite `axis` in a multisine."""
        if axis in self.harmonics:
            return self.harmonics[axis]
        return harmonic_sets(self.low, self.high, self.length, len(self.axes))[self.axes.index(axis)]


def _steps(segment: Segment, time: Array, parts: tuple[tuple[float, float], ...]) -> Array:
    """Consecutive constant levels: (width in unit pulses, sign)."""
    edges = np.cumsum([0.0, *(width for width, _ in parts)]) * segment.width
    index = np.searchsorted(edges, time + _ROUNDING, side="right")
    levels = np.array([0.0, *(sign for _, sign in parts), 0.0])
    return np.asarray(segment.amplitude * levels[index])


def _pulse(segment: Segment, axis: str, time: Array) -> Array:
    return _steps(segment, time, ((1.0, 1.0),))


def _doublet(segment: Segment, axis: str, time: Array) -> Array:
    return _steps(segment, time, ((1.0, 1.0), (1.0, -1.0)))


def _3211(segment: Segment, axis: str, time: Array) -> Array:
    return _steps(segment, time, ((3.0, 1.0), (2.0, -1.0), (1.0, 1.0), (1.0, -1.0)))


def _within(segment: Segment, time: Array) -> NDArray[np.bool_]:
    return np.asarray((time > -_ROUNDING) & (time < segment.length - _ROUNDING))


def _multisine(segment: Segment, axis: str, time: Array) -> Array:
    harmonics = segment.harmonic_set(axis)
    weights = segment.weights.get(axis, ())
    phases = segment.phases.get(axis) or optimised_phases(harmonics, weights)
    period = np.linspace(0.0, segment.length, 64 * max(harmonics), endpoint=False)
    whole = synthesise(harmonics, phases, period, segment.length, weights or None)
    peak = segment.amplitudes.get(axis, segment.amplitude)
    scale = peak / (0.5 * (whole.max() - whole.min()))
    values = scale * synthesise(harmonics, phases, time, segment.length, weights or None)
    return np.asarray(np.where(_within(segment, time), values, 0.0))


def _sweep(segment: Segment, axis: str, time: Array) -> Array:
    """Logarithmic sweep from `low` to `high`: as many cycles per octave everywhere."""
    rate = np.log(segment.high / segment.low)
    inside = np.clip(time, 0.0, segment.length)
    phase = 2.0 * np.pi * segment.low * segment.length / rate * (np.exp(inside / segment.length * rate) - 1.0)
    return np.asarray(np.where(_within(segment, time), segment.amplitude * np.sin(phase), 0.0))


def _sine(segment: Segment, axis: str, time: Array) -> Array:
    wave = segment.amplitude * np.sin(2.0 * np.pi * segment.low * time)
    return np.asarray(np.where(_within(segment, time), wave, 0.0))


def _nothing(segment: Segment, axis: str, time: Array) -> Array:
    return np.zeros_like(time)


_SHAPES: dict[str, Callable[[Segment, str, Array], Array]] = {
    "pulse": _pulse,
    "doublet": _doublet,
    "3211": _3211,
    "multisine": _multisine,
    "sweep": _sweep,
    "step": _pulse,
    "roller-coaster": _sine,
    "deceleration": _nothing,
    "cruise": _nothing,
}


def _defaults() -> dict[str, Segment]:
    """Every manoeuvre by name. 2 deg of elevator moves a small aircraft's alpha by about 5 deg: linear, but
    well seen.
    """
    found: dict[str, Segment] = {}
    widths = {"elevator": 0.35, "aileron": 0.5, "rudder": 0.5}
    peaks = {"elevator": 2.0 * _DEG, "aileron": 2.0 * _DEG, "rudder": 3.0 * _DEG}
    for axis in SURFACES:
        width, peak = widths[axis], peaks[axis]
        long_pulse = 1.0 if axis == "elevator" else width
        shaped = {
            "pulse": Segment("", 10.0, width=long_pulse),
            "doublet": Segment("", 10.0, width=width),
            "3211": Segment("", 12.0, width=width),
            "multisine": Segment("", 20.0, low=0.1 if axis == "elevator" else 0.2),
            "sweep": Segment("", 20.0, low=0.1 if axis == "elevator" else 0.3, high=3.0),
        }
        for shape, segment in shaped.items():
            name = f"{axis}-{shape}"
            found[name] = replace(segment, manoeuvre=name, amplitude=peak, axes=(axis,))
    throttle = ("throttle",)
    others = (
        Segment("multisine", 20.0, amplitude=2.0 * _DEG, axes=SURFACES),
        Segment("throttle-step", 12.0, amplitude=0.15, width=4.0, axes=throttle),
        Segment("throttle-multisine", 20.0, amplitude=0.15, low=0.05, high=0.5, axes=throttle),
        Segment("deceleration", 20.0, amplitude=4.0, length=8.0),
        Segment("roller-coaster", 14.0, amplitude=1.0 * _DEG, length=10.0, low=0.3, axes=("elevator",)),
        Segment("cruise", 10.0),
    )
    found.update({segment.manoeuvre: segment for segment in others})
    return found


def shape_of(manoeuvre: str) -> str:
    """The last part of a manoeuvre's name, which says the shape of its excitation."""
    head, _, tail = manoeuvre.partition("-")
    return tail if head in CONTROLS or (tail in _OF_ANY_CONTROL and may_name_control(head)) else manoeuvre


MANOEUVRES = _defaults()
# Manoeuvres of a control of another name, as flap-doublet: those of the ailerons, and a step.
_OF_ANY_CONTROL = ("pulse", "doublet", "3211", "multisine", "sweep", "step")


def default_of(name: str) -> Segment:
    """The named manoeuvre with its defaults, also of a control of another name. Raises PlanError for an unknown one."""
    if name in MANOEUVRES:
        return MANOEUVRES[name]
    head, shape = name.partition("-")[0], shape_of(name)
    if shape == name or shape not in _OF_ANY_CONTROL:
        shapes = ", ".join(f"NAME-{shape}" for shape in _OF_ANY_CONTROL)
        raise PlanError(
            f"no manoeuvre {name!r}; there are {', '.join(sorted(MANOEUVRES))}, and for a control NAME of the vehicle"
            f" file {shapes}"
        )
    like = MANOEUVRES["throttle-step" if shape == "step" else f"aileron-{shape}"]
    return replace(like, manoeuvre=name, amplitude=MANOEUVRES["aileron-doublet"].amplitude, axes=(head,))


SETTINGS = ("duration", "start", "amplitude", "width", "length", "low", "high")
# s, s, rad (or m/s), s, s, Hz, Hz. What is larger is a slip of the pen, or a unit mistaken.
_LARGEST = dict(zip(SETTINGS, (14_400.0, 14_400.0, 100.0, 14_400.0, 14_400.0, 100.0, 100.0), strict=True))
_MOST_HARMONICS = 2000


def manoeuvre(name: str, **settings: float) -> Segment:
    """The named manoeuvre with its defaults, some replaced. Raises PlanError for an unknown name or setting."""
    default = default_of(name)
    for key in settings:
        if key not in SETTINGS:
            raise PlanError(f"a manoeuvre has no setting {key!r}; there are {', '.join(SETTINGS)}")
    segment = replace(default, **settings)  # type: ignore[arg-type]
    check(segment)
    return segment


def check(segment: Segment) -> None:
    """Raise PlanError for a segment that cannot be flown."""
    name = segment.manoeuvre
    for key in SETTINGS:
        value = getattr(segment, key)
        if not np.isfinite(value):
            raise PlanError(f"{name}: {key} is {value}; give a finite number")
        if key not in ("amplitude", "start") and value <= 0.0:
            raise PlanError(f"{name}: {key} is {value:g}; it must be above 0")
        if abs(value) > _LARGEST[key]:
            raise PlanError(f"{name}: {key} is {value:g}; it may be {_LARGEST[key]:g} at most")
    if segment.start < 0.0:
        raise PlanError(f"{name}: start is {segment.start:g} s; it must not be negative")
    unknown = [axis for axis in segment.axes if axis not in CONTROLS and not may_name_control(axis)]
    if unknown:
        raise PlanError(f"{name}: no axis {unknown[0]!r}; there are {', '.join(CONTROLS)}")
    if segment.high <= segment.low:
        raise PlanError(f"{name}: high is {segment.high:g} Hz; it must be above low, {segment.low:g} Hz")
    if shape_of(name) == "multisine":
        _check_harmonics(segment)


def _check_harmonics(segment: Segment) -> None:
    name, seen = segment.manoeuvre, set[int]()
    if segment.high * segment.length > _MOST_HARMONICS:
        most = f"length times high may be {_MOST_HARMONICS} at most"
        raise PlanError(f"{name}: {segment.high * segment.length:.0f} harmonics are too many; {most}")
    for axis in segment.axes:
        numbers = segment.harmonic_set(axis)
        if not numbers or min(numbers) < 1:
            raise PlanError(f"{name}: no harmonic for {axis}; widen low..high or lengthen `length`")
        if seen & set(numbers):
            raise PlanError(f"{name}: harmonic {min(seen & set(numbers))} serves two axes; inputs must be orthogonal")
        seen |= set(numbers)
        for what, rows in (("phases", segment.phases), ("weights", segment.weights)):
            if axis in rows and len(rows[axis]) != len(numbers):
                raise PlanError(f"{name}: {axis} has {len(numbers)} harmonics and {len(rows[axis])} {what}")
        if min(segment.weights.get(axis, (1.0,))) <= 0.0:
            raise PlanError(f"{name}: {axis} has a weight of 0 or less; leave that harmonic out")


def peak_factors(segment: Segment) -> dict[str, float]:
    """Relative peak factor of each axis of a multisine over one base period."""
    time = np.linspace(0.0, segment.length, 4096, endpoint=False)
    return {axis: relative_peak_factor(_multisine(segment, axis, time)) for axis in segment.axes}


SEGMENT_KEYS = tuple(item.name for item in fields(Segment))

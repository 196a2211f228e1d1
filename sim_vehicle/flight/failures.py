"""What breaks in flight: surfaces, wings, tails, propellers, masses and sensors that fail at a moment.

A failure happens to the plant or the sensor itself: from its moment on the aircraft flies, and its sensors read, what
such an aircraft would; the autopilot and the telemetry know nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import slot
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.shapes import CONTROLS
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.icing import HEAVY_COAT
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.physics.layout import CQ_PLACE, CT_PLACE, CURVE_COEFFICIENTS, CURVE_SEGMENTS, CURVE_SIZE, SURFACES, Par

Array = NDArray[np.float64]

# Coefficients at rest that a failure may change, flown as 0 where the model has none.
_AT_REST = ("CL_0", "CD_0", "CY_0", "Cl_0", "Cm_0", "Cn_0")
_TAIL = ("Cm_q", "Cm_de", "CL_de", "CL_q")
_FIN = ("CY_beta", "CY_r", "CY_dr", "Cl_dr", "Cn_beta", "Cn_r", "Cn_dr")
# Cm_alpha of a tailplane over its Cm_q: half of (1 - downwash slope) over its lever in chords (Etkin & Reid 1996, 5.3).
_TAIL_STIFFNESS = 0.1
# A loose or lost wing tip beside the rolling moment it makes: share of roll damping, and drag.
_TIP_DAMPING, _TIP_DRAG = 5.0, 0.3
# A flap's drag and pitching moment beside its lift.
_FLAP_DRAG, _FLAP_MOMENT = 0.15, -0.10


def _scaled(plant: Plant, names: Sequence[str], factor: float) -> None:
    flat = plant.flat
    for i, name in enumerate(flat.names):
        if name in names:
            flat.C[i] *= factor


def _added(plant: Plant, name: str, change: float) -> None:
    plant.flat.C[plant.flat.names.index(name)] += change


def _value(plant: Plant, name: str) -> float:
    return float(plant.flat.C[plant.flat.names.index(name)]) if name in plant.flat.names else 0.0


def _weak(surface: str) -> Callable[[Plant, float], None]:
    def act(plant: Plant, share: float) -> None:
        _scaled(plant, [name for name in plant.flat.names if surface in parse_term(name).factors], share)

    return act


def _share_of_one_aileron(plant: Plant, share: float) -> None:
    """Of two ailerons one does less: half of the control is its own."""
    _weak("da")(plant, 0.5 * (1.0 + share))


def _one_aileron(plant: Plant, degrees: float) -> None:
    """One of two ailerons no longer follows, and stands at an angle: half of the control, and a moment that stays."""
    roll, yaw = 0.5 * _value(plant, "Cl_da"), 0.5 * _value(plant, "Cn_da")
    _weak("da")(plant, 0.5)
    _added(plant, "Cl_0", roll * math.radians(degrees))
    _added(plant, "Cn_0", yaw * math.radians(degrees))


def _ice(plant: Plant, severity: float) -> None:
    for name, change in HEAVY_COAT.items():
        _scaled(plant, (name,), 1.0 + severity * change)


def _tail(plant: Plant, share: float) -> None:
    lost = (1.0 - share) * _value(plant, "Cm_q")
    _scaled(plant, _TAIL, share)
    if "Cm_alpha" in plant.flat.names:
        _added(plant, "Cm_alpha", -_TAIL_STIFFNESS * lost)


def _fin(plant: Plant, share: float) -> None:
    _scaled(plant, _FIN, share)


def _wing_tip(plant: Plant, moment: float) -> None:
    _added(plant, "Cl_0", moment)
    _added(plant, "CD_0", _TIP_DRAG * abs(moment))
    _scaled(plant, ("Cl_p", "Cl_da"), 1.0 - _TIP_DAMPING * abs(moment))


def _flap(plant: Plant, lift: float) -> None:
    _added(plant, "CL_0", lift)
    _added(plant, "CD_0", _FLAP_DRAG * abs(lift))
    _added(plant, "Cm_0", _FLAP_MOMENT * lift)


def _gear(plant: Plant, drag: float) -> None:
    _added(plant, "CD_0", drag)


def _thrust(plant: Plant, share: float) -> None:
    P = plant.flat.P
    P[Par.max_thrust] *= share
    for place in (CT_PLACE, CQ_PLACE):
        # Of each piece of a curve the start stands before the powers.
        P[place + 2 : place + CURVE_SIZE].reshape(CURVE_SEGMENTS, 1 + CURVE_COEFFICIENTS)[:, 1:] *= share


def _mass(plant: Plant, share: float) -> None:
    plant.flat.P[Par.mass] *= share


def _centre_of_gravity(plant: Plant, chords: float) -> None:
    E = plant.flat.E
    E[slot("cg_shift", "x")] -= chords * plant.flat.P[Par.c]
    E[slot("cg_shift")] = 1.0


@dataclass(frozen=True)
class BrokenReading:
    """What a broken sensor is known by: its reading when it broke, its last one, and how long ago both were, s."""

    at_first: float
    last: float
    age_s: float
    step_s: float


SensorLaw = Callable[[float, float, BrokenReading], float]


def _stays(value: float, size: float, seen: BrokenReading) -> float:
    return seen.at_first


def _off(value: float, size: float, seen: BrokenReading) -> float:
    return value + size


def _turned(value: float, size: float, seen: BrokenReading) -> float:
    return value + math.radians(size)


def _slow(value: float, size: float, seen: BrokenReading) -> float:
    return seen.last + (1.0 - math.exp(-seen.step_s / size)) * (value - seen.last)


@dataclass(frozen=True)
class FailureKind:
    """One way to fail. size: what its number is; low, high: between which; usual: taken where none is given, None where
    it has none. plant: what it does to the aircraft. surface: the channel of the commands that no longer obeys.
    channel, law: what it does to a reading. control: whose servos' channels of the telemetry stand still.
    """

    what: str
    size: str = ""
    low: float = -math.inf
    high: float = math.inf
    usual: float | None = None
    plant: Callable[[Plant, float], None] | None = None
    surface: str = ""
    channel: str = ""
    law: SensorLaw | None = None
    control: str = ""


_SHARE = ("share that is left", 0.0, 1.0)
_STUCK = "no longer follows its command and stands"
KINDS: Mapping[str, FailureKind] = {
    "elevator": FailureKind("what the elevator does", *_SHARE, 0.5, _weak("de")),
    "aileron": FailureKind("what the ailerons do", *_SHARE, 0.5, _weak("da")),
    "rudder": FailureKind("what the rudder does", *_SHARE, 0.5, _weak("dr")),
    "elevator-stuck": FailureKind(f"the elevator {_STUCK}", "deg", -45.0, 45.0, math.nan, surface="de"),
    "aileron-stuck": FailureKind(f"the ailerons' linkage {_STUCK}", "deg", -45.0, 45.0, math.nan, surface="da"),
    "rudder-stuck": FailureKind(f"the rudder {_STUCK}", "deg", -45.0, 45.0, math.nan, surface="dr"),
    "elevator-floats": FailureKind("the elevator floats with the flow", "rad per rad of alpha", 0.0, 1.0, 0.5,
                                   surface="de"),
    "aileron-left": FailureKind("what the left aileron does", *_SHARE, 0.0, _share_of_one_aileron),
    "aileron-right": FailureKind("what the right aileron does", *_SHARE, 0.0, _share_of_one_aileron),
    "one-aileron": FailureKind("one of two ailerons is off its horn and stands", "deg", -45.0, 45.0, 0.0, _one_aileron),
    "tail": FailureKind("what is left of the tailplane", *_SHARE, 0.6, _tail),
    "fin": FailureKind("what is left of the fin", *_SHARE, 0.5, _fin),
    "wing-tip": FailureKind("a wing tip is loose", "Cl that it makes", -0.1, 0.1, 0.01, _wing_tip),
    "ice": FailureKind("ice on wings and tail", "1 for a heavy coat", 0.0, 3.0, 1.0, _ice),
    "flap": FailureKind("flaps have gone out", "CL that they make", -0.5, 1.0, 0.2, _flap),
    "gear": FailureKind("something hangs out", "CD that it makes", 0.0, 0.5, 0.02, _gear),
    "propeller": FailureKind("what the propeller pulls", "share that is left", 0.0, 2.0, 0.6, _thrust),
    "mass": FailureKind("the mass after a drop", "share that is left", 0.3, 2.0, 0.85, _mass),
    "cg": FailureKind("the centre of gravity has moved back", "chords", -1.0, 1.0, 0.05, _centre_of_gravity),
    "pitot-blocked": FailureKind("the pitot tube is blocked", channel="airspeed", law=_stays),
    "pitot-leak": FailureKind("the pitot tube leaks", "share of the pressure that is left", 0.0, 1.0, 0.7,
                              channel="airspeed", law=lambda value, size, seen: value * math.sqrt(size)),
    "pitot-drift": FailureKind("the airspeed drifts", "m/s per s", -5.0, 5.0, 0.2,
                               channel="airspeed", law=lambda value, size, seen: value + size * seen.age_s),
    "pitot-ice": FailureKind("the pitot tube freezes over", "s", 0.1, 600.0, 5.0,
                             channel="airspeed", law=lambda value, size, seen: value * math.exp(-seen.age_s / size)),
    "alpha-stuck": FailureKind("the alpha vane is stuck", channel="alpha", law=_stays),
    "beta-stuck": FailureKind("the beta vane is stuck", channel="beta", law=_stays),
    "alpha-bent": FailureKind("the alpha vane is bent", "deg", -45.0, 45.0, 4.0, channel="alpha", law=_turned),
    "beta-bent": FailureKind("the beta vane is bent", "deg", -45.0, 45.0, 4.0, channel="beta", law=_turned),
    "alpha-slow": FailureKind("the alpha vane lags", "s", 0.001, 5.0, 0.2, channel="alpha", law=_slow),
    "beta-slow": FailureKind("the beta vane lags", "s", 0.001, 5.0, 0.2, channel="beta", law=_slow),
    **{f"gyro-{name}": FailureKind(f"gyro {name} reads too much", "rad/s", -4.0, 4.0, 0.026, channel=name,
                                   law=_off) for name in "pqr"},
    **{f"accelerometer-{name}": FailureKind(f"accelerometer {name} reads too much", "m/s^2", -50.0, 50.0, 0.5,
                                            channel=f"a{name}", law=_off) for name in "xyz"},
    "compass": FailureKind("the heading reads too much", "deg", -180.0, 180.0, 20.0, channel="psi", law=_turned),
    "gps-lost": FailureKind("the GPS is lost", channel="gps"),
    "gps-jump": FailureKind("the GPS jumps to the north", "m", -1000.0, 1000.0, 30.0, channel="north", law=_off),
    **{f"servo-{name}-dead": FailureKind(f"the {name}'s channels of the telemetry stand still", control=name)
       for name in CONTROLS},
}  # fmt: skip


@dataclass(frozen=True)
class Failure:
    """One failure of a flight. size: NaN where it has none. time_s: s from the flight's first stamp."""

    name: str
    size: float
    time_s: float

    @property
    def kind(self) -> FailureKind:
        return KINDS[self.name]

    def to_json(self) -> dict[str, object]:
        """As the truth of a flight holds it."""
        return {"name": self.name, "size": None if math.isnan(self.size) else self.size, "time_s": self.time_s}


def parse_failure(text: str) -> Failure:
    """Read `NAME[=SIZE]@SECONDS`, or `NAME=WAY@SECONDS` as `pitot=blocked@40`. Raises SimVehicleError in one line."""
    left, at, when = text.partition("@")
    name, equals, number = left.partition("=")
    if f"{name}-{number}" in KINDS:
        name, equals, number = f"{name}-{number}", "", ""
    if name not in KINDS:
        every = ", ".join(sorted(KINDS))
        raise SimVehicleError(f"{text}: no such failure; there are {every} (pitot=blocked is pitot-blocked)")
    kind = KINDS[name]
    try:
        time_s = float(when) if at else math.nan
        size = float(number) if equals else kind.usual
    except ValueError:
        time_s = size = math.nan
    if not time_s >= 0.0 or math.isinf(time_s) or (equals and (size is None or not math.isfinite(size))):
        ways = [kind.removeprefix(f"{name}-") for kind in KINDS if kind.startswith(f"{name}-")]
        also = f", or {name}={'|'.join(ways)}@SECONDS" if ways else ""
        raise SimVehicleError(f"{text}: give NAME[=SIZE]@SECONDS, as elevator=0.5@40{also}")
    if equals and not kind.size:
        raise SimVehicleError(f"{text}: {name} has no size; give {name}@SECONDS")
    if size is None and kind.size:
        raise SimVehicleError(f"{text}: give {name}=SIZE@SECONDS, the size in {kind.size}")
    if size is not None and not math.isnan(size) and not kind.low <= size <= kind.high:
        raise SimVehicleError(f"{text}: {name} is from {kind.low:g} to {kind.high:g} ({kind.size})")
    return Failure(name, math.nan if size is None else size, time_s)


class Failures:
    """What fails in one flight, in the order of time. One object serves the loop and the sensors of one vehicle."""

    def __init__(self, failures: Sequence[Failure] = ()) -> None:
        self.every = tuple(sorted(failures, key=lambda one: one.time_s))
        self._waiting = [one for one in self.every if one.kind.plant is not None]
        # What broken surfaces stand at, what broken sensors read, what dead channels of the telemetry report.
        self._stands: dict[str, float] = {}
        self._read: dict[Failure, BrokenReading] = {}
        self._reported: dict[int, int] = {}

    @staticmethod
    def flyable(model: Model) -> Model:
        """The model with every coefficient at rest, so that a failure can change it."""
        missing = {name: Coefficient(0.0) for name in _AT_REST if name not in model.coefficients}
        return replace(model, coefficients={**model.coefficients, **missing}, correlation=None) if missing else model

    def begin(self, time_s: float, plant: Plant) -> None:
        """Break of the aircraft what breaks by now."""
        while self._waiting and self._waiting[0].time_s <= time_s:
            one = self._waiting.pop(0)
            assert one.kind.plant is not None
            one.kind.plant(plant, one.size)

    def obeyed(self, time_s: float, command: Array, alpha: float) -> Array:
        """(4,) the commands as the surfaces obey them. alpha: rad."""
        broken = [one for one in self._now(time_s) if one.kind.surface]
        if not broken:
            return command
        moved = command.copy()
        for one in broken:
            place = SURFACES.index(one.kind.surface)
            if one.name.endswith("-floats"):
                moved[place] = -one.size * alpha
            else:
                held = command[place] if math.isnan(one.size) else math.radians(one.size)
                moved[place] = self._stands.setdefault(one.name, float(held))
        return moved

    def read(self, time_s: float, readings: dict[str, float]) -> None:
        """Change in place what broken sensors read, by channels of the sensors."""
        for one in self._now(time_s):
            law, channel = one.kind.law, one.kind.channel
            if law is None or channel not in readings:
                continue
            value = readings[channel]
            before = self._read.get(one, BrokenReading(value, value, time_s - one.time_s, 0.0))
            age_s = time_s - one.time_s
            seen = replace(before, age_s=age_s, step_s=age_s - before.age_s)
            readings[channel] = law(value, one.size, seen)
            self._read[one] = replace(seen, last=readings[channel])

    def lost(self, time_s: float) -> frozenset[str]:
        """Groups of sensors that report nothing any more."""
        return frozenset("gps" for one in self._now(time_s) if one.name == "gps-lost")

    def reported(self, time_s: float, pulses: Mapping[int, int], servos: Mapping[str, Sequence[int]]) -> dict[int, int]:
        """Pulses as the telemetry reports them, us by servo. servos: those of each control."""
        dead = {servo for one in self._now(time_s) for servo in servos.get(one.kind.control, ())}
        return {n: self._reported.setdefault(n, pulse) if n in dead else pulse for n, pulse in pulses.items()}

    def _now(self, time_s: float) -> Sequence[Failure]:
        return [one for one in self.every if one.time_s <= time_s]

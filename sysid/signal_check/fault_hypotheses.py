"""Mistakes that readings of sensors are known to suffer: wrong unit, wrong sign, wrong axes, gravity left out.

Each is a way to read the same data differently; `Hypothesis.apply` turns the readings into what they would truly mean.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_vehicle.constants import STANDARD_GRAVITY
from sysid.arrays import Array
from sysid.signal_check.fault import Mistake
from sysid.signals.flight import FlightData
from sysid.signals.sensor_groups import ACCEL, ATTITUDE, GROUND, GYRO, IMU, VANES, group_name, joined

_DEGREE = np.pi / 180.0
# Per kind of quantity: name of the unit that the readings are in -> SI per that unit.
ANGLE = {"degrees": _DEGREE, "hundredths of degrees": _DEGREE / 100.0, "degrees converted twice": 1.0 / _DEGREE}
RATE = {"deg/s": _DEGREE, "mrad/s": 1e-3, "deg/s converted twice": 1.0 / _DEGREE}
FORCE = {
    "g": STANDARD_GRAVITY,
    "milli-g": STANDARD_GRAVITY / 1000.0,
    "ft/s^2": 0.3048,
    "g converted twice": 1.0 / STANDARD_GRAVITY,
}
SPEED = {"km/h": 1.0 / 3.6, "knots": 1852.0 / 3600.0, "ft/s": 0.3048, "mph": 0.44704, "cm/s": 0.01}  # m/s of one unit
AIRSPEED = {**SPEED, "m/s from hPa taken for Pa": 10.0, "m/s from Pa taken for hPa": 0.1}
_UNITS: tuple[tuple[tuple[str, ...], dict[str, float]], ...] = (
    (ACCEL, FORCE), (GYRO, RATE), (ATTITUDE, ANGLE), (VANES, ANGLE), (GROUND, SPEED), (("airspeed",), AIRSPEED),
)  # fmt: skip
SI = dict.fromkeys(ACCEL, "m/s^2") | dict.fromkeys(GYRO, "rad/s")
SI |= dict.fromkeys((*ATTITUDE, *VANES), "rad") | dict.fromkeys((*GROUND, "airspeed"), "m/s")


@dataclass(frozen=True)
class Hypothesis:
    """One way the readings may be wrong.

    signals: which. kind: "unit", "sign", "axis", "scale". sentence: what is found and what to do, one line.
    matrix: true readings of `signals` as combinations of those recorded, (n, n). offset: (n,) added, in SI.
    gravity: m/s^2, what to add to ax ay az along the body axes of the vertical, downwards positive.
    penalty: how much less simple it is than a unit or a sign.
    """

    signals: tuple[str, ...]
    kind: str
    sentence: str
    matrix: Array
    offset: Array = field(default_factory=lambda: np.zeros(0))
    gravity: float = 0.0
    penalty: float = 0.0
    unit: str = ""

    def concerns(self, columns: Mapping[str, Array] | FlightData) -> bool:
        """Whether all the signals are there."""
        return all(name in columns for name in self.signals)

    def apply(self, columns: Mapping[str, Array]) -> dict[str, Array]:
        """The signals as they would truly be; as they are where not all of them are there."""
        found = dict(columns)
        if not self.concerns(columns):
            return found
        true = self.matrix @ np.stack([columns[name] for name in self.signals])
        if self.offset.size:
            true = true + self.offset[:, None]
        found |= dict(zip(self.signals, true, strict=True))
        if self.gravity:
            phi, theta = columns["phi"], columns["theta"]
            along = (-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi))
            for name, share in zip(ACCEL, along, strict=True):
                found[name] = found[name] + self.gravity * share
        return found

    @property
    def factor(self) -> float:
        """What the readings are multiplied by; NaN where they are taken from other axes."""
        return float("nan") if self.kind == "axis" else float(self.matrix[0, 0])

    def as_mistake(self) -> Mistake:
        """The mistake that this reading is free of."""
        name = group_name(self.signals)
        return Mistake(name, self.kind, self.factor, self.unit, self.sentence, self.signals)


def _verb(names: Sequence[str], one: str, more: str) -> str:
    return one if len(names) == 1 else more


def _units(present: set[str]) -> Iterator[Hypothesis]:
    for group, units in _UNITS:
        here = tuple(name for name in group if name in present)
        sets = [(name,) for name in here] + ([here] if len(here) > 1 else [])
        for names, (unit, factor) in itertools.product(sets, units.items()):
            looks = f"{joined(names)} {_verb(names, 'looks', 'look')} like {unit}"
            cure = f"scale {_verb(names, 'it', 'them')} by {factor:.4g} in [signals] of the vehicle file"
            yield Hypothesis(names, "unit", f"{looks}: {cure}", np.diag(np.full(len(names), factor)), unit=unit)


def _signs(present: set[str]) -> Iterator[Hypothesis]:
    everything = [name for group in (ACCEL, GYRO, ATTITUDE, VANES, GROUND, ("airspeed",)) for name in group]
    for name in everything:
        if name in present and name != "airspeed":
            yield Hypothesis(
                (name,), "sign", f"{name} has the wrong sign: scale it by -1 in [signals] of the vehicle file",
                -np.eye(1),
            )  # fmt: skip
    for names, why in (
        (ACCEL, "the accelerometers read the acceleration of free fall upside down"),
        (("theta", "psi"), "pitch and heading are those of axes forward, left, up"),
        (("q", "r"), "the gyros' axes are forward, left, up"),
        (("ay", "az"), "the accelerometers' axes are forward, left, up"),
        (("ay", "az", "q", "r"), "the IMU's axes are forward, left, up"),
    ):
        if set(names) <= present:
            text = f"{joined(names)} have the wrong sign ({why}): scale them by -1 in [signals] of the vehicle file"
            yield Hypothesis(names, "sign", text, -np.eye(len(names)), penalty=1.0)


def _axes(present: set[str]) -> Iterator[Hypothesis]:
    for one, other in (("phi", "theta"), *itertools.combinations(VANES, 2), ("vn", "ve")):
        if {one, other} <= present:
            yield _swap((one, other))
    if set(GROUND) <= present:
        enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
        text = "vn, ve and vd look like east, north, up: exchange vn and ve and scale vd by -1 in [signals]"
        yield Hypothesis(GROUND, "axis", text, enu, penalty=1.0)
    if "psi" in present:
        text = "psi looks like an angle from east to the left: scale it by -1 and add 1.571 in [signals]"
        yield Hypothesis(("psi",), "axis", text, -np.eye(1), np.array([np.pi / 2.0]), penalty=1.0)
    for names, what in ((ACCEL, "ax, ay, az"), (GYRO, "p, q, r"), (IMU, "ax, ay, az and p, q, r")):
        if set(names) <= present:
            yield from _turned(names, what)


def _swap(names: tuple[str, str]) -> Hypothesis:
    text = f"{joined(names)} are exchanged: exchange them in [signals] of the vehicle file"
    return Hypothesis(names, "axis", text, np.array([[0.0, 1.0], [1.0, 0.0]]), penalty=1.0)


def _turned(names: tuple[str, ...], what: str) -> Iterator[Hypothesis]:
    """All ways to exchange three axes, with or without signs; signs alone are tested elsewhere."""
    for order in itertools.permutations(range(3)):
        if order == (0, 1, 2):
            continue
        for signs in itertools.product((1.0, -1.0), repeat=3):
            block = np.zeros((3, 3))
            for row, (column, sign) in enumerate(zip(order, signs, strict=True)):
                block[row, column] = sign
            matrix = np.asarray(np.kron(np.eye(len(names) // 3), block), dtype=np.float64)
            read = [f"{'-' if s < 0 else ''}{names[c]}" for c, s in zip(order, signs, strict=True)]
            text = f"{what} are on the wrong axes: read {', '.join(read)} for {', '.join(names[:3])} in [signals]"
            plain = signs == (1.0, 1.0, 1.0)
            yield Hypothesis(names, "axis", text, matrix, penalty=1.0 if plain else 3.0)


def _gravity(present: set[str], gravity: float) -> Iterator[Hypothesis]:
    if set(ACCEL) <= present:
        for multiple, why in ((-1.0, "without gravity"), (-2.0, "with gravity of the wrong sign")):
            text = (
                f"ax, ay and az are accelerations {why}: record what the accelerometers read, about -9.8 m/s^2 along z"
                " in level flight"
            )
            yield Hypothesis(ACCEL, "axis", text, np.eye(3), gravity=multiple * gravity)


def hypotheses(present: set[str], gravity: float) -> list[Hypothesis]:
    """All that the signals present allow. gravity: m/s^2, where the flight was."""
    return [*_units(present), *_signs(present), *_axes(present), *_gravity(present, gravity)]


def scale_hypothesis(names: tuple[str, ...], scale: float) -> Hypothesis:
    """Readings that are (1 + scale) of true."""
    factor = 1.0 / (1.0 + scale)
    text = (
        f"{joined(names)} {_verb(names, 'reads', 'read')} {1.0 + scale:.3g} of true:"
        f" scale {_verb(names, 'it', 'them')} by {factor:.4g} in [signals] of the vehicle file"
    )
    return Hypothesis(names, "scale", text, factor * np.eye(len(names)), penalty=1.0)

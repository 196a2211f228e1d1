"""Units as people write them, and what they are in SI: value in SI = factor * value + offset.

Angles are radians in SI, revolutions per minute and microseconds of a servo's pulse stay what they are.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from sim_vehicle.constants import STANDARD_GRAVITY
from sysid.errors import TableError

# m, m/s and N: exact by definition (NIST SP 811).
_FOOT, _KNOT, _POUND_FORCE = 0.3048, 1852.0 / 3600.0, 4.4482216152605
_SLUG = _POUND_FORCE / _FOOT
# K: a degree of Rankine and Fahrenheit, and where Celsius begins.
_RANKINE, _ZERO_CELSIUS = 5.0 / 9.0, 273.15


@dataclass(frozen=True)
class Unit:
    """What a written unit is in SI.

    si: the SI unit, as "rad/s". factor, offset: value in SI = factor * value + offset.
    """

    si: str
    factor: float
    offset: float = 0.0


def _all(si: str, **factors: float) -> dict[str, Unit]:
    return {name: Unit(si, factor) for name, factor in factors.items()}


# By what is written, once it is tidied (`unit_of`): lower case, "/" for "per" and "_", no blanks, dots or carets.
_UNITS: dict[str, Unit] = {
    **_all("s", s=1.0, ms=1e-3, us=1e-6, usec=1e-6, ns=1e-9, min=60.0),
    **_all("rad", rad=1.0, radian=1.0, radians=1.0, mrad=1e-3, deg=math.radians(1.0), degree=math.radians(1.0)),
    **_all("rad", degrees=math.radians(1.0), ddeg=math.radians(0.1), cdeg=math.radians(0.01)),
    **{text: Unit("rad/s", 1.0) for text in ("rad/s", "rad/sec", "radian/s", "radians/s", "r/s")},
    **{text: Unit("rad/s", math.radians(1.0)) for text in ("deg/s", "deg/sec", "dps", "degree/s", "degrees/s")},
    **_all("rad/s", **{"mrad/s": 1e-3, "ddeg/s": math.radians(0.1)}),
    **{text: Unit("rad/s^2", 1.0) for text in ("rad/s2", "rad/s/s")},
    **{text: Unit("rad/s^2", math.radians(1.0)) for text in ("deg/s2", "deg/s/s")},
    **{text: Unit("m/s^2", 1.0) for text in ("m/s2", "m/s/s", "m/sec2", "mps2")},
    **{text: Unit("m/s^2", _FOOT) for text in ("ft/s2", "ft/s/s", "ft/sec2", "fps2")},
    **{text: Unit("m/s^2", STANDARD_GRAVITY) for text in ("g", "gs", "g's", "g0", "gn")},
    **_all("m/s^2", mg=1e-3 * STANDARD_GRAVITY),
    **{text: Unit("m/s", 1.0) for text in ("m/s", "m/sec", "mps")},
    **{text: Unit("m/s", _FOOT) for text in ("ft/s", "ft/sec", "fps")},
    **{text: Unit("m/s", _KNOT) for text in ("kn", "kt", "kts", "knot", "knots", "kias", "kcas", "keas", "ktas")},
    **_all("m/s", **{"km/h": 1.0 / 3.6, "kph": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704, "cm/s": 0.01}),
    **{text: Unit("m/s", _FOOT / 60.0) for text in ("ft/min", "fpm")},
    **_all("m", m=1.0, meter=1.0, meters=1.0, metre=1.0, metres=1.0, cm=0.01, mm=1e-3, km=1e3, ft=_FOOT, feet=_FOOT),
    **_all("m", **{"in": _FOOT / 12.0, "inch": _FOOT / 12.0}),
    **_all("Pa", pa=1.0, hpa=100.0, mbar=100.0, mb=100.0, kpa=1e3, psi=_POUND_FORCE / (_FOOT / 12.0) ** 2),
    **{text: Unit("Pa", _POUND_FORCE / _FOOT**2) for text in ("psf", "lb/ft2", "lbf/ft2", "lbs/ft2")},
    **_all("Pa", mmh2o=STANDARD_GRAVITY, inhg=3386.389),
    **_all("K", k=1.0, kelvin=1.0, r=_RANKINE, degr=_RANKINE, rankine=_RANKINE),
    **{text: Unit("K", 1.0, _ZERO_CELSIUS) for text in ("c", "degc", "celsius")},
    **{text: Unit("K", _RANKINE, _ZERO_CELSIUS - 32.0 * _RANKINE) for text in ("f", "degf", "fahrenheit")},
    **_all(
        "kg/m^3",
        **{"kg/m3": 1.0, "kgm3": 1.0, "kgm-3": 1.0, "slug/ft3": _SLUG / _FOOT**3, "slugs/ft3": _SLUG / _FOOT**3},
    ),
    **_all("N", n=1.0, newton=1.0, lbf=_POUND_FORCE, lbs=_POUND_FORCE, lb=_POUND_FORCE, kgf=STANDARD_GRAVITY),
    **_all("N", gf=1e-3 * STANDARD_GRAVITY),
    **_all("1/min", rpm=1.0, **{"1/min": 1.0, "rev/min": 1.0, "hz": 60.0, "rev/s": 60.0}),
    **{text: Unit("1", 1.0) for text in ("1", "norm", "-", "ratio", "none", "unitless")},
    **{text: Unit("1", 0.01) for text in ("%", "pct", "percent")},
    **_all("V", v=1.0, volt=1.0, mv=1e-3),
    **_all("A", a=1.0, amp=1.0, ma=1e-3, ca=0.01),
}
# Written alike, and different things by what is measured: (unit, SI unit wanted) -> what it is then.
_BY_WANT: dict[tuple[str, str], Unit] = {
    ("deg", "deg"): Unit("deg", 1.0),
    ("rad", "deg"): Unit("deg", math.degrees(1.0)),
    ("us", "us"): Unit("us", 1.0),
    ("usec", "us"): Unit("us", 1.0),
    ("rad/s", "1/min"): Unit("1/min", 30.0 / math.pi),
    ("g", "N"): Unit("N", 1e-3 * STANDARD_GRAVITY),
}


def tidy(text: str) -> str:
    """A unit as it stands in the table above."""
    text = text.strip().strip("[]()").strip().lower()
    for old, new in (("°", "deg"), ("²", "2"), ("³", "3"), ("µ", "u"), ("μ", "u"), ("_", "/")):
        text = text.replace(old, new)
    text = re.sub(r"\bper\b", "/", text)
    text = re.sub(r"[\s.*·^]", "", text)
    text = re.sub(r"(?<![a-z])(seconds|second|secs|sec)(?![a-z])", "s", text)
    # "m/s-2", "rad s-1": as physicists write them.
    text = re.sub(r"^(rad|deg|m|ft)s-1$", r"\1/s", text)
    return re.sub(r"^(rad|deg|m|ft)s-2$", r"\1/s2", text)


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known."""
    return _known(tidy(text)) is not None


def _known(key: str) -> Unit | None:
    """A tidied unit; also counts of an accelerometer by how many of them are one g: "g/2048"."""
    counts = re.fullmatch(r"g/([1-9]\d{0,6})", key)
    return Unit("m/s^2", STANDARD_GRAVITY / int(counts[1])) if counts else _UNITS.get(key)


def unit_of(text: str, wanted: str, what: str) -> Unit:
    """What a written unit is in SI.

    Parameters
    ----------
    text : str
        The unit as somebody wrote it: "deg/s", "ft/sec^2", "m s-2".
    wanted : str
        SI unit of what is measured, as "rad/s".
    what : str
        Name of what is measured, for errors.

    Returns
    -------
    Unit
        Its factor and offset to `wanted`.

    Raises
    ------
    TableError
        Where the unit is not known, or measures something else.
    """
    key = tidy(text)
    found = _BY_WANT.get((key, wanted)) or _known(key)
    if found is None:
        raise TableError(f"{what}: the unit {text!r} is not known; usual ones are {', '.join(usual_units(wanted))}")
    if found.si != wanted:
        usual = ", ".join(usual_units(wanted))
        raise TableError(f"{what}: {text!r} is no unit of it; usual ones are {usual}")
    return found


_USUAL: dict[str, tuple[str, ...]] = {
    "rad": ("rad", "deg"),
    "rad/s": ("rad/s", "deg/s"),
    "rad/s^2": ("rad/s^2", "deg/s^2"),
    "m/s^2": ("m/s^2", "g", "ft/s^2"),
    "m/s": ("m/s", "ft/s", "kn", "km/h"),
    "m": ("m", "ft"),
    "Pa": ("Pa", "hPa", "psf", "psi"),
    "K": ("K", "degC", "degF", "R"),
    "kg/m^3": ("kg/m^3", "slug/ft^3"),
    "N": ("N", "lbf", "gf"),
    "1/min": ("rpm", "rad/s"),
    "1": ("1", "%"),
    "us": ("us",),
    "s": ("s", "ms", "us"),
    "deg": ("deg", "rad"),
}


def usual_units(wanted: str) -> tuple[str, ...]:
    """Units that a quantity of this SI unit is usually given in."""
    return _USUAL.get(wanted, (wanted,))

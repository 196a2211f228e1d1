"""Sizes of an aircraft that no unit explains: what is more than doubtful is refused before anything is computed."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping

# How far beyond what is merely doubtful a number is impossible: more than kg from g, or m^2 from cm^2, is wrong by.
_FAR = 1e5
_RADII = (0.02, 1.5)  # of gyration, in spans
# Least and largest size of a number other than 0, in SI units: of these keys, and of any other, whose products and
# quotients are still numbers then. Sizes that `impossible` judges by the span are left to it.
_BOUNDS = {
    "flight.airspeed": (0.1, 3e3),
    "flight.altitude": (1e-6, 1e5),
    "environment.gravity": (1e-3, 1e3),
    "environment.air_density": (1e-6, 1e6),
}
_USUAL_BOUNDS = (1e-20, 1e20)
_BY_SPAN = frozenset({"mass.mass", "mass.Ixx", "mass.Iyy", "mass.Izz", "geometry.S", "geometry.b", "geometry.c"})


def extreme(data: Mapping[str, object]) -> tuple[str, str] | None:
    """Key and problem of the first number of a vehicle file that is no quantity of any aircraft, by its size alone.

    data: the file as tomllib gives it.
    """
    left: list[tuple[str, object]] = list(reversed(list(data.items())))
    while left:
        key, value = left.pop()
        if isinstance(value, Mapping):
            left += [(f"{key}.{name}", inner) for name, inner in reversed(list(value.items()))]
        elif isinstance(value, list):
            left += [(key, inner) for inner in reversed(value)]
        elif isinstance(value, int | float) and key not in _BY_SPAN:
            least, most = _BOUNDS.get(key, _USUAL_BOUNDS)
            if most < abs(value) < math.inf or 0 < abs(value) < least:
                shown = f"{float(value):g}" if abs(value) < sys.float_info.max else f"of {len(str(abs(value)))} digits"
                return key, f"is {shown}, which is impossible; it must be between {least:g} and {most:g} in SI units"
    return None


def impossible(sizes: dict[str, float], weight_per_area: tuple[float, float], small: float) -> tuple[str, str] | None:
    """Key and problem of the first size that fits no aircraft.

    sizes: mass, Ixx, Iyy, Izz, S, b, c [SI] and gravity. weight_per_area: N/m^2, least and most of aircraft of a span
    up to `small`, m; the mass of larger ones is judged by their span.
    """
    mass, S, b, c, gravity = (sizes[key] for key in ("mass", "S", "b", "c", "gravity"))
    if not 1e-3 <= b <= 1e3:
        return "geometry.b", f"is {b:g} m, a span that no aircraft has; give it in m"
    expected = {"geometry.S": (S, b * b / 60.0, b * b / 0.3, "m^2"), "geometry.c": (c, b / 200.0, 10.0 * b, "m")}
    low, high = weight_per_area
    by_area = (low * S / gravity, high * S / gravity)
    expected["mass.mass"] = (mass, *(by_area if b <= small else (1e-3 * b**3, 100.0 * b**3)), "kg")
    for key in ("Ixx", "Iyy", "Izz"):
        least, most = (mass * (share * b) ** 2 for share in _RADII)
        expected[f"mass.{key}"] = (sizes[key], least, most, "kg m^2")
    for key, (value, least, most, unit) in expected.items():
        if not least / _FAR <= value <= most * _FAR:
            return key, (
                f"is {value:g} {unit}, which is impossible on a span of {b:g} m;"
                f" {least:.2g} to {most:.2g} {unit} are expected"
            )
    return None

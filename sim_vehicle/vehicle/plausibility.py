"""Sizes of an aircraft that no unit explains: what is more than doubtful is refused before anything is computed."""

from __future__ import annotations

# How far beyond what is merely doubtful a number is impossible: more than kg from g, or m^2 from cm^2, is wrong by.
_FAR = 1e5
_RADII = (0.02, 1.5)  # of gyration, in spans


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

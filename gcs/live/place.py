"""Places near one another in metres."""

from __future__ import annotations

import math

_METRES_PER_DEGREE = math.radians(6_378_137.0)


def metres(place: tuple[float, float], home: tuple[float, float]) -> tuple[float, float]:
    """North and east of home, m; both as latitude and longitude, deg."""
    north = (place[0] - home[0]) * _METRES_PER_DEGREE
    east = (place[1] - home[1]) * _METRES_PER_DEGREE * math.cos(math.radians(home[0]))
    return round(north, 2), round(east, 2)

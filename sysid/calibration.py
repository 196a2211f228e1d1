"""Bench curves, for those who use the library; made in `sysid.signals.calibration`."""

from sysid.signals.calibration import (
    MAX_DEGREE,
    UNITS,
    WATER_DENSITY,
    BenchPoints,
    Calibration,
    CalibrationCoefficient,
    calibrate,
    points_from_pairs,
    read_points,
    u_tube_pressure,
)

__all__ = [
    "MAX_DEGREE",
    "UNITS",
    "WATER_DENSITY",
    "BenchPoints",
    "Calibration",
    "CalibrationCoefficient",
    "calibrate",
    "points_from_pairs",
    "read_points",
    "u_tube_pressure",
]

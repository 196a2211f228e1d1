"""An accelerometer that reads something else than the acceleration of the centre of gravity.

A motor that hangs on the thrust sensor is put in by what the accelerometer reads (`sysid.signals.record`): where that
is off the centre, misaligned or late, so is the pull.
"""

from __future__ import annotations

from sim_vehicle.effects import slot
from sim_vehicle.physics.layout import Par
from sysid.arrays import Array

_ARM = slice(int(Par.accelerometer_x), int(Par.accelerometer_x) + 3)
_OFFSET, _TILT, _LATE = (
    slot(name) for name in ("accelerometer_offset", "accelerometer_misalignment", "sensor_time_skew")
)


def misreads(P: Array, E: Array) -> bool:
    """Whether a model's accelerometer reads anything else. P, E: of `sim_vehicle.vehicle.packed_model.PackedModel`."""
    return bool(P[_ARM].any() or E[[_OFFSET, _TILT, _LATE]].any())


def at_the_centre(P: Array, E: Array) -> tuple[Array, Array]:
    """P and E with an undelayed accelerometer at the centre of gravity, in body axes."""
    centred, undelayed = P.copy(), E.copy()
    centred[_ARM] = 0.0
    undelayed[[_OFFSET, _TILT, _LATE]] = 0.0
    return centred, undelayed

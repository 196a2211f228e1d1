"""Which signals come from one sensor: names of groups, and groups in words."""

from __future__ import annotations

from collections.abc import Sequence

ACCEL, GYRO, ATTITUDE, VANES, GROUND = (
    ("ax", "ay", "az"), ("p", "q", "r"), ("phi", "theta", "psi"), ("alpha", "beta"), ("vn", "ve", "vd"),
)  # fmt: skip
IMU = (*ACCEL, *GYRO)
# What no estimate of an aircraft does without, beside an IMU of any axes.
ESSENTIAL = ("phi", "theta", "airspeed")
GROUPS: dict[str, tuple[str, ...]] = {
    "accelerometers": ACCEL, "gyros": GYRO, "imu": IMU, "attitude": ATTITUDE, "vanes": VANES,
    "air_data": ("airspeed",), "gps": GROUND,
}  # fmt: skip


def joined(names: Sequence[str]) -> str:
    """`ax, ay and az`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def group_name(names: Sequence[str]) -> str:
    """Name of the group of GROUPS that has all and only these signals, or they themselves."""
    for group, members in GROUPS.items():
        if set(names) == set(members) and len(members) > 1:
            return group
    return joined(names)

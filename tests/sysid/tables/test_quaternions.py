"""Attitude of tables as a quaternion, in the spellings that loggers use."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from flightmodel import Flight
from sysid.tables.files import read_table
from sysid.tables.quaternions import quaternion_in

TIME = np.arange(0.0, 4.0, 0.02)
PHI, THETA, PSI = 0.5 * np.sin(TIME), 0.2 * np.cos(2.0 * TIME), 3.0 + 0.2 * TIME


def parts() -> list[np.ndarray]:
    """Scalar, x, y, z by half angles (Stevens & Lewis, eq. 1.3-33)."""
    cx, cy, cz = (np.cos(one / 2.0) for one in (PHI, THETA, PSI))
    sx, sy, sz = (np.sin(one / 2.0) for one in (PHI, THETA, PSI))
    return [
        cx * cy * cz + sx * sy * sz,
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
    ]


@pytest.mark.parametrize(
    "names",
    [
        ("q0", "q1", "q2", "q3"),
        ("q[0]", "q[1]", "q[2]", "q[3]"),
        ("qw", "qx", "qy", "qz"),
        ("q.w", "q.x", "q.y", "q.z"),
        ("vehicle_attitude.q[0]", "vehicle_attitude.q[1]", "vehicle_attitude.q[2]", "vehicle_attitude.q[3]"),
        ("Q1", "Q2", "Q3", "Q4"),
    ],
)
def test_a_quaternion_is_the_attitude(names: tuple[str, ...]) -> None:
    flight = Flight.from_frame({"time_s": TIME, **dict(zip(names, parts(), strict=True))})
    for angle, truth in (("phi", PHI), ("theta", THETA), ("psi", PSI)):
        stamps, values = flight[angle]
        off = (values - np.interp(stamps, TIME, truth) + math.pi) % (2.0 * math.pi) - math.pi
        assert np.max(np.abs(off)) < 1e-9
    assert any(names[0] in line and line.startswith("phi: ") for line in flight.columns)


def test_it_is_read_from_a_file_and_gaps_stay_gaps(tmp_path: Path) -> None:
    rows = np.column_stack([TIME, *parts()])
    lines = [",".join(f"{one:.9f}" for one in row) for row in rows.tolist()]
    lines[7] = f"{TIME[7]:.9f},,,,"
    (tmp_path / "log.csv").write_text("\n".join(["time_s,q0,q1,q2,q3", *lines]))
    table = read_table(tmp_path / "log.csv")
    columns, matched = table.matched()
    assert {use.signal for use in matched.uses} == {"phi", "theta", "psi"}
    phi = np.asarray(columns[next(use.headers[0] for use in matched.uses if use.signal == "phi")])
    assert np.isnan(phi[7])
    assert phi[8] == pytest.approx(PHI[8], abs=1e-6)


def test_what_is_no_attitude_is_none() -> None:
    q = parts()
    # Angles that stand beside it are the log's own word; a demanded attitude is none; nor are numbers of any length.
    assert quaternion_in(["time_s", "q0", "q1", "q2", "q3", "roll (deg)"]) == ()
    assert quaternion_in(["time_s", "q_d[0]", "q_d[1]", "q_d[2]", "q_d[3]"]) == ()
    assert quaternion_in(["time_s", "q", "q0", "q1", "q2"]) == ()
    for name in ("setpoint_q", "seq", "gimbal_q", "att_sp.q"):
        assert quaternion_in([f"{name}{k}" for k in range(4)]) == ()
    assert quaternion_in([f"orientation.{k}" for k in "wxyz"]) == ()
    # Of several the one with the shortest name, whatever stands first; none of which the user names a part.
    assert quaternion_in([f"ekf2.q{k}" for k in range(4)] + [f"q{k}" for k in range(4)]) == ("q0", "q1", "q2", "q3")
    table = {"time_s": TIME, **{f"q{k}": one for k, one in enumerate(q)}}
    named = Flight.from_frame(table, columns={"throttle": "q1"}, units={"throttle": "1"})
    assert set(named.signals.signals) == {"throttle"}
    flight = Flight.from_frame({"time_s": TIME, "q (rad/s)": q[0], **{f"q{k}": 7.0 * one for k, one in enumerate(q)}})
    assert set(flight.signals.signals) == {"q"}

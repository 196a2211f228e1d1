"""Live estimates on MAVLink, read by pymavlink."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import decode

from gcs.live.telemetry import EstimateTelemetry

REPORT = {
    "coefficients": {
        "CL_alpha": {"value": 2.45, "std": 0.01, "unit": "1/rad", "known": True},
        "Cm_de": {"value": 1.6, "std": 0.01, "unit": "1/rad", "known": True},
        "Cl_r": {"known": False, "why": "r has hardly moved", "fly": "rudder-multisine"},
    },
    "events": [],
    "warnings": ["airspeed reads 8% low: check the pitot tube and its calibration"],
}


def test_known_coefficients_are_said_once_a_second_and_each_text_once() -> None:
    said: list[bytes] = []
    tenths = range(0, 30, 4)  # three seconds
    clock = iter([7.0 + tenth / 10.0 for tenth in tenths])
    telemetry = EstimateTelemetry(said.extend, clock=lambda: next(clock))
    for tenth in tenths:
        warning = f"airspeed reads {8 + tenth % 3}% low: check the pitot tube and its calibration"
        telemetry.take({**REPORT, "warnings": [warning]}, 100.0 + tenth / 10.0)
    messages = decode(b"".join(said))
    values = [m for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert [m.name for m in values] == ["CL_alpha", "Cm_de"] * 3
    assert values[0].value == pytest.approx(2.45)
    assert values[2].time_boot_ms == 101_200
    texts = [m for m in messages if m.get_type() == "STATUSTEXT"]
    assert [m.chunk_seq for m in texts] == [0, 1]
    assert "".join(m.text for m in texts) == REPORT["warnings"][0]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(255, mavlink.MAV_COMP_ID_USER1)}


def test_a_change_is_said_as_critical() -> None:
    said: list[bytes] = []
    change = {"text": "the elevator: 52 % ± 6 since 40.1 s", "short": "ELEVATOR 52% +-6 since 40.1s"}
    failure = {"text": "the alpha vane is stuck since 12.0 s: check it", "short": "ALPHA VANE STUCK since 12.0s"}
    report = {"coefficients": {}, "events": [change, failure], "warnings": []}
    EstimateTelemetry(said.extend).take(report, 42.0)
    messages = decode(b"".join(said))
    assert [m.text for m in messages] == [change["short"], failure["short"]]
    assert {m.severity for m in messages} == {mavlink.MAV_SEVERITY_CRITICAL}


def test_what_a_flight_ended_with_is_said_though_its_time_stands_still() -> None:
    said: list[bytes] = []
    clock = iter([7.0, 7.4, 8.9, 9.3, 9.7])
    telemetry = EstimateTelemetry(said.extend, clock=lambda: next(clock))
    report = {"coefficients": {}, "events": [], "warnings": []}
    telemetry.take(report, 13.7)
    for value in (2.3, 2.4, 2.4, 2.5):
        telemetry.take({**report, "coefficients": {"CL_alpha": {"known": True, "value": value}}}, 14.0)
    assert [m.value for m in decode(b"".join(said))] == pytest.approx([2.4, 2.5])

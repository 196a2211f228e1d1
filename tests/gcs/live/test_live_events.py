"""What has failed or changed in flight, as the service reports it."""

from __future__ import annotations

import json
from dataclasses import replace

from gcs.live.events import events_json
from sysid.live.identifier import LiveReport
from sysid.live.recursive.causes import CAUSES, CauseFound
from sysid.live.recursive.change_detection import Change
from sysid.live.signals.sensor_failures import SensorFailure

KEYS = {"t", "kind", "cause", "probability", "alternatives", "size", "size_std", "text"}
REPORT = LiveReport(50.0, {}, {}, (), ())


def found(short: str, probability: float, size: float) -> CauseFound:
    return CauseFound(next(one for one in CAUSES if one.short == short), probability, size, 2.0)


def test_a_change_has_its_cause_and_what_else_it_may_be() -> None:
    causes = (found("ELEVATOR STUCK", 0.7, 3.0), found("TAILPLANE", 0.2, 60.0), found("CG", 0.1, 4.0))
    change = Change(40.1, "Cm", "Cm_de", 1.59, 0.82, 0.05, causes)
    (event,) = events_json(replace(REPORT, changes=(change,)))
    assert event.keys() > KEYS
    assert (event["t"], event["kind"], event["cause"]) == (40.1, "aircraft", "elevator_stuck")
    assert (event["probability"], event["size"], event["size_std"], event["unit"]) == (0.7, 3.0, 2.0, "deg")
    assert [(one["cause"], one["probability"]) for one in event["alternatives"]] == [("tailplane", 0.2), ("cg", 0.1)]
    assert event["text"].startswith("the elevator, stuck: 3.0 deg ± 2 since 40.1 s")


def test_a_change_without_a_likely_cause_is_unknown_and_says_what_it_may_be() -> None:
    change = Change(40.1, "Cm", "Cm_de", 1.59, 0.82, 0.05, (found("ELEVATOR", 0.4, 50.0), found("CG", 0.35, 4.0)))
    (event,) = events_json(replace(REPORT, changes=(change,)))
    assert (event["cause"], event["probability"], event["size"], event["size_std"]) == ("unknown", None, None, None)
    assert [one["cause"] for one in event["alternatives"]] == ["elevator", "cg"]


def test_sensors_come_first_and_say_when_it_was_over() -> None:
    lost = SensorFailure(20.0, "gps_lost", "gps", 1.0, "", "no reading of the GPS", "its wire", until_s=25.3)
    step = SensorFailure(24.2, "q_step", "q", 1.6, "deg/s", "gyro q stepped by +1.6 deg/s")
    change = Change(40.1, "Cm", "Cm_de", 1.59, 0.82, 0.05)
    events = events_json(replace(REPORT, failures=(lost, step), changes=(change,)))
    assert [one["kind"] for one in events] == ["sensor", "sensor", "aircraft"]
    assert events[0]["text"] == "no reading of the GPS from 20.0 to 25.3 s: check its wire"
    assert (events[0]["until"], events[0]["size"]) == (25.3, None)
    assert events[0]["short"] == "GPS LOST 20.0s to 25.3s"
    assert (events[1]["cause"], events[1]["size"], events[1]["unit"]) == ("q_step", 1.6, "deg/s")
    json.dumps(events, allow_nan=False)

"""A failure in flight, streamed as fast as it was flown and faster: the same cause, size and coefficients."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_live_signals import datagrams
from traffic import SECOND

from gcs.links.datagrams import Batch
from gcs.live.events import events_json
from gcs.live.messages import VehicleMessages
from gcs.live.signals import SignalStream
from gcs.mavlink.dialect import Dialect
from sim_vehicle.cli.main import main as sim_vehicle
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport

pytestmark = pytest.mark.whole_flight

TURN = SECOND // 25  # as the live process looks for what has come
REPORT = 0.4  # s of flight


def streamed(path: Path, pace: float) -> LiveReport:
    """What is known at the end of a flight that comes so many times faster, behind a radio that holds up to 20 ms."""
    vehicle = load_vehicle("iitb-mav")
    stream, live = SignalStream(vehicle), LiveIdentifier(vehicle)
    messages = VehicleMessages(Dialect.load(), stream.messages)
    sent, random = list(datagrams(path)), np.random.default_rng(5)
    first = sent[0][1]
    held = [round(random.uniform(0.0, 0.02 * SECOND)) for _ in sent]
    received = np.maximum.accumulate(
        [first + round((at - first) / pace) + late for (_, at), late in zip(sent, held, strict=True)]
    )
    report, due = live.report(), 0.0
    for turn in np.unique(received // TURN):
        inside = np.flatnonzero(received // TURN == turn)
        batch = Batch.of([(sent[i][0], int(received[i])) for i in inside], "radio")
        samples = stream.take(messages.take([batch]), messages.autopilot)
        live.take({name: (one.time_s, one.values) for name, one in samples.items()})
        if (now := (sent[int(inside[-1])][1] - first) / SECOND) >= due:
            report, due = live.report(), now + REPORT
    return report


@pytest.mark.parametrize(("failure", "kind", "cause"), [("elevator=0.5", "aircraft", "elevator"),
                                                        ("gyro-q=0.035", "sensor", "q_step")])  # fmt: skip
def test_a_failure_is_the_same_at_any_pace(tmp_path: Path, failure: str, kind: str, cause: str) -> None:
    path = tmp_path / "flight.tlog"
    sim_vehicle(
        ["fly", "--manoeuvre", "multisine", "--duration", "36", "--fail", f"{failure}@24", "--record", str(path)]
    )
    asit = streamed(path, 1.0)
    (event,) = events_json(asit)
    assert (event["kind"], event["cause"]) == (kind, cause)
    for pace in (5.0, 10.0):
        faster = streamed(path, pace)
        (same,) = events_json(faster)
        assert (same["kind"], same["cause"]) == (kind, cause)
        assert same["t"] == pytest.approx(event["t"], abs=0.3)
        for name in ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta"):
            before, after = asit.coefficients[name], faster.coefficients[name]
            assert abs(after.value - before.value) < 0.3 * 1.96 * before.std, name

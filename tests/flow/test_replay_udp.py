"""A recording shipped with the tests goes over a real UDP socket into another process, and gives the same model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from processes import free_port, recording_station, run
from same_result import assert_same_result, estimates
from wire_streams import wire_streams

from gcs.cli import main
from gcs.recording.reader import MessageColumns, Recording

FLIGHT = Path(__file__).parent / "data" / "multisine.mcap"
# What the aircraft was flown with: the paper's printed coefficients and sensor errors.
TRUTH = {
    "CL_0": 0.1784, "CL_alpha": 2.453, "CL_de": 0.7405, "CD_0": 0.0871, "CD_k": 0.4, "Cm_0": 0.0385,
    "Cm_alpha": -0.5998, "Cm_de": 1.5894, "Cl_beta": -0.08, "Cl_p": -0.45, "Cl_da": 0.15, "Cn_beta": 0.08,
    "Cn_r": -0.12, "Cn_dr": -0.08, "accel_bias_x": 0.1962, "accel_bias_z": 0.1962, "gyro_bias_q": 0.0043633,
    "alpha_scale": 0.005,
}  # fmt: skip


def identified(path: Path, target: Path) -> dict[str, Any]:
    assert main(["identify", str(path), "--vehicle", "iitb-mav", "-o", str(target)]) == 0
    return dict(json.loads(target.read_text(encoding="utf-8")))


def counters(recording: Recording) -> NDArray[np.int64]:
    """The sender's counter of every message, in its own order."""
    every = [recording.columns(name)[0].sequence for name in recording.messages()]
    return np.sort(np.concatenate(every))


def assert_same_messages(given: MessageColumns, sent: MessageColumns) -> None:
    assert (given.system, given.component) == (sent.system, sent.component)
    np.testing.assert_array_equal(given.fields, sent.fields)
    # Where the counter starts to be unwrapped from depends on the recording; its steps do not.
    np.testing.assert_array_equal(np.diff(given.sequence), np.diff(sent.sequence))
    assert np.all(np.diff(given.log_time) >= 0)


@pytest.fixture(scope="module")
def original() -> Recording:
    return Recording(FLIGHT)


@pytest.fixture(scope="module")
def received(original: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What another process recorded of the flight replayed at five times its pace."""
    path = tmp_path_factory.mktemp("replay") / "received.mcap"
    port = free_port()
    with recording_station(f"udpin:127.0.0.1:{port}", path, sum(original.counts().values())):
        done = run("gcs", "replay", FLIGHT, "--out", f"udpout:127.0.0.1:{port}", "--speed", 5)
        assert done.returncode == 0, done.stderr
    return path


def test_every_message_arrives_as_it_was(original: Recording, received: Path) -> None:
    again = Recording(received)
    assert again.counts() == original.counts()
    assert sum(again.lost().values()) == 0
    assert list(again.damage.notes) == []
    for name in original.messages():
        (sent,), (given,) = original.columns(name), again.columns(name)
        assert_same_messages(given, sent)
    np.testing.assert_array_equal(np.diff(counters(again)), 1)


def test_the_bytes_of_the_wire_are_the_same(original: Recording, received: Path) -> None:
    def wire(recording: Recording) -> bytes:
        (stream,) = wire_streams(recording).values()
        return b"".join(data for _, data in stream)

    assert wire(Recording(received)) == wire(original)


def test_identification_does_not_depend_on_when_the_messages_came(received: Path, tmp_path: Path) -> None:
    first = identified(FLIGHT, tmp_path / "first.json")
    again = identified(received, tmp_path / "again.json")
    assert_same_result(again, first, relative=1e-6)
    # RPM carries no stamp, so its samples lie where reception put them; the estimate does not use it.
    assert [line for line in again["warnings"] if not line.startswith("rpm:")] == first["warnings"]
    found = estimates(again)
    for name, true in TRUTH.items():
        assert found[name] == pytest.approx(true, rel=0.01, abs=4.0 * found[f"{name} std"]), name

"""Aircraft that JSBSim flies and breaks, with inputs that never pause: what failed is named within seconds."""

from __future__ import annotations

from pathlib import Path

import pytest
from jsbsim_failures import broken_flight
from live_flights import Here, pieces

from sysid.live.identifier import LiveIdentifier

FAILS_AT_S, EVERY_S = 24.0, 0.4


@pytest.mark.parametrize(
    ("case", "gusts", "seed", "cause", "size"),
    # Sizes of a moved centre of gravity are up to 1.5 % of the chord off, at four of their bars.
    [("elevator=0.5", 0.0, 911, "ELEVATOR", 50.0), ("cg=0.05", 0.3, 912, "CG", None)],
)
def test_what_breaks_in_another_engines_flight_is_named(
    case: str, gusts: float, seed: int, cause: str, size: float | None, tmp_path: Path
) -> None:
    signals, vehicle = broken_flight(tmp_path, case, FAILS_AT_S, 32.0, gusts, seed, kind="multisine")
    live = LiveIdentifier(vehicle, Here())
    report = live.report()
    for samples in pieces(signals, EVERY_S):
        live.take(samples)
        report = live.report()
        if any(change.causes for change in report.changes):
            break
    (change,) = report.changes
    assert report.time_s < FAILS_AT_S + 5.0
    assert abs(change.time_s - FAILS_AT_S) < 1.5
    assert report.failures == ()
    # A tailplane that is lost in part moves the centre of lift as a centre of gravity that moves does.
    likely = {one.cause.short: one for one in change.causes[:3]}
    assert cause in likely
    if size is not None:
        found = likely[cause]
        assert found.size is not None
        assert found.std is not None
        assert abs(found.size - size) < 3.0 * found.std + 0.03 * size

"""Statistics of links against what was sent, dropped, doubled and delayed on purpose."""

import random
import tracemalloc

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import Vehicle

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.station.linkstats import LinkStatistics, merged

DIALECT = Dialect.load()
NOW = 1_790_000_000 * 1_000_000_000


def fed(*batches: list[bytes]) -> dict[str, object]:
    """Statistics of a source that brought these batches."""
    statistics, framer = LinkStatistics(DIALECT), Framer(DIALECT)
    for batch in batches:
        _, frames = framer.feed(b"".join(batch))
        statistics.add(frames, np.full(len(frames), NOW))
    return statistics.to_json(NOW)


def component(statistics: dict[str, object]) -> dict[str, int]:
    (system,) = statistics["systems"]  # type: ignore[misc]
    (entry,) = system["components"]
    return entry  # type: ignore[no-any-return]


def test_duplicates_and_late_frames_are_not_lost() -> None:
    vehicle = Vehicle()
    sent = [vehicle.attitude(0.001 * i) for i in range(1000)]
    chooser = random.Random(1)
    arrivals: list[tuple[float, bytes]] = []
    for i, frame in enumerate(sent):
        if chooser.random() < 0.1 and 0 < i < 999:
            continue
        arrivals.append((i, frame))
        if chooser.random() < 0.2:
            arrivals.append((i + chooser.uniform(0.5, 18.0), frame))
    kept = len({frame for _, frame in arrivals})
    arrivals = [(at + (chooser.uniform(0, 12) if i > 0 else 0), frame) for i, (at, frame) in enumerate(arrivals)]
    order = [frame for _, frame in sorted(arrivals, key=lambda entry: entry[0])]
    counts = component(fed(order[:300], order[300:301], order[301:]))
    assert counts["received"] == kept
    assert counts["duplicates"] == len(arrivals) - kept
    assert counts["lost"] == pytest.approx(1000 - kept, abs=1)
    assert counts["loss"] == pytest.approx((1000 - kept) / 1000, abs=0.002)


def test_a_gap_of_many_frames_is_counted_whole_and_over_the_wrap_of_the_counter() -> None:
    vehicle = Vehicle()
    sent = [vehicle.attitude(0.001 * i) for i in range(600)]
    counts = component(fed(sent[:250] + sent[400:]))
    assert (counts["received"], counts["lost"], counts["duplicates"]) == (450, 150, 0)


def test_many_senders_are_told_apart() -> None:
    vehicles = [Vehicle(system, part) for system in range(1, 41) for part in (1, 100)]
    rounds = [[vehicle.heartbeat() for vehicle in vehicles] for _ in range(5)]
    del rounds[2][17]
    statistics = fed(*rounds)
    systems = statistics["systems"]
    assert isinstance(systems, list)
    assert [entry["system"] for entry in systems] == list(range(1, 41))
    found = {(s["system"], c["component"]): (c["received"], c["lost"]) for s in systems for c in s["components"]}
    assert found.pop((9, 100)) == (4, 1)
    assert set(found.values()) == {(5, 0)}


@pytest.mark.parametrize("name", ["radio_status", "radio"])
def test_the_radios_report_is_shown_as_it_was_sent(name: str) -> None:
    vehicle, radio = Vehicle(), Vehicle(51, 68)
    kind = getattr(mavlink, f"MAVLink_{name}_message")
    values = {"rssi": 200, "remrssi": 190, "txbuf": 100, "noise": 40, "remnoise": 50, "rxerrors": 7, "fixed": 300}
    old = radio.frame(kind(1, 2, 3, 4, 5, 6, 7))
    new = radio.frame(kind(**values))
    assert fed([vehicle.attitude()])["radio"] is None
    shown = fed([old, vehicle.attitude(), new], [vehicle.attitude()])["radio"]
    assert shown == {"system": 51, "component": 68, "received_ns": NOW, **values}
    quiet = dict.fromkeys(values, 0)  # all zero, so that MAVLink 2 sends one byte of payload
    shown = fed([radio.frame(kind(**quiet))])["radio"]
    assert shown == {"system": 51, "component": 68, "received_ns": NOW, **quiet}


def test_noise_and_broken_frames_are_counted_and_sources_add_up() -> None:
    vehicle = Vehicle()
    broken = bytearray(vehicle.attitude(1.0))
    broken[-1] ^= 1
    first = fed([vehicle.attitude(), b"noise", bytes(broken), vehicle.attitude()])
    second = fed([Vehicle(2).attitude(), b"!"], [Vehicle(2).heartbeat()])
    assert first["raw_bytes"] == 5 + len(broken)
    assert first["bad_crc"] == 1
    whole = merged([("udpin:x", first), ("udpin:x#2", second)])
    assert whole["frames"] == 4
    assert whole["raw_bytes"] == 5 + len(broken) + 1
    assert whole["unsigned"] == 4
    assert [(entry["system"], entry["source"]) for entry in whole["systems"]] == [(1, "udpin:x"), (2, "udpin:x#2")]


def test_a_source_that_names_thousands_of_senders_costs_little_memory_and_no_frame() -> None:
    sent = [Vehicle(system, component).system_time for system in range(1, 65) for component in range(1, 65)]
    batches = [[make() for make in sent[i : i + 512]] for i in range(0, len(sent), 512)]
    fed([Vehicle().system_time()])  # what is loaded once is not counted
    tracemalloc.start()
    try:
        statistics = fed(*batches)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert statistics["frames"] == 4096
    assert statistics["other_senders"] == 4096 - 256
    systems: list[dict[str, object]] = statistics["systems"]  # type: ignore[assignment]
    assert sum(len(system["components"]) for system in systems) == 256  # type: ignore[arg-type]
    assert most < 24e6

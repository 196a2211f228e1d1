"""The bad link by itself: shares and delays against the distributions they were asked to have."""

from functools import cache

import numpy as np
import pytest

from sim_vehicle.mavlink.fault_options import FaultError, Faults, read_faults
from sim_vehicle.mavlink.faulty_link import Arrival, FaultyLink

COUNT = 20_000


def frame(number: int) -> bytes:
    return number.to_bytes(4, "big") + bytes(36)


def sent(text: str, seed: int = 1, count: int = COUNT, every_s: float = 0.02) -> list[Arrival]:
    """What arrives of `count` frames, one burst each."""
    link = FaultyLink(read_faults([text]), np.random.SeedSequence(seed))
    return [item for k in range(count) for item in link.send(frame(k), k * every_s)] + link.rest()


def numbers(arrivals: list[Arrival]) -> list[int]:
    return [int.from_bytes(data[:4], "big") for _, data in arrivals]


def test_a_good_link_changes_nothing() -> None:
    assert sent("loss=0", count=100) == [(k * 0.02, frame(k)) for k in range(100)]


def test_the_same_seed_fails_alike_and_another_differently() -> None:
    text = "loss=0.1,jitter=0.03,late=0.2,duplicate=0.1,reorder=0.1,corrupt=1e-3,garbage=0.1"
    assert sent(text, 4, 2000) == sent(text, 4, 2000)
    assert sent(text, 4, 2000) != sent(text, 5, 2000)


def test_loss() -> None:
    left = numbers(sent("loss=0.05"))
    assert left == sorted(set(left))
    # Binomial: five standard deviations of the share lost.
    assert 1.0 - len(left) / COUNT == pytest.approx(0.05, abs=5.0 * (0.05 * 0.95 / COUNT) ** 0.5)


Fates = dict[int, object]
FAULTS = {
    **{"loss": "0.2", "outage": "50:150", "delay": "0.1", "jitter": "0.03", "late": "0.3:0.2", "duplicate": "0.2"},
    **{"reorder": "0.2", "corrupt": "1e-3", "garbage": "0.2"},
}
BODY = 10  # repeats of the number that a frame carries, so that flipped bits do not hide it


def number_of(data: bytes) -> int:
    """The number that a frame carries: of each bit what most of its repeats say."""
    repeats = np.unpackbits(np.frombuffer(data[-4 * BODY :], np.uint8).reshape(BODY, 4), axis=1)
    return int.from_bytes(np.packbits(repeats.mean(axis=0) > 0.5).tobytes(), "big")


@cache
def fates(*names: str, count: int = 300) -> dict[str, Fates]:
    """What each fault did to each frame, one frame a second; of frames that came, but for loss and outages."""
    link = FaultyLink(read_faults([f"{name}={FAULTS[name]}" for name in names]), np.random.SeedSequence(9))
    calls = [link.send(k.to_bytes(4, "big") * BODY, float(k)) for k in range(count)]
    arrived = [(number_of(data), data) for call in [*calls, link.rest()] for _, data in call]
    first = dict(reversed(arrived))
    times = {k: call[0][0] - k for k, call in enumerate(calls) if call}
    return {
        "came": dict.fromkeys(first, True),
        "times": dict(times),
        "duplicate": {number: sum(other == number for other, _ in arrived) for number in first},
        "reorder": {number: place for place, number in enumerate(dict.fromkeys(number for number, _ in arrived))},
        "corrupt": {number: bytes(np.bitwise_xor(*flips(number, data)).tolist()) for number, data in first.items()},
        "garbage": {number: data[: -4 * BODY] for number, data in first.items()},
    }


def flips(number: int, data: bytes) -> tuple[np.ndarray, np.ndarray]:
    sent = number.to_bytes(4, "big") * BODY
    return np.frombuffer(data[-4 * BODY :], np.uint8), np.frombuffer(sent, np.uint8)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_turned_on_leaves_every_other_as_it_was(fault: str) -> None:
    alone = fates(fault)
    observed = "came" if fault in ("loss", "outage") else "times" if fault in ("delay", "jitter", "late") else fault
    none = fates()
    assert alone[observed] != none[observed]
    for other in FAULTS.keys() - {fault}:
        both, without = fates(*sorted((fault, other))), fates(other)
        common = both[observed].keys() & alone[observed].keys()
        if observed == "came":
            assert both["came"].keys() == alone["came"].keys() & without["came"].keys()
        elif observed == "times":  # frames are so far apart that delays add up
            added = [both["times"][k] - without["times"][k] for k in common]
            assert added == pytest.approx([alone["times"][k] for k in common], abs=1e-9)
        elif observed == "reorder":
            assert sorted(common, key=both["reorder"].get) == sorted(common, key=alone["reorder"].get)
        else:
            assert {k: both[observed][k] for k in common} == {k: alone[observed][k] for k in common}


def test_delay_and_jitter() -> None:
    arrivals = sent("delay=0.1,jitter=0.03", every_s=1.0)  # far apart, so that none holds up the next
    late = np.array([when for when, _ in arrivals]) - np.arange(COUNT)
    assert late.min() >= 0.1
    # Exponential: mean and standard deviation are both the jitter.
    assert np.mean(late) - 0.1 == pytest.approx(0.03, abs=5.0 * 0.03 / COUNT**0.5)
    assert np.std(late) == pytest.approx(0.03, rel=0.05)


def test_what_leaves_together_stays_together_and_the_order_is_kept() -> None:
    link = FaultyLink(read_faults(["jitter=0.05"]), np.random.SeedSequence(3))
    arrivals = [item for k in range(900) for item in link.send(frame(k), (k // 9) * 0.02)]
    times = [when for when, _ in arrivals]
    assert numbers(arrivals) == list(range(900))
    assert times == sorted(times)
    assert all(len(set(times[k : k + 9])) == 1 for k in range(0, 900, 9))


def test_late_bursts() -> None:
    late = np.array([when for when, _ in sent("late=0.2:0.5", every_s=1.0)]) - np.arange(COUNT)
    assert np.mean(late > 0.0) == pytest.approx(0.2, abs=5.0 * (0.2 * 0.8 / COUNT) ** 0.5)
    assert np.mean(late[late > 0.0]) == pytest.approx(0.25, abs=5.0 * 0.5 / (12 * 0.2 * COUNT) ** 0.5)
    assert late.max() <= 0.5
    overtaken = numbers(sorted(sent("late=0.2:0.5"), key=lambda arrival: arrival[0]))
    assert overtaken != sorted(overtaken)
    assert sorted(overtaken) == list(range(COUNT))


def test_duplicates() -> None:
    found = numbers(sent("duplicate=0.02"))
    assert sorted(set(found)) == list(range(COUNT))
    assert len(found) / COUNT - 1.0 == pytest.approx(0.02, abs=5.0 * (0.02 * 0.98 / COUNT) ** 0.5)


def test_reordered_frames_come_a_little_later() -> None:
    found = np.array(numbers(sent("reorder=0.1")))
    assert sorted(found) == list(range(COUNT))
    # A frame held back is passed by at least one other, unless that is held back as well.
    assert np.mean(np.diff(found) < 0) == pytest.approx(0.1, abs=0.03)
    assert np.abs(found - np.arange(COUNT)).max() < 20


def test_flipped_bits() -> None:
    arrivals = sent("corrupt=1e-3")
    assert all(len(data) == 40 for _, data in arrivals)
    wrong = sum(
        (int.from_bytes(data, "big") ^ int.from_bytes(frame(k), "big")).bit_count()
        for k, (_, data) in enumerate(arrivals)
    )
    expected = COUNT * 320 * 1e-3
    assert wrong == pytest.approx(expected, abs=5.0 * expected**0.5)


def test_garbage_stands_in_front_of_whole_frames() -> None:
    arrivals = sent("garbage=0.1")
    assert all(data.endswith(frame(k)) for k, (_, data) in enumerate(arrivals))
    added = np.array([len(data) - 40 for _, data in arrivals])
    assert np.mean(added > 0) == pytest.approx(0.1, abs=5.0 * (0.1 * 0.9 / COUNT) ** 0.5)
    assert added.max() <= 64


def test_outages() -> None:
    left = [number * 0.02 for number in numbers(sent("outage=10:15,outage=20:21", count=2000))]
    assert not [time_s for time_s in left if 10.0 <= time_s < 15.0 or 20.0 <= time_s < 21.0]
    assert len(left) == 2000 - 250 - 50


def test_every_fault_is_read() -> None:
    texts = ["loss=0.05,delay=0.1,jitter=0.03,late=0.2:0.3", "drift-ppm=50,clock-reset=20", "outage=1:2,clock-reset=9"]
    assert read_faults(texts) == Faults(
        loss=0.05,
        delay=0.1,
        jitter=0.03,
        late=0.2,
        late_s=0.3,
        drift_ppm=50.0,
        outages=((1.0, 2.0),),
        resets=(9.0, 20.0),
    )
    assert not read_faults(["drift-ppm=50,clock-reset=20"]).on_link
    assert read_faults(["outage=1:2"]).on_link


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rain=1", "no such fault; there are loss, delay"),
        ("", "no such fault"),
        ("loss", "give loss=VALUE"),
        ("loss=1.5", "from 0 to 1"),
        ("loss=-0.1", "from 0 to 1"),
        ("loss=nan", "'nan' is no number"),
        ("loss=much", "'much' is no number"),
        ("delay=1000", "seconds, from 0 to 60"),
        ("jitter=-1", "from 0 to 10"),
        ("late=0.1:0", "SECONDS above 0"),
        ("corrupt=0.5", "from 0 to 0.1"),
        ("outage=5", "outage=BEGIN:END"),
        ("outage=15:10", "END after BEGIN"),
        ("drift-ppm=1e9", "from -10000 to 10000"),
        ("clock-reset=0", "above 0"),
    ],
)
def test_a_wrong_fault_is_one_line(text: str, words: str) -> None:
    with pytest.raises(FaultError, match=words) as caught:
        read_faults([text])
    assert "\n" not in str(caught.value)

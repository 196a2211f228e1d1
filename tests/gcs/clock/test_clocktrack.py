"""The vehicles' clocks as they are followed in flight, against clocks and delays that are known."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.clock.timesync import request
from gcs.clock.track import ClockState, ClockTracker, clock_metadata, rate_text
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.station.linkstats import LinkStatistics

UTC = 1_790_000_000 * 10**9
DIALECT = Dialect.load()


class Air:
    """Frames of several components, each given with the moment it arrives; read by a tracker in small batches."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []
        self._senders: dict[tuple[int, int], mavlink.MAVLink] = {}

    def say(self, arrived_ns: int, message: mavlink.MAVLink_message, sender: tuple[int, int] = (1, 1)) -> None:
        mav = self._senders.setdefault(sender, mavlink.MAVLink(None, *sender))
        self.frames.append((int(arrived_ns), bytes(message.pack(mav))))
        mav.seq = (mav.seq + 1) % 256

    def heard(self, tracker: ClockTracker | None = None, size: int = 7) -> ClockTracker:
        tracker = tracker or ClockTracker(DIALECT)
        framer = Framer(DIALECT)
        ordered = sorted(self.frames, key=lambda frame: frame[0])
        for first in range(0, len(ordered), size):
            part = ordered[first : first + size]
            _, frames = framer.feed(b"".join(data for _, data in part))
            assert len(frames) == len(part)
            tracker.add(frames, np.array([at for at, _ in part], np.int64))
        self.frames.clear()
        return tracker


def attitude(boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_message(int(boot_ns) // 10**6 % 2**32, 0.1, 0, 0, 0, 0, 0)


def highres(boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_highres_imu_message(int(boot_ns) // 1000, *[0.0] * 13, 63)


def fly(
    air: Air,
    *,
    seconds: float = 120.0,
    rate_hz: float = 20.0,
    drift_ppm: float = 0.0,
    pace: float = 1.0,
    boot_s: float = 40.0,
    start_ns: int = UTC,
    jitter_s: float = 0.03,
    seed: int = 0,
    sender: tuple[int, int] = (1, 1),
) -> None:
    """HIGHRES_IMU of a vehicle whose clock is `drift_ppm` fast, 5 ms away at least, a fifth of the packets late."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    sent = np.arange(n) / rate_hz
    late = (rng.random(n) < 0.2) * rng.uniform(0.05, 0.5, n)
    arrived = sent + 0.005 + rng.exponential(jitter_s, n) + late
    boot = boot_s + sent * pace * (1 + drift_ppm * 1e-6)
    for at, stamp in zip(arrived, boot, strict=True):
        air.say(start_ns + round(at * 1e9), highres(round(stamp * 1e9)), sender)


def state_of(tracker: ClockTracker, system: int = 1) -> ClockState:
    state = tracker.state(system)
    assert state is not None
    return state


def test_drift_and_offset_under_jitter_and_late_packets_with_honest_errors() -> None:
    inside = []
    for seed in range(8):
        air = Air()
        fly(air, drift_ppm=50.0, seconds=200, rate_hz=10.0, seed=seed)
        state = state_of(air.heard())
        assert state.drift_ppm == pytest.approx(50.0, abs=8.0)
        # At the last stamp: the boot was 40 s before the start, 5 ms of delay, and the clock has gained since.
        offset = UTC / 1e9 - 40.0 + 0.005 - 200 * 50e-6
        assert state.offset_s == pytest.approx(offset, abs=2e-3)
        assert state.drift_std_ppm is not None
        assert state.offset_std_s is not None
        assert state.jitter_s == pytest.approx(0.1, abs=0.08)
        assert state.rate == pytest.approx(1.00005, abs=1e-5)
        inside.append(abs(state.drift_ppm - 50.0) < 1.96 * state.drift_std_ppm)  # type: ignore[operator]
    assert sum(inside) >= 6


def test_a_simulation_at_five_times_is_named_and_has_no_drift() -> None:
    air = Air()
    fly(air, pace=5.0, seconds=30)
    state = state_of(air.heard())
    assert state.rate == pytest.approx(5.0, rel=1e-3)
    assert (state.drift_ppm, state.drift_std_ppm, state.resets) == (None, None, 0)
    assert state.text() == "runs at 5.00 times real time"
    assert rate_text(1.00005, 50.0, 0.5) == "drift 50.0 ± 0.98 ppm"
    assert rate_text(None, None, None) == ""


def test_a_reboot_starts_anew_and_is_counted_once_though_messages_interleave() -> None:
    air = Air()
    fly(air, seconds=60, boot_s=900.0)
    fly(air, seconds=60, boot_s=2.0, start_ns=UTC + 61 * 10**9, seed=1)
    for tenth in range(600):  # another message, whose last ones before the reboot arrive among the first after it
        air.say(UTC + tenth * 10**8 + 1_530_000_000, attitude((9000 + tenth) * 10**8))
        air.say(UTC + 61 * 10**9 + tenth * 10**8 + 10**7, attitude((20 + tenth) * 10**8))
    tracker = air.heard()
    before = tracker.state(1, until_ns=UTC + 60 * 10**9)
    assert before is not None
    assert before.resets == 0
    assert before.offset_s == pytest.approx(UTC / 1e9 - 900.0 + 0.005, abs=2e-3)
    state = state_of(tracker)
    assert state.resets == 1
    assert state.offset_s == pytest.approx(UTC / 1e9 + 61 - 2.0 + 0.005, abs=2e-3)


@pytest.mark.parametrize("stray_s", [1.0, 899.0, 60_000.0])
def test_single_stray_or_missing_stamps_restart_nothing(stray_s: float) -> None:
    air = Air()
    fly(air, seconds=60, boot_s=900.0)
    for second in (10, 20, 30, 31):
        air.say(UTC + second * 10**9, highres(0))
        air.say(UTC + second * 10**9, highres(round((stray_s + second / 100) * 1e9)))
    air.say(UTC + 40 * 10**9, highres(UTC))  # a stamp since 1970 is not on this clock
    state = state_of(air.heard())
    assert state.resets == 0
    assert state.offset_s == pytest.approx(UTC / 1e9 - 900.0 + 0.005, abs=2e-3)


def test_a_held_up_link_that_brings_messages_out_of_order_restarts_nothing() -> None:
    air = Air()
    order = np.random.default_rng(4).permutation(120)
    for i in range(1200):
        held = 400 <= i < 520
        air.say(
            UTC + (26 * 10**9 + int(order[i - 400]) * 10**6 if held else i * 50_000_000), highres(i * 50_000_000 + 1)
        )
    state = state_of(air.heard())
    assert state.resets == 0
    assert state.offset_s == pytest.approx(UTC / 1e9, abs=1e-3)


def test_stamps_of_32_bits_go_on_over_their_turn() -> None:
    air = Air()
    boot = 2**32 * 10**6 - 30 * 10**9
    for i in range(1200):
        air.say(UTC + i * 50_000_000, attitude(boot + i * 50_000_000))
    state = state_of(air.heard())
    assert state.resets == 0
    assert state.offset_s == pytest.approx((UTC - boot) / 1e9, abs=2e-3)
    assert state.drift_ppm == pytest.approx(0.0, abs=20.0)


def test_systems_and_components_have_clocks_of_their_own_and_the_autopilot_counts() -> None:
    air = Air()
    for system in range(1, 8):
        for component in (158, 1):
            fly(air, seconds=15, rate_hz=5, boot_s=10.0 * system + component, sender=(system, component))
    tracker = air.heard()
    assert tracker.systems() == list(range(1, 8))
    for system in range(1, 8):
        state = state_of(tracker, system)
        assert state.component == 1
        assert state.offset_s == pytest.approx(UTC / 1e9 - 10.0 * system - 1, abs=0.05)
    assert tracker.state(9) is None


def round_trips(air: Air, count: int, *, there_s: float, back_s: float, boot_s: float, start_ns: int = UTC) -> None:
    """Replies to the station's requests, the quickest of which take `there_s` and `back_s`."""
    rng = np.random.default_rng(5)
    for second in range(count):
        asked = request(start_ns + second * 10**9)
        arrived = second + there_s + rng.exponential(0.02)
        boot = round((boot_s + arrived) * 1e9)
        air.say(
            start_ns + round((arrived + back_s + rng.exponential(0.02)) * 1e9),
            mavlink.MAVLink_timesync_message(boot, asked.ts1),
        )


def test_round_trips_part_the_delay_from_the_offset() -> None:
    air = Air()
    fly(air, seconds=100, boot_s=40.0)
    round_trips(air, 100, there_s=0.005, back_s=0.005, boot_s=40.0)
    state = state_of(air.heard())
    assert state.delay_s == pytest.approx(0.005, abs=0.003)
    assert state.round_trip_s == pytest.approx(0.01 + 2 * 0.02 * 0.84, abs=0.01)  # the median of two waits
    assert state.offset_s == pytest.approx(UTC / 1e9 - 40.0, abs=2e-3)  # without the 5 ms of the way
    assert state.offset_bound_s == pytest.approx(state.delay_s, abs=0.003)
    assert state.offset_std_s is not None
    assert 0.0 < state.offset_std_s < 2e-3


def test_a_lopsided_way_stays_within_its_bound() -> None:
    air = Air()
    fly(air, seconds=60, boot_s=40.0)
    round_trips(air, 60, there_s=0.08, back_s=0.005, boot_s=40.0)
    state = state_of(air.heard())
    assert state.offset_s is not None
    assert state.offset_bound_s is not None
    error = abs(state.offset_s - (UTC / 1e9 - 40.0))
    assert error == pytest.approx(0.0375, abs=4e-3)  # half of what one way is longer
    assert error < state.offset_bound_s


def test_round_trips_alone_are_a_clock_and_requests_of_others_are_none() -> None:
    air = Air()
    round_trips(air, 30, there_s=0.005, back_s=0.005, boot_s=40.0)
    tracker = air.heard()
    assert state_of(tracker).offset_s == pytest.approx(UTC / 1e9 - 40.0, abs=5e-3)
    for second in range(30):
        at = UTC + second * 10**9
        air.say(at, mavlink.MAVLink_timesync_message(0, request(at).ts1), (255, 190))  # another station asks
        air.say(at, mavlink.MAVLink_timesync_message(10**9, at), (7, 1))  # an answer to it, in whole microseconds
        air.say(at, mavlink.MAVLink_timesync_message(10**9, request(at + 10**9).ts1), (7, 1))  # from the future
        air.say(at, mavlink.MAVLink_timesync_message(10**9, request(at - 11 * 10**9).ts1), (7, 1))  # long ago
    air.heard(tracker)
    assert tracker.systems() == [1]


def test_a_reply_that_comes_twice_counts_once() -> None:
    air = Air()
    reply = mavlink.MAVLink_timesync_message(50 * 10**9, request(UTC).ts1)
    air.say(UTC + 10**7, reply)
    air.say(UTC + 5 * 10**8, reply)
    assert state_of(air.heard()).round_trip_s == pytest.approx(0.01, abs=1e-5)


def test_memory_does_not_grow_and_ten_minutes_are_looked_back() -> None:
    air = Air()
    fly(air, seconds=1500, rate_hz=1, drift_ppm=100.0, jitter_s=0.001)
    tracker = air.heard(size=40)
    held = sum(array.nbytes for array in vars(tracker).values() if isinstance(array, np.ndarray))
    assert held < 500_000
    assert state_of(tracker).drift_ppm == pytest.approx(100.0, abs=2.0)


def test_the_statistics_of_a_link_and_the_metadata_of_a_recording_tell_the_clock() -> None:
    air = Air()
    fly(air, seconds=60, drift_ppm=50.0)
    statistics = LinkStatistics(DIALECT)
    framer = Framer(DIALECT)
    for at, data in sorted(air.frames):
        _, frames = framer.feed(data)
        statistics.add(frames, np.array([at]))
    (system,) = statistics.to_json(UTC)["systems"]
    assert system["clock_drift_ppm"] == pytest.approx(50.0, abs=30.0)
    assert system["clock_resets"] == 0
    metadata = clock_metadata("udpin:0.0.0.0:14550", statistics.clocks())
    assert list(metadata) == ["clock/1/udpin:0.0.0.0:14550"]
    record = metadata["clock/1/udpin:0.0.0.0:14550"]
    assert record["system"] == "1"
    assert float(record["clock_drift_ppm"]) == system["clock_drift_ppm"]
    assert float(record["clock_drift_std_ppm"]) == system["clock_drift_std_ppm"]
    assert "round_trip_s" not in record

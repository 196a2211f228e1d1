"""The vehicle's clock, against arrivals made from a hidden true clock."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.clock.fit import NS_PER_S, Times, fit_clock
from gcs.clock.stamps import Stamps, build_clock, restarts, unwrap
from gcs.errors import SignalMapError

MS = 1_000_000
UTC = 1_790_000_000 * NS_PER_S
U32_US = 2**32 * 1000
U32_MS = 2**32 * MS


def arrivals(boot: Times, *, drift: float = 0.0, delay_ms: float = 3.0, boot_utc: int = UTC, seed: int = 0) -> Times:
    """Reception by a clock that gains `drift`, after 1 ms plus an exponential delay."""
    late = np.random.default_rng(seed).exponential(delay_ms * MS, boot.size)
    true = boot + MS + np.rint(late).astype(np.int64)
    # A link keeps the order: what comes behind a late frame is late as well.
    return np.maximum.accumulate(boot_utc + true + np.rint(drift * (true - boot[0])).astype(np.int64))


def regular(start_s: float, rate: float, seconds: float) -> Times:
    return np.rint((start_s + np.arange(int(rate * seconds)) / rate) * NS_PER_S).astype(np.int64)


def test_drift_and_offset_are_found_under_delay_and_outliers() -> None:
    boot = regular(500.0, 50, 600)
    log = arrivals(boot, drift=40e-6, delay_ms=8.0)
    wild = log.copy()
    wild[::3000] -= 200 * MS  # the receiver's clock stuttered
    for received in (log, wild):
        fit = fit_clock(received, boot)
        assert fit.drift == pytest.approx(40e-6, abs=1e-6)
        exact = UTC + boot + MS + np.rint(40e-6 * (boot + MS - boot[0])).astype(np.int64)
        np.testing.assert_allclose(fit.to_vehicle(exact), boot, atol=1.0 * MS, rtol=0)


def test_one_message_alone_and_a_burst_of_one_instant_are_enough() -> None:
    assert fit_clock(np.array([UTC + 7]), np.array([7])).to_vehicle(np.array([UTC + 9])).tolist() == [9]
    same = np.full(5, 100, np.int64)
    assert fit_clock(same + UTC, same).drift == 0.0


def test_a_32_bit_stamp_is_unwrapped_over_several_turns_a_gap_and_disorder() -> None:
    boot = regular(4000.0, 10, 12_000)
    keep = (boot < 6000 * NS_PER_S) | (boot > 13_500 * NS_PER_S)  # silent for more than a whole turn
    boot = boot[keep]
    boot[[100, 101]] = boot[[101, 100]]
    stamps = Stamps("SERVO_OUTPUT_RAW", 1, arrivals(np.sort(boot)), boot % U32_US, U32_US)
    assert (np.diff(boot % U32_US) < -NS_PER_S).sum() >= 2
    np.testing.assert_array_equal(unwrap(stamps), boot)


def test_wrapped_stamps_and_stamps_since_1970_join_the_clock_since_boot() -> None:
    boot = regular(9000.0, 50, 30)  # SERVO_OUTPUT_RAW has wrapped twice before
    log = arrivals(boot)
    epoch = UTC - 12 * NS_PER_S  # the vehicle's own UTC is 12 s wrong
    pairs = (log[::50], boot[::50] + epoch, boot[::50] // MS * MS)
    imu = Stamps("HIGHRES_IMU", 1, log, boot + epoch)
    attitude = Stamps("ATTITUDE", 1, log, boot // MS * MS, U32_MS)
    servo = Stamps("SERVO_OUTPUT_RAW", 1, log, boot % U32_US, U32_US)
    clock = build_clock([imu, attitude, servo], pairs)
    for entry in (imu, attitude, servo):
        np.testing.assert_allclose(clock.seconds(entry), (boot - boot[0]) / NS_PER_S, atol=1e-9)
    assert clock.warnings == []


def test_both_kinds_of_stamps_without_system_time_are_joined_by_arrival() -> None:
    boot = regular(100.0, 50, 60)
    log = arrivals(boot, delay_ms=2.0)
    imu = Stamps("HIGHRES_IMU", 1, log, boot + UTC + 5 * NS_PER_S)
    attitude = Stamps("ATTITUDE", 1, log, boot, U32_MS)
    clock = build_clock([imu, attitude])
    np.testing.assert_allclose(clock.seconds(imu), clock.seconds(attitude), atol=0.002)
    assert any("SYSTEM_TIME" in line for line in clock.warnings)


def test_stamps_since_1970_alone_are_a_clock() -> None:
    boot = regular(100.0, 50, 10)
    entry = Stamps("HIGHRES_IMU", 1, arrivals(boot), boot + UTC)
    clock = build_clock([entry])
    np.testing.assert_allclose(clock.seconds(entry), (boot - boot[0]) / NS_PER_S, atol=1e-9)


def test_a_message_without_stamp_gets_its_reception_on_the_vehicle_clock() -> None:
    boot = regular(100.0, 50, 120)
    stamped = Stamps("ATTITUDE", 1, arrivals(boot, drift=-30e-6), boot, U32_MS)
    sent = regular(100.01, 25, 119)
    bare = Stamps("AIRSPEED", 1, arrivals(sent, drift=-30e-6, seed=4), np.zeros(sent.size, np.int64))
    times = build_clock([stamped, bare]).seconds(bare)
    error = times - (sent - boot[0]) / NS_PER_S
    assert np.median(error) == pytest.approx(0.003 * np.log(2), abs=0.001)  # the median delay beyond the smallest
    assert error.min() > -0.001


def test_another_components_own_clock_is_aligned_with_a_warning() -> None:
    boot = regular(50.0, 50, 60)
    log = arrivals(boot)
    autopilot = Stamps("ATTITUDE", 1, log, boot, U32_MS)
    board = Stamps("HIGHRES_IMU", 158, log, boot - 31 * NS_PER_S)
    gps = Stamps("GPS_RAW_INT", 1, log[::10], boot[::10] - 200 * MS)  # honestly stamped long before it was sent
    clock = build_clock([autopilot, board, gps])
    np.testing.assert_allclose(clock.seconds(board), clock.seconds(autopilot), atol=0.002)
    np.testing.assert_allclose(clock.seconds(gps), clock.seconds(autopilot)[::10] - 0.2, atol=1e-9)
    assert len(clock.warnings) == 1
    assert "component 158" in clock.warnings[0]


def test_the_longest_flight_between_restarts_is_taken() -> None:
    first, second = regular(900.0, 20, 30), regular(5.0, 20, 100)
    log = np.concatenate([arrivals(first), arrivals(second, boot_utc=UTC + 1000 * NS_PER_S)])
    entry = Stamps("RAW_IMU", 1, log, np.concatenate([first, second]))
    clock = build_clock([entry])
    inside = clock.inside(entry.log_ns)
    np.testing.assert_array_equal(entry.raw_ns[inside], second)
    np.testing.assert_allclose(clock.seconds(entry)[inside][0], 0.0, atol=1e-9)
    assert any("restarted" in line for line in clock.warnings)


def test_a_held_up_link_that_brings_messages_out_of_order_is_no_restart() -> None:
    boot = regular(900.0, 20, 60)
    log = UTC + boot
    held = (boot >= 920 * NS_PER_S) & (boot < 923 * NS_PER_S)
    log[held] = UTC + 923 * NS_PER_S + np.random.default_rng(4).permutation(np.count_nonzero(held)) * MS
    order = np.argsort(log, kind="stable")
    entry = Stamps("ATTITUDE", 1, log[order], boot[order], U32_MS)
    steps = entry.raw_ns[2:] - entry.raw_ns[:-2]
    assert (steps < -NS_PER_S).any()
    assert restarts(entry).size == 0
    assert build_clock([entry]).warnings == []


@pytest.mark.parametrize("stray", [3, 5_000 * NS_PER_S])
def test_a_stray_stamp_is_neither_start_nor_restart(stray: int) -> None:
    boot = regular(900.0, 20, 60)
    raw = boot.copy()
    raw[200] = stray
    clock = build_clock([Stamps("RAW_IMU", 1, arrivals(boot), raw)])
    assert clock.start_ns == boot[0]
    assert clock.warnings == []


@pytest.mark.parametrize(("names", "period"), [(1, 0), (1, U32_MS), (2, U32_MS)])
def test_a_clock_that_starts_at_0_has_its_first_sample_at_0(names: int, period: int) -> None:
    boot = np.repeat(regular(0.0, 50, 30), names)
    entry = Stamps("NAMED_VALUE_FLOAT", 1, arrivals(boot), boot, period)
    clock = build_clock([entry])
    np.testing.assert_allclose(clock.seconds(entry), boot / NS_PER_S, atol=1e-9)


def test_zeros_before_stamps_of_a_clock_that_ran_long_before_are_no_stamps() -> None:
    boot = regular(900.0, 50, 30)
    raw = boot.copy()
    raw[0] = 0
    entry = Stamps("RAW_IMU", 1, arrivals(boot), raw)
    assert entry.valid.tolist() == [False] + [True] * (boot.size - 1)
    unset = Stamps("RAW_IMU", 1, arrivals(boot), np.where(np.arange(boot.size) < 40, 0, boot - boot[0]))
    assert unset.valid[:40].tolist() == [False] * 40


def test_without_any_stamp_the_error_says_so() -> None:
    with pytest.raises(SignalMapError, match="no message of the vehicle carries a time stamp"):
        build_clock([Stamps("AIRSPEED", 1, np.array([UTC]), np.array([0]))])


@pytest.mark.parametrize("pace", [1.0, 5.0, 60.0])
def test_a_link_held_up_at_random_while_a_flight_is_told_fast_moves_no_stamp(pace: float) -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        pauses = sorted(zip(rng.uniform(0, 3.5, 3), rng.exponential(1.0, 3), strict=True))
        entries, told = [], []
        for message, rate, period in (("HIGHRES_IMU", 50, 0), ("GPS_RAW_INT", 5, 0), ("SERVO_OUTPUT_RAW", 25, U32_US)):
            boot = regular(2.0, rate, 3.3 * pace)
            arrived = (boot - boot[0]) / pace / NS_PER_S
            for start, length in pauses:
                arrived = np.where((arrived > start) & (arrived < start + length), start + length, arrived)
            entries.append(Stamps(message, 1, UTC + np.rint(arrived * NS_PER_S).astype(np.int64), boot, period))
            told.append(boot)
        clock = build_clock(entries)
        assert clock.warnings == []
        for entry, boot in zip(entries, told, strict=True):
            np.testing.assert_array_equal(clock.seconds(entry), (boot - boot[0]) / NS_PER_S)

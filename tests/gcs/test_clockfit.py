"""Offset, drift and delays from one-way messages, against arrivals whose clocks and delays are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs.clockfit import NS_PER_S, ClockFit, fit_clock

Array = NDArray[np.float64]
Jitter = Callable[[np.random.Generator, int], Array]

UTC = 1_790_000_000 * NS_PER_S
BOOT_S = 500.0
LEAST_S = 0.012  # the smallest delay, unknown to the estimator, which must count it to the offset
DRIFT = 50e-6
JITTER: dict[str, Jitter] = {
    "exponential": lambda rng, n: rng.exponential(0.03, n),
    "half normal": lambda rng, n: np.abs(rng.normal(0.0, 0.03, n)),
    "uniform": lambda rng, n: rng.uniform(0.0, 0.03, n),
    "normal": lambda rng, n: rng.normal(0.0, 0.03, n),
}


def late_singly(rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
    return rng.random(n) < 0.2


def late_in_bursts(rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
    """Runs of 1 to 40 late messages, 20 % in all."""
    starts = np.flatnonzero(rng.random(n) < np.log(1 / 0.8) / 20.5)
    ends = np.minimum(starts + rng.integers(1, 41, starts.size), n)
    depth = np.zeros(n + 1, np.int64)
    np.add.at(depth, starts, 1)
    np.add.at(depth, ends, -1)
    return np.asarray(np.cumsum(depth[:-1]) > 0)


def flight(
    seed: int, jitter: str, late: Callable[..., NDArray[np.bool_]], *, rate_hz: float = 50.0, in_order: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Reception and stamps, ns, of ten minutes: 50 ppm, jitter of 30 ms, 20 % of the packets 50 to 500 ms late."""
    rng = np.random.default_rng(seed)
    n = round(600 * rate_hz)
    sent = BOOT_S + np.arange(n) / rate_hz
    delay = LEAST_S + JITTER[jitter](rng, n) + late(rng, n) * rng.uniform(0.05, 0.5, n)
    arrived = sent + DRIFT * (sent - BOOT_S) + delay
    if in_order:
        arrived = np.maximum.accumulate(arrived)
    return UTC + np.rint(arrived * NS_PER_S).astype(np.int64), np.rint(sent * NS_PER_S).astype(np.int64)


def errors(fit: ClockFit) -> tuple[float, float]:
    """Of the drift, ppm, and of the offset in the middle of the flight, ms."""
    truth = (LEAST_S + DRIFT * (fit.origin_ns / NS_PER_S - BOOT_S)) * 1e3
    return (fit.drift - DRIFT) * 1e6, (fit.offset_ns - UTC) / 1e6 - truth


@pytest.mark.parametrize("late", [late_singly, late_in_bursts])
@pytest.mark.parametrize("jitter", ["exponential", "half normal", "uniform"])
def test_50_ppm_under_30_ms_of_jitter_and_a_fifth_of_late_packets_to_2_ppm_and_1_ms(
    jitter: str, late: Callable[..., NDArray[np.bool_]]
) -> None:
    for seed in range(4):
        fit = fit_clock(*flight(seed, jitter, late))
        drift_ppm, offset_ms = errors(fit)
        assert abs(drift_ppm) < 0.3  # seven times better than asked for
        assert abs(offset_ms) < 0.1
        assert fit.anchor == "smallest"
        assert fit.delays.smallest_s == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("jitter", ["exponential", "half normal", "uniform"])
def test_one_message_each_second_is_enough_for_2_ppm_and_1_ms(jitter: str) -> None:
    found = np.array([errors(fit_clock(*flight(seed, jitter, late_singly, rate_hz=1.0))) for seed in range(40)])
    drift_rms, offset_rms = np.sqrt(np.mean(found**2, axis=0))
    assert drift_rms < 1.0
    assert offset_rms < 0.2
    assert np.mean(np.abs(found[:, 0]) < 2.0) >= 0.9
    assert np.abs(found[:, 1]).max() < 1.0


def test_normal_jitter_is_borne_at_the_bound_that_any_estimator_has() -> None:
    fits = [fit_clock(*flight(seed, "normal", late_singly)) for seed in range(12)]
    found = np.array([errors(fit) for fit in fits])
    # Cramer and Rao: 30 ms / sqrt(24 000 messages in time) over ten minutes is 1.12 ppm.
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 1.6
    assert np.abs(found[:, 1]).max() < 1.2
    assert {fit.anchor for fit in fits} == {"typical"}
    assert all(0.9 < fit.drift_std * 1e6 < 1.8 for fit in fits)


def test_a_link_that_keeps_the_order_holds_up_four_in_five_and_the_errors_say_so() -> None:
    fits = [fit_clock(*flight(seed, "exponential", late_singly, in_order=True)) for seed in range(40)]
    found = np.array([errors(fit) for fit in fits])
    assert np.mean([fit.delays.median_s for fit in fits]) > 0.15
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 2.0
    assert np.abs(found[:, 1]).max() < 1.0
    assert np.mean([abs(error[0]) < 1.96 * fit.drift_std * 1e6 for error, fit in zip(found, fits, strict=True)]) > 0.85


@pytest.mark.parametrize("jitter", ["exponential", "half normal", "uniform", "normal"])
def test_of_95_percent_intervals_95_percent_hold_the_truth(jitter: str) -> None:
    fits = [fit_clock(*flight(seed, jitter, late_in_bursts, rate_hz=5.0)) for seed in range(100)]
    found = np.array([errors(fit) for fit in fits])
    told = np.array([(fit.drift_std * 1e6, fit.offset_std_s * 1e3) for fit in fits])
    inside = np.mean(np.abs(found) < 1.96 * told, axis=0)
    assert np.all(inside > 0.88)  # 95 % of 100, less three standard errors
    assert np.all(np.median(told, axis=0) < 1.5 * np.sqrt(np.mean(found**2, axis=0)))  # nor are they feigned wide


def test_receptions_before_their_time_do_not_pull_the_line_down() -> None:
    log, boot = flight(3, "exponential", late_singly)
    log[::3000] -= NS_PER_S // 5  # the receiver's clock stuttered
    boot[7] += 5_000 * NS_PER_S  # a stray stamp
    drift_ppm, offset_ms = errors(fit_clock(log, boot))
    assert abs(drift_ppm) < 0.3
    assert abs(offset_ms) < 0.1


def test_an_exact_clock_is_found_exactly_and_whole_milliseconds_are_no_obstacle() -> None:
    boot = np.arange(3000, dtype=np.int64) * 20_000_000 + NS_PER_S
    fit = fit_clock(boot + UTC, boot)
    assert (fit.drift, fit.offset_ns) == (0.0, UTC)
    assert fit.offset_std_s < 1e-6
    log = UTC + boot * 7 + np.rint(np.random.default_rng(0).exponential(3e6, boot.size)).astype(np.int64)
    cut = fit_clock(log, boot // 1_000_000 * 1_000_000)
    assert cut.drift == pytest.approx(6.0, abs=1e-6)  # a flight told seven times slower


def test_too_few_messages_give_a_line_without_a_standard_error() -> None:
    assert fit_clock(np.array([UTC + 7]), np.array([7])).to_vehicle(np.array([UTC + 9])).tolist() == [9]
    same = np.full(50, 100, np.int64)
    fit = fit_clock(same + UTC, same)
    assert (fit.drift, fit.drift_std, fit.offset_std_s) == (0.0, float("inf"), float("inf"))


def test_an_offset_far_from_the_middle_is_less_certain() -> None:
    fit = fit_clock(*flight(1, "exponential", late_singly))
    assert fit.offset_std_at(fit.origin_ns) == fit.offset_std_s
    away = fit.offset_std_at(fit.origin_ns + 3600 * NS_PER_S)
    assert away == pytest.approx(np.hypot(fit.offset_std_s, 3600 * fit.drift_std))

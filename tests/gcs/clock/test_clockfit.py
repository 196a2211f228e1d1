"""Offset, drift and delays from one-way messages, against arrivals whose clocks and delays are known."""

from __future__ import annotations

import numpy as np
import pytest
from arrivals import UTC, Late, errors, flight, late_in_bursts, late_singly

from gcs.clock.fit import NS_PER_S, fit_clock


@pytest.mark.parametrize("late", [late_singly, late_in_bursts])
@pytest.mark.parametrize("jitter", ["exponential", "half normal", "uniform"])
def test_50_ppm_under_30_ms_of_jitter_and_a_fifth_of_late_packets_to_2_ppm_and_1_ms(jitter: str, late: Late) -> None:
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


@pytest.mark.whole_flight
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

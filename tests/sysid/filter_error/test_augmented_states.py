"""Sensors that remember, as states of the filter: against the dense Gaussian likelihood of the readings themselves."""

import numpy as np
import pytest
from scipy import stats

from sim_vehicle.effects import SLOT_COUNT, slot
from sim_vehicle.effects.sensor import ramp_lag
from sim_vehicle.effects.sensor_time_skew import split_delay
from sysid.filter_error.augmented_states import (
    HiddenInput,
    Memory,
    OutputLag,
    System,
    fill_memory,
    fill_unseen,
    lags,
    remember,
)
from sysid.filter_error.delayed_outputs import missing_likelihood
from sysid.filter_error.kalman import kalman_pass
from sysid.signals.record import OUTPUTS

DT, TAU = 0.02, 0.05


def lagged(values: np.ndarray, tau: float) -> np.ndarray:
    """Readings of a sensor at rest before the first value, by the simulator's own lag."""
    out = values.copy()
    for k in range(1, values.size):
        out[k] = ramp_lag(values[k - 1], values[k], out[k - 1], DT, tau)
    return out


def the_lag() -> OutputLag:
    """The lag of the vanes, as the filter has it."""
    effects = np.zeros(SLOT_COUNT)
    effects[slot("vane_lag")], effects[slot("vane_lag", "tau")] = 1.0, TAU
    return next(lag for lag in lags(effects, DT) if lag.column == OUTPUTS.index("alpha"))


def test_the_filter_gives_the_dense_likelihood_of_a_lagging_sensor() -> None:
    """A random walk seen through a lag: covariance of all readings at once, unit by unit."""
    n, walk, noise, start = 40, 0.3, 0.05, 1e-5
    lag = the_lag()
    generator = np.random.default_rng(4)
    shape = np.column_stack([lagged((np.arange(n) >= k).astype(float), TAU) for k in range(n)])
    first = np.full(n, 2.0)
    spread = shape @ np.diag([0.5**2, *([walk**2] * (n - 1))]) @ shape.T + noise**2 * np.eye(n)
    readings = first + np.linalg.cholesky(spread) @ generator.standard_normal(n)
    step, read = np.zeros((n - 1, 2, 2)), np.zeros((n, 1, 2))
    step[:, 0, 0], read[:, :, 0] = 1.0, lag.new
    whole = System(
        step, np.zeros((n - 1, 2)), (readings - first)[:, None], read, np.zeros((n, 2)),
        walk**2 * step, np.zeros((2, 2)), np.zeros((0, 1)),
    )  # fmt: skip
    taken = lag.decay * lag.new + lag.old
    memory = Memory(
        np.array([0]), np.array([lag.decay]), np.array([taken]), np.array([lag.decay + lag.old]),
        np.ones((n, 1, 1)), np.array([start]),
    )  # fmt: skip
    fill_memory(whole, 1, memory, 1, np.zeros((n, 0)))
    # A sensor at rest has read what was there: its memory varies with the first value.
    rest = 1.0 - lag.new
    whole.p_start[:] = 0.5**2 * np.outer([1.0, rest], [1.0, rest])
    found = kalman_pass(
        whole.transition, whole.drift, np.zeros((n - 1, 2, 0)), whole.left, whole.observe, np.zeros((n, 1, 0)),
        whole.jump, np.array([noise**2]), whole.process, whole.p_start, False,
    )  # fmt: skip
    exact = stats.multivariate_normal(first, spread).logpdf(readings) + 0.5 * n * np.log(2.0 * np.pi)
    assert found[0] == pytest.approx(exact, abs=1e-6)


def test_a_sensor_that_comes_late_by_a_part_of_a_sample_reads_between_two() -> None:
    """The memory of a reading that comes 2.25 samples late is a quarter of the sample before."""
    effects = np.zeros(SLOT_COUNT)
    effects[slot("sensor_time_skew")] = 1.0
    effects[slot("sensor_time_skew", "delay")] = 2.25 * DT
    effects[slot("sensor_time_skew", "group")] = 2.0
    found = {OUTPUTS[lag.column]: lag for lag in lags(effects, DT)}
    assert set(found) == {"p", "q", "r", "ax", "ay", "az"}
    assert (found["q"].decay, found["q"].old, found["q"].new) == pytest.approx((0.0, 0.25, 0.75))


def test_what_nothing_measures_alone_is_a_coloured_noise_of_the_readings() -> None:
    """A state at rest, read beside an unseen one: the filter's likelihood is that of the dense Gaussian."""
    count, decay, start, noise, read = 40, 0.8, 0.7, 0.3, 1.7
    generator = np.random.default_rng(5)
    seen = generator.normal(0.0, 1.0, (count, 1))
    step, of_reading = np.zeros((count - 1, 2, 2)), np.zeros((count, 1, 2))
    step[:, 0, 0], of_reading[:, :, 0] = 1.0, 1.0
    system = System(
        step, np.zeros((count - 1, 2)), seen, of_reading, np.zeros((count, 2)),
        np.zeros((count - 1, 2, 2)), np.diag([0.5, 0.0]), np.zeros((3, 1)),
    )  # fmt: skip
    hidden = HiddenInput(0, np.ones(count), decay, (1.0 - decay**2) * start, start)
    fill_unseen(system, 1, hidden, np.zeros((count - 1, 1)), np.full((count, 1), read))
    nothing = np.zeros((count - 1, 2, 0)), np.zeros((count, 1, 0))
    found = kalman_pass(
        system.transition, system.drift, nothing[0], system.left, system.observe, nothing[1], system.jump,
        np.array([noise]), system.process, system.p_start, False,
    )[0]  # fmt: skip
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    dense = 0.5 + read**2 * start * decay**apart + noise * np.eye(count)
    wanted = -0.5 * (seen[:, 0] @ np.linalg.solve(dense, seen[:, 0]) + np.linalg.slogdet(dense)[1])
    assert found == pytest.approx(wanted, rel=1e-9)


def test_one_wild_reading_leaves_the_memory_at_the_start_as_sure() -> None:
    """Half of a sensor's travel, which a spike of twenty times that would make twenty times as wide."""
    z = np.full((500, len(OUTPUTS)), np.nan)
    alpha = OUTPUTS.index("alpha")
    z[:, alpha] = 0.1 * np.sin(np.linspace(0.0, 30.0, 500))
    slopes = np.zeros((500, len(OUTPUTS), 1))
    found = []
    for spike in (0.0, 4.0):
        z[250, alpha] += spike
        memory = remember([the_lag()], np.array([alpha]), z, slopes.copy(), slopes.copy(), [])
        assert memory is not None
        found.append(float(memory.start[0]))
    assert found[0] == pytest.approx(0.1, rel=0.01)
    assert found[1] == pytest.approx(found[0], rel=0.01)


def test_an_output_that_a_record_does_not_read_has_nothing_to_remember() -> None:
    z = np.full((30, len(OUTPUTS)), np.nan)
    columns = np.array([OUTPUTS.index("alpha")])
    read = np.ones((30, len(OUTPUTS), 2))
    assert remember([the_lag()], columns, z, read.copy(), read.copy(), [0]) is None
    z[3:, columns] = 0.1
    assert remember([the_lag()], columns, z, read.copy(), read.copy(), [0]) is not None


@pytest.mark.parametrize("ticks", [1, 3, 7, 14, 28, 57])
@pytest.mark.parametrize("interval", [0.01, 0.02, 1.0 / 30.0])
def test_a_delay_of_whole_ticks_has_no_part_of_one(ticks: int, interval: float) -> None:
    """0.07 s of 0.01 s are 7.000000000000001 in binary fractions."""
    assert split_delay((ticks * interval) / interval) == (ticks, 0.0)
    assert split_delay((ticks * 0.01) / 0.01) == (ticks, 0.0)
    whole, part = split_delay(ticks + 0.25)
    assert (whole, part) == (ticks, pytest.approx(0.25))


def test_readings_that_come_too_late_count_as_much_as_the_others() -> None:
    """Six standard normal readings, two more too late; an output that is never read, and one read only too late."""
    generator = np.random.default_rng(3)
    innovations = np.full((8, 3), np.nan)
    innovations[:6, 0] = generator.standard_normal(6)
    told = missing_likelihood(innovations, np.full((8, 3), 2.0), np.array([2, 0, 2]))
    each = -0.5 * (innovations[:6, 0] ** 2 / 2.0 + np.log(2.0))
    assert told == pytest.approx(2.0 * float(np.mean(each)))
    assert missing_likelihood(innovations, np.full((8, 3), 2.0), np.zeros(3, dtype=np.int64)) == 0.0

"""Tables of the last samples against numpy's own interpolation, and what is to be left out of them."""

import numpy as np
import pytest

from sysid.arrays import Array
from sysid.live.signals.row_alignment import TimeBase
from sysid.live.signals.sample_buffer import Tracks

DT = 0.02


def times(count: int) -> Array:
    return np.asarray(DT * np.arange(count), np.float64)


def given(name: str, time_s: Array, values: Array) -> dict[str, tuple[Array, Array]]:
    return {name: (time_s, values)}


def in_parts(tracks: Tracks, name: str, time_s: Array, values: Array, size: int) -> None:
    for start in range(0, time_s.size, size):
        tracks.add(given(name, time_s[start : start + size], values[start : start + size]))


@pytest.mark.parametrize("size", [1, 3, 400])
def test_values_between_samples(size: int) -> None:
    generator = np.random.default_rng(4)
    time_s: Array = np.cumsum(generator.uniform(0.015, 0.03, 400))
    values = np.sin(3.0 * time_s) + 0.01 * generator.normal(size=400)
    tracks = Tracks(("p", "da"))
    in_parts(tracks, "p", time_s, values, size)
    in_parts(tracks, "da", time_s, values, size)
    stamps = np.sort(generator.uniform(time_s[20], time_s[-1], 200))
    smooth, held = tracks.at(stamps)
    np.testing.assert_allclose(smooth, np.interp(stamps, time_s, values), atol=1e-12)
    np.testing.assert_array_equal(held, values[np.searchsorted(time_s, stamps, side="right") - 1])


def test_nothing_is_made_up_in_gaps() -> None:
    time_s = np.concatenate([times(50), 1.6 + times(50)])
    tracks = Tracks(("q",))
    in_parts(tracks, "q", time_s, np.sin(time_s), 4)
    found = tracks.at(DT * np.array([10.5, 49.0, 60.5, 80.0, 100.5, 140.0]))[0]
    assert np.isfinite(found).tolist() == [True, True, False, True, True, False]


def test_late_and_doubled_samples_are_left_out() -> None:
    time_s = times(100)
    tracks = Tracks(("q",))
    for start in range(0, 100, 5):
        tracks.add(given("q", time_s[start : start + 5], np.cos(time_s[start : start + 5])))
        again = np.flip(time_s[max(start - 5, 0) : start + 3]).copy()
        tracks.add(given("q", again, np.full(again.size, 99.0)))
    np.testing.assert_allclose(tracks.at(time_s)[0], np.cos(time_s), atol=1e-15)


@pytest.mark.parametrize("size", [1, 2, 7])
def test_readings_that_stand_alone(size: int) -> None:
    generator = np.random.default_rng(1)
    time_s = times(300)
    values = np.sin(time_s) + 1e-3 * generator.normal(size=300)
    wrong = np.array([40, 91, 92 + 60, 231])
    broken = values.copy()
    broken[wrong] += 25.0
    broken[200:] += 0.8  # a step that stays is none
    tracks = Tracks(("alpha",))
    in_parts(tracks, "alpha", time_s, broken, size)
    assert tracks.left_out[0] == wrong.size
    good = np.delete(np.arange(290), wrong)
    np.testing.assert_allclose(tracks.at(time_s[good])[0], broken[good], atol=1e-15)


def test_angles_go_on_over_the_turn() -> None:
    time_s = times(400)
    turning = 3.0 + 2.0 * time_s
    tracks = Tracks(("psi",))
    in_parts(tracks, "psi", time_s, np.remainder(turning + np.pi, 2.0 * np.pi) - np.pi, 3)
    found = tracks.at(time_s)[0]
    np.testing.assert_allclose(found - found[0], turning - turning[0], atol=1e-12)


def test_what_one_table_holds_another_takes_over() -> None:
    time_s = times(60)
    first = Tracks(("p", "q"))
    first.add({"p": (time_s, time_s), "q": (time_s, 2.0 * time_s)})
    second = Tracks(("az", "q")).taken_from(first)
    assert np.isnan(second.at(time_s)[0]).all()
    np.testing.assert_allclose(second.at(time_s)[1], 2.0 * time_s)
    assert second.period_s("q") == pytest.approx(DT)


def test_memory_is_bounded_where_the_accelerometer_is_silent() -> None:
    base = TimeBase(["p"])
    time_s = times(50)
    for start_s in range(600):
        for name in ("p", "az") if start_s < 3 else ("p",):
            base.add(given(name, np.add(time_s, start_s), np.sin(time_s)))
        base.rows()
    assert len(base) < 5_000


def test_memory_is_bounded_where_the_accelerometer_never_came() -> None:
    base = TimeBase(["p", "az"])
    for second in range(200):
        time_s = second + times(50)
        base.add(given("p", time_s, np.sin(time_s)))
        assert base.rows() == []
    assert len(base) < 5_000

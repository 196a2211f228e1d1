"""Shapes, orthogonality and plans of manoeuvres."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim_vehicle.errors import PlanError
from sim_vehicle.manoeuvres.plan import Plan, plan_from_json, plan_of, read_plan
from sim_vehicle.manoeuvres.shapes import CONTROLS, MANOEUVRES, manoeuvre, peak_factors

DT = 0.02
TWO_DEGREES = 2.0 * np.pi / 180.0


def ticks(seconds: float) -> np.ndarray:
    return np.arange(round(seconds / DT)) * DT


def levels(values: np.ndarray) -> list[tuple[float, int]]:
    """Run lengths: (level, samples)."""
    edges = np.flatnonzero(np.diff(values)) + 1
    parts = np.split(values, edges)
    return [(float(part[0]), part.size) for part in parts]


def test_elevator_pulse_is_one_second_of_trim_one_of_pulse_and_free_after() -> None:
    segment = manoeuvre("elevator-pulse")
    assert segment.duration == 10.0
    values = segment.increments(ticks(10.0))
    assert levels(values[:, 0]) == [(0.0, 50), (pytest.approx(TWO_DEGREES), 50), (0.0, 400)]
    assert not values[:, 1:].any()


def test_3211_has_its_widths_and_signs() -> None:
    values = manoeuvre("aileron-3211", width=0.5, amplitude=0.1).increments(ticks(12.0))
    expected = [(0.0, 50), (0.1, 75), (-0.1, 50), (0.1, 25), (-0.1, 25), (0.0, 375)]
    assert levels(values[:, 1]) == [(pytest.approx(level), size) for level, size in expected]


def test_doublet_has_no_mean() -> None:
    values = manoeuvre("rudder-doublet").increments(ticks(10.0))
    assert values[:, 2].sum() == pytest.approx(0.0, abs=1e-12)
    assert values[:, 2].max() == -values[:, 2].min() > 0.0


@pytest.mark.parametrize("name", sorted(MANOEUVRES))
def test_every_manoeuvre_ends_at_rest_and_moves_only_its_axes(name: str) -> None:
    segment = manoeuvre(name)
    values = segment.increments(ticks(segment.duration + 2.0))
    assert np.isfinite(values).all()
    assert not values[: round(segment.start / DT)].any()
    assert not values[round(segment.duration / DT) :].any()
    moved = {CONTROLS[i] for i in np.flatnonzero(values.any(axis=0))}
    assert moved == set(segment.axes)
    assert np.abs(values).max() <= segment.amplitude * 1.1 + 1e-12


def test_multisine_inputs_are_orthogonal_and_of_the_amplitude_asked_for() -> None:
    segment = manoeuvre("multisine")
    assert (segment.duration, segment.length) == (20.0, 18.0)
    values = segment.increments(ticks(20.0))[:, :3]
    gram = values.T @ values
    scale = np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
    assert np.abs(gram / scale - np.eye(3)).max() < 1e-12
    for axis in range(3):
        peak = (values[:, axis].max() - values[:, axis].min()) / 2.0
        assert peak == pytest.approx(TWO_DEGREES, rel=0.02)
        assert abs(values[50, axis]) < 1e-12  # begins at zero, so that it makes no step


@pytest.mark.parametrize("name", [name for name in sorted(MANOEUVRES) if name.endswith("multisine")])
def test_relative_peak_factors(name: str) -> None:
    assert max(peak_factors(manoeuvre(name)).values()) <= 1.25


def test_multisine_holds_only_its_band() -> None:
    values = manoeuvre("elevator-multisine").increments(ticks(20.0))[50:950, 0]
    power = np.abs(np.fft.rfft(values)) ** 2
    hertz = np.fft.rfftfreq(900, DT)
    inside = (hertz > 0.1 - 1e-9) & (hertz < 2.5 + 1e-9)
    assert power[~inside].sum() < 1e-20 * power.sum()


def test_sweep_goes_from_low_to_high() -> None:
    segment = manoeuvre("elevator-sweep", low=0.2, high=3.0)
    fine = np.arange(0.0, 20.0, 1e-4)
    values = segment.increments(fine)[:, 0]
    crossings = fine[np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))]
    crossings = crossings[crossings < 18.9]  # the cut at the end is no zero of the sine
    periods = np.diff(crossings)
    # The instantaneous frequency of a logarithmic sweep is low (high/low)^(t/T).
    middle = (crossings[:-1] + crossings[1:]) / 2.0 - segment.start
    expected = 0.2 * (3.0 / 0.2) ** (middle / segment.length)
    np.testing.assert_allclose(1.0 / periods, expected, rtol=0.02)


def test_deceleration_changes_the_speed_held_and_no_control() -> None:
    segment = manoeuvre("deceleration", amplitude=4.0, length=8.0)
    assert segment.speed_change(0.5) == 0.0
    assert segment.speed_change(5.0) == pytest.approx(-2.0)
    assert segment.speed_change(15.0) == pytest.approx(-4.0)
    assert segment.freed() == (False, False)


def test_own_harmonics_and_phases() -> None:
    plan = plan_from_json(
        {
            "schema": "plan/1",
            "segments": [
                {
                    "manoeuvre": "multisine",
                    "axes": ["elevator", "throttle"],
                    "harmonics": {"elevator": [2, 5], "throttle": [1, 3]},
                    "phases": {"elevator": [0.0, 0.0]},
                    "amplitudes": {"elevator": 0.05, "throttle": 0.2},
                    "length": 10.0,
                    "duration": 12.0,
                }
            ],
        }
    )
    values = plan.segments[0].increments(ticks(12.0))
    time = ticks(12.0)[50:550] - 1.0
    raw = np.sin(2 * np.pi * 0.2 * time) + np.sin(2 * np.pi * 0.5 * time)
    measured = values[50:550, 0]
    assert np.corrcoef(raw, measured)[0, 1] == pytest.approx(1.0)
    assert np.ptp(measured) / 2.0 == pytest.approx(0.05, rel=0.01)
    assert np.ptp(values[:, 3]) / 2.0 == pytest.approx(0.2, rel=0.01)
    assert not values[:, 1:3].any()


def test_named_manoeuvres_have_a_recovery_between_them() -> None:
    plan = plan_of(["elevator-pulse", "multisine"])
    assert [segment.manoeuvre for segment in plan.segments] == ["elevator-pulse", "cruise", "multisine"]
    assert plan.duration == pytest.approx(35.0)


@pytest.mark.parametrize("seconds", [4.0, 10.0, 37.0, 300.0])
def test_a_fitted_plan_lasts_exactly_as_long(seconds: float) -> None:
    plan = plan_of(["elevator-pulse", "multisine"]).fitted(seconds)
    assert plan.duration == pytest.approx(seconds, abs=1e-9)
    assert plan.segments[0].manoeuvre == "elevator-pulse"


def test_plan_survives_its_file(tmp_path: Path) -> None:
    plan = plan_of(["elevator-3211", "throttle-multisine", "roller-coaster"])
    plan = plan.with_settings({"amplitude": 0.03})
    plan.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == plan


def test_settings_leave_the_recovery_alone() -> None:
    plan = plan_of(["elevator-pulse", "aileron-pulse"]).with_settings({"amplitude": 0.05, "duration": 8.0})
    assert [segment.amplitude for segment in plan.segments] == [0.05, 0.0, 0.05]
    assert [segment.duration for segment in plan.segments] == [8.0, 5.0, 8.0]


def segments(**entry: object) -> dict[str, object]:
    return {"schema": "plan/1", "segments": [{"manoeuvre": "multisine", **entry}]}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"schema": "plan/2"}, "schema"),
        ({"schema": "plan/1", "segments": []}, "at least one"),
        ({"schema": "plan/1", "segments": [{"manoeuvre": "loop"}]}, "no manoeuvre 'loop'"),
        ({"schema": "plan/1", "segments": [{"duration": 3}]}, "segment 1: needs a manoeuvre's name"),
        (segments(amplitud=0.1), "unknown key 'amplitud'"),
        (segments(duration="long"), "duration must be a finite number"),
        (segments(duration=-1.0), "duration is -1; it must be above 0"),
        (segments(start=-1.0), "start"),
        (segments(axes=["de"]), "axes must be a list of"),
        (segments(low=2.0, high=1.0), "must be above low"),
        (segments(harmonics={"elevator": [1, 2], "aileron": [2], "rudder": [4]}), "harmonic 2 serves two axes"),
        (segments(harmonics={"elevator": [1.5], "aileron": [2], "rudder": [4]}), "whole numbers"),
        (segments(phases={"elevator": [0.1]}), "harmonics and 1 phases"),
        (segments(length=0.1), "no harmonic for"),
    ],
)
def test_a_wrong_plan_is_told_in_one_line(data: object, words: str) -> None:
    with pytest.raises(PlanError) as caught:
        plan_from_json(data)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_plan_that_is_no_json(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text("{")
    with pytest.raises(PlanError, match="not a JSON file"):
        read_plan(path)
    path.write_text(json.dumps([1]))
    with pytest.raises(PlanError, match="not a plan file"):
        read_plan(path)
    with pytest.raises(PlanError, match="cannot read the plan"):
        read_plan(tmp_path / "none.json")


def test_duration_of_zero_is_refused() -> None:
    with pytest.raises(PlanError, match="above 0"):
        Plan((manoeuvre("cruise"),)).fitted(0.0)
    with pytest.raises(PlanError, match="at least one"):
        plan_of([])

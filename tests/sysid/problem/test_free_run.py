"""The gap between measurement and free-running simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mav_longitudinal as mav
import numpy as np
import pytest
from mav_problem import longitudinal_record, vehicle
from numpy.typing import NDArray

from sim_vehicle.effects import parse_effect
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sysid.numerics.dryden import Turbulence
from sysid.problem.free_run import Fixed, free_run, gap, noise_floor, start_read_alike, windows
from sysid.signals.record import OUTPUTS, Record
from sysid.signals.sensor_mounting import SensorMounting

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]

LAYOUT = SensorMounting()


def fixed(errors: dict[str, float] | None = None, **changes: float) -> Fixed:
    values = {**mav.COEFFICIENTS, **changes}
    model = Model("mav", {name: Coefficient(value) for name, value in values.items()})
    return Fixed(flatten(vehicle(), model), errors or {}, command_first=True)


def with_effect(text: str) -> Fixed:
    model = Model("mav", {name: Coefficient(value) for name, value in mav.COEFFICIENTS.items()})
    return Fixed(flatten(vehicle(), model.with_effect(*parse_effect(text))), {}, command_first=True)


def flown(noise: dict[str, float], seed: int = 0, errors: dict[str, float] | None = None) -> Record:
    truth = mav.fly(mav.multisine(duration=12.0))
    data = mav.measure(truth, np.random.default_rng(seed), errors=errors or {}, noise=noise)
    record = longitudinal_record(data)
    return replace(record, imposed_states=np.zeros((0, 9)))


@pytest.mark.parametrize(
    ("seconds", "wanted"),
    [
        (5.0, [250]),
        (12.0, [250, 250]),
        (12.4, [250, 250]),
        (12.5, [250, 250, 125]),
        (17.9, [250, 250, 250, 145]),
        (2.0, [100]),
    ],
)
def test_windows_are_five_seconds_and_half_a_one_counts(seconds: float, wanted: list[int]) -> None:
    n = round(seconds / 0.02)
    nothing = np.zeros((0, 9))
    record = Record(
        "f",
        0.02,
        0.02 * np.arange(n),
        0,
        np.zeros((n, 4)),
        np.zeros(n),
        np.ones(n),
        np.zeros((n, len(OUTPUTS))),
        nothing,
    )
    assert [part.length for part in windows(record)] == wanted
    # What was commanded more than 1.5 s before a window no longer matters to it.
    assert [part.start for part in windows(record)] == [min(250 * i, 75) for i in range(len(wanted))]
    assert [part.time_s[0] for part in windows(record)] == pytest.approx([5.0 * i for i in range(len(wanted))])


def test_a_free_run_of_the_truth_from_its_own_start_is_the_flight() -> None:
    record = flown({})
    states = np.zeros(9)
    states[[0, 2, 4, 7]] = mav.trim()[0]
    y = free_run(record, states, fixed())
    for name in ("airspeed", "alpha", "q", "theta", "ax", "az"):
        j = OUTPUTS.index(name)
        np.testing.assert_allclose(y[:, j], record.z[:, j], atol=1e-4, rtol=1e-5, err_msg=name)


def test_the_gap_of_the_truth_is_the_noise_of_the_sensors() -> None:
    """Accelerations hardly feel the start: their gap is their noise; that of any other output is above its own."""
    record = flown(mav.NOISE)
    found = gap([record], LAYOUT, fixed())
    for name, output in (("ax", "ax"), ("az", "az"), ("V", "airspeed"), ("alpha", "alpha"), ("q", "q")):
        assert found[name] > 0.9 * mav.NOISE[output], name
    for name in ("ax", "az"):
        assert found[name] < 1.5 * mav.NOISE[name]


def test_known_sensor_errors_are_no_gap() -> None:
    errors = {name: value for name, value in mav.ERRORS.items() if name != "beta_scale"}
    record = flown(mav.NOISE, errors=mav.ERRORS)
    corrected, raw = gap([record], LAYOUT, fixed(errors)), gap([record], LAYOUT, fixed())
    clean = gap([flown(mav.NOISE)], LAYOUT, fixed())
    for name in ("ax", "az", "q"):
        assert corrected[name] < 1.2 * clean[name] + 1e-9
        assert raw[name] > (1.1 if name == "q" else 2.0) * corrected[name]


@pytest.mark.parametrize(
    ("effect", "read"),
    [
        ("airspeed_error:scale=0.06,bias=0.8", {"airspeed": lambda v: 1.06 * v + 0.8}),
        ("vane_upwash:scale=0.2,bias=0.03", {"alpha": lambda alpha: 1.2 * alpha + 0.03}),
    ],
)
def test_what_sensors_make_of_the_start_is_no_gap(effect: str, read: dict[str, Callable[[Array], Array]]) -> None:
    """Readings bent by hand: the model with the effect flies from the motion that there was, not from what is read."""
    record = flown(mav.NOISE)
    z = record.z.copy()
    for name, bend in read.items():
        z[:, OUTPUTS.index(name)] = bend(z[:, OUTPUTS.index(name)])
    known = with_effect(effect)
    clean, right, wrong = (gap([r], LAYOUT, m) for r, m in ((record, fixed()), (replace(record, z=z), known),
                           (replace(record, z=z), fixed())))  # fmt: skip
    for name in ("q", "theta", "ax", "az"):
        assert right[name] < 1.02 * clean[name], name
    assert wrong["az"] > 1.3 * clean["az"]


def test_a_start_stays_where_no_sensor_has_an_effect() -> None:
    record = flown({})
    start = np.array([14.0, 0.1, 0.6, 0.0, 0.1, 0.0, 0.05, 0.04, 0.3])
    moved = start_read_alike(record, start, with_effect("stall:alpha_stall=0.2"))
    np.testing.assert_array_equal(moved, start)


def test_a_wrong_model_has_a_larger_gap() -> None:
    record = flown(mav.NOISE)
    right, wrong = gap([record], LAYOUT, fixed()), gap([record], LAYOUT, fixed(Cm_alpha=-0.9))
    assert wrong["q"] > 3.0 * right["q"]
    assert wrong["alpha"] > 1.5 * right["alpha"]


def test_an_output_that_was_not_measured_has_no_gap() -> None:
    record = flown(mav.NOISE)
    z = record.z.copy()
    z[:, OUTPUTS.index("beta")] = np.nan
    found = gap([replace(record, z=z)], LAYOUT, fixed())
    assert "beta" not in found
    assert "alpha" in found


def test_the_floor_is_what_the_truth_itself_leaves() -> None:
    """Median over simulated flights of the true model: a real flight of it lies near."""
    records = [flown(mav.NOISE, seed) for seed in range(3)]
    states = np.zeros(9)
    states[[0, 2, 4, 7]] = mav.trim()[0]
    sigma = np.array([mav.NOISE.get(name, 0.0) for name in OUTPUTS])
    floor = noise_floor(
        records[:1], [states], LAYOUT, fixed(), sigma, 0.0, Turbulence(), np.random.default_rng(1), repeats=5
    )
    real = gap(records, LAYOUT, fixed())
    for name in ("V", "alpha", "q", "theta", "ax", "az"):
        assert floor[name] == pytest.approx(real[name], rel=0.4), name


def test_gusts_raise_the_floor() -> None:
    record = flown(mav.NOISE)
    states = np.zeros(9)
    states[[0, 2, 4, 7]] = mav.trim()[0]
    sigma = np.array([mav.NOISE.get(name, 0.0) for name in OUTPUTS])
    calm, rough = (
        noise_floor([record], [states], LAYOUT, fixed(), sigma, 0.0, air, np.random.default_rng(1), repeats=3)
        for air in (Turbulence(), Turbulence(0.5, 0.5))
    )
    assert rough["q"] > 3.0 * calm["q"]


def test_a_model_that_cannot_fly_the_whole_run_has_a_floor_of_its_windows() -> None:
    record = flown(mav.NOISE)
    states = np.zeros(9)
    states[[0, 2, 4, 7]] = mav.trim()[0]
    sigma = np.array([mav.NOISE.get(name, 0.0) for name in OUTPUTS])
    unstable = fixed(CD_k=-1.0)  # climbs without drag until it is too fast for any number
    assert not np.isfinite(free_run(record, states, unstable)).all()
    floor = noise_floor(
        [record], [states], LAYOUT, unstable, sigma, 0.0, Turbulence(0.3, 0.3), np.random.default_rng(1), repeats=3
    )
    assert set(floor) == set(gap([record], LAYOUT, fixed()))
    assert all(np.isfinite(value) for value in floor.values())
    assert min(floor[name] for name in ("V", "alpha", "q", "az")) > 0.0

"""Whatever finite numbers come in: a result or a named error, never another exception, never a NaN in a result."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import compatibility
from sysid.equation_error.least_squares import gram_regress, regress
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify
from sysid.numerics.smoothing import fourier_smooth, noise_sigma
from sysid.signals.flight import FlightData, FlightSignals, Signal
from sysid.signals.resampling import resample

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]

VEHICLE = load_vehicle("iitb-mav")
# What the readings of a flight in trim are about; a drawn signal is off that by anything.
USUAL = {
    "ax": 0.7, "ay": 0.0, "az": -9.8, "p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.0, "theta": 0.07, "psi": 1.0,
    "alpha": 0.07, "beta": 0.0, "airspeed": 15.0, "thrust": 3.7, "de": 0.0, "da": 0.0, "dr": 0.0,
    "vn": 8.0, "ve": 12.0, "vd": 0.0,
}  # fmt: skip
SHAPES = ("constant", "noise", "ramp", "step", "sine", "alternating")
SCALES = st.sampled_from((0.0, 1e-300, 1e-12, 1e-3, 0.1, 1.0, 30.0, 1e4, 1e12, 1e300))
FEW = settings(max_examples=30, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def series(shape: str, scale: float, count: int, generator: np.random.Generator) -> Array:
    """(count,) finite values of a shape and size."""
    index = np.arange(count)
    unit = {
        "constant": np.ones(count),
        "noise": np.clip(generator.standard_normal(count), -3.0, 3.0),
        "ramp": index / count,
        "step": (index > count // 2).astype(np.float64),
        "sine": np.sin(0.3 * index),
        "alternating": np.where(index % 2 == 0, 1.0, -1.0),
    }[shape]
    return np.asarray(scale * unit)


@st.composite
def kinds(draw: st.DrawFn) -> dict[str, tuple[str, float]]:
    """Shape and size of signals that are anything; the others are plausible."""
    wild = draw(st.sets(st.sampled_from(sorted(USUAL)), max_size=4))
    return {name: (draw(st.sampled_from(SHAPES)), draw(SCALES)) for name in sorted(wild)}


SEEDS = st.integers(0, 2**32 - 1)


def columns(wild: dict[str, tuple[str, float]], seed: int, count: int) -> dict[str, Array]:
    """Signals of a flight of `count` samples."""
    generator = np.random.default_rng(seed)
    plausible = (("noise", 0.02), ("sine", 0.1), ("noise", 0.3), ("constant", 0.0))
    drawn = {}
    for name, usual in USUAL.items():
        shape, scale = wild.get(name, plausible[generator.integers(4)])
        drawn[name] = (0.0 if name in wild else usual) + series(shape, scale, count, generator)
    return drawn


def one_line(error: SysidError) -> None:
    """Check what a named error says."""
    text = str(error)
    assert text
    assert "\n" not in text


@settings(FEW, max_examples=8)
@given(kinds(), SEEDS, st.sampled_from(("ee", "oe")))
def test_identification_of_anything_ends_in_a_result_or_one_line(
    wild: dict[str, tuple[str, float]], seed: int, method: str
) -> None:
    times = np.arange(260) * 0.02
    drawn = columns(wild, seed, 260)
    flight = FlightSignals("any", {name: Signal(times, values, "SI", "drawn") for name, values in drawn.items()})
    try:
        found = identify([flight], VEHICLE, method=method, start_s=0.0)
    except SysidError as error:
        one_line(error)
        return
    json.dumps(result_json(found), allow_nan=False)
    for name, entry in found.model.coefficients.items():
        # Refused, or a number with a bar.
        if entry.value is not None:
            assert np.isfinite(entry.value), name
            assert entry.std is not None, name
            assert 0.0 < entry.std < np.inf, name


@FEW
@given(kinds(), SEEDS)
def test_compatibility_of_anything_ends_in_numbers_or_one_line(wild: dict[str, tuple[str, float]], seed: int) -> None:
    data = FlightData("any", 0.02, np.arange(120) * 0.02, columns(wild, seed, 120))
    try:
        found = compatibility(data)
    except SysidError as error:
        one_line(error)
        return
    for name, error in found.parameters.items():
        assert np.isfinite(error.value), name
        assert np.isfinite(error.std), name


@FEW
@given(st.data(), st.integers(1, 4), st.integers(2, 80))
def test_regression_on_anything_ends_in_numbers_or_one_line(data: st.DataObject, count: int, rows: int) -> None:
    generator = np.random.default_rng(data.draw(SEEDS))
    X = np.column_stack(
        [series(data.draw(st.sampled_from(SHAPES)), data.draw(SCALES), rows, generator) for _ in range(count)]
    )
    y = series(data.draw(st.sampled_from(SHAPES)), data.draw(SCALES), rows, generator)
    try:
        found = regress(y, X, [f"x{i}" for i in range(count)])
        assert np.isfinite(found.values).all()
        assert np.isfinite(found.std).all()
    except SysidError as error:
        one_line(error)
    try:
        values, covariance, variance = gram_regress(y, X)
        assert np.isfinite(values).all()
        assert np.isfinite(np.diag(covariance)).all()
        assert np.isfinite(variance)
    except SysidError as error:
        one_line(error)


@FEW
@given(st.sampled_from(SHAPES), SCALES, st.integers(0, 200), SEEDS)
def test_smoothing_anything_ends_in_numbers_or_one_line(shape: str, scale: float, count: int, seed: int) -> None:
    values = series(shape, scale, count, np.random.default_rng(seed))
    for smooth in (
        lambda: fourier_smooth(values, 0.02).values,
        lambda: fourier_smooth(values, 0.02).derivative,
        lambda: np.array([noise_sigma(values, 0.02)]),
    ):
        try:
            assert np.isfinite(smooth()).all()
        except SysidError as error:
            one_line(error)


@FEW
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=0, max_size=40), st.data())
def test_any_stamps_end_in_one_time_base_or_one_line(stamps: list[float], data: st.DataObject) -> None:
    number = st.floats(allow_nan=False, allow_infinity=False)
    values = np.array(data.draw(st.lists(number, min_size=len(stamps), max_size=len(stamps))))
    signal = Signal(np.array(stamps), values, "SI", "drawn")
    try:
        found = resample(FlightSignals("any", {"q": signal, "alpha": signal, "psi": signal, "de": signal}))
    except SysidError as error:
        one_line(error)
        return
    assert np.isfinite(found.time_s).all()
    assert not any(np.isinf(column).any() for column in found.columns.values())

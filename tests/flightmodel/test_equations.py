"""Equation error by hand, against the textbook's formulas in U.S. units and a solution by numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat

from flightmodel import Aircraft, Flight, FlightModelError, coefficients, least_squares

pytestmark = pytest.mark.whole_flight
Array = NDArray[np.float64]
G = 9.80665 / 0.3048  # ft/s^2


def by_hand(fdata: Array) -> dict[str, Array]:
    """Klein & Morelli, section 5.2, in slugs, feet and degrees, thrust along x through the centre of gravity."""
    radian = np.pi / 180.0
    S, b, c = fdata[0, 76:79]
    m, Ixx, Iyy, Izz, Ixz = fdata[0, 47:52]
    V, alpha = fdata[:, 1], fdata[:, 3] * radian
    p, q, r = (fdata[:, 4:7] * radian).T
    pdot, qdot, rdot = (fdata[:, 41:44] * radian).T
    qS = 0.5 * fdata[:, 28] * V**2 * S
    X, Y, Z = m * G * fdata[:, 10] - fdata[:, 37], m * G * fdata[:, 11], m * G * fdata[:, 12]
    return {
        "CL": (X * np.sin(alpha) - Z * np.cos(alpha)) / qS,
        "CD": -(X * np.cos(alpha) + Z * np.sin(alpha)) / qS,
        "CY": Y / qS,
        "Cl": (Ixx * pdot - Ixz * (p * q + rdot) + (Izz - Iyy) * q * r) / (qS * b),
        "Cm": (Iyy * qdot + (Ixx - Izz) * p * r + Ixz * (p**2 - r**2)) / (qS * c),
        "Cn": (Izz * rdot - Ixz * (pdot - q * r) + (Iyy - Ixx) * p * q) / (qS * b),
        "qhat": q * c / (2.0 * V),
        "phat": p * b / (2.0 * V),
        "rhat": r * b / (2.0 * V),
    }


@pytest.fixture(scope="module")
def fdata(sidpac_mat: Path) -> Array:
    array = np.asarray(loadmat(sidpac_mat)["fdata"], dtype=np.float64)
    array[:, 41:44] = np.gradient(array[:, 4:7], array[:, 0], axis=0)
    array[:, 76:79] = np.array([[3.3336, 4.1667, 0.8202]])
    return array


def test_coefficients_and_least_squares_are_those_of_the_guide_to_nine_digits(fdata: Array) -> None:
    ours, theirs = coefficients(Flight.from_fdata(fdata), Aircraft.from_fdata(fdata)), by_hand(fdata)
    for name, values in theirs.items():
        np.testing.assert_allclose(ours[name], values, rtol=1e-9, atol=1e-13, err_msg=name)
    terms = {
        "CL": ("alpha", "qhat", "de"), "CD": ("alpha",), "Cm": ("alpha", "qhat", "de"),
        "CY": ("beta", "phat", "rhat", "dr"),
        "Cl": ("beta", "phat", "rhat", "da", "dr"), "Cn": ("beta", "phat", "rhat", "da", "dr"),
    }  # fmt: skip
    angles = {"beta": fdata[:, 2], "alpha": fdata[:, 3], "de": fdata[:, 13], "da": fdata[:, 14], "dr": fdata[:, 15]}
    for axis, names in terms.items():
        columns = [theirs[name] if name in theirs else np.radians(angles[name]) for name in names]
        backslash = np.linalg.lstsq(np.column_stack([*columns, np.ones(len(fdata))]), theirs[axis], rcond=None)[0]
        found = least_squares(ours[axis], {name: ours[name] for name in names})
        np.testing.assert_allclose(list(found.values.values()), backslash, rtol=1e-9, atol=1e-12, err_msg=axis)
        assert list(found.values) == [*names, "0"]


def test_a_regression_is_a_table_and_a_frame(fdata: Array) -> None:
    ours = coefficients(Flight.from_fdata(fdata), Aircraft.from_fdata(fdata))
    found = least_squares(ours["Cm"], {"alpha": ours["alpha"], "de": ours["de"]}, constant="Cm_0")
    assert "Cm_0" in str(found)
    assert found.to_frame().loc["alpha", "std"] == found.stds["alpha"] > 0.0
    with pytest.raises(FlightModelError, match="all must be alike"):
        least_squares(ours["Cm"], {"alpha": ours["alpha"][1:]})
    with pytest.raises(FlightModelError, match="no regressor"):
        least_squares(ours["Cm"], {}, constant="")


def test_a_part_and_what_is_missing(fdata: Array) -> None:
    flight, aircraft = Flight.from_fdata(fdata), Aircraft.from_fdata(fdata)
    part = coefficients(flight, aircraft, start_s=5.0, stop_s=10.0)
    assert (part["time_s"][0], part["time_s"][-1]) == pytest.approx((5.0, 10.0), abs=1e-6)
    with pytest.raises(FlightModelError, match="0 samples lie in the part"):
        coefficients(flight, aircraft, start_s=500.0)

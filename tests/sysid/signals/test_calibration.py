import json

import numpy as np
import pytest

from sysid.calibration import calibrate, points_from_pairs, read_points, u_tube_pressure
from sysid.errors import CalibrationError

WATER_MM = 9.80665  # Pa per mm of water at 1000 kg/m3


def write(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text)
    return path


def test_straight_line_through_exact_points(tmp_path):
    # angle [deg] = -50 + 20 V
    rows = "".join(f"{-50 + 20 * v},{v}\n" for v in (0.5, 1.0, 2.0, 3.5, 4.5))
    calibration = calibrate(read_points(write(tmp_path, "reference,reading\n" + rows)), "linear", "deg")
    assert [c.name for c in calibration.coefficients] == ["offset", "slope"]
    assert [c.value for c in calibration.coefficients] == pytest.approx([-50.0, 20.0])
    values, outside = calibration.apply(np.array([2.5, 0.4, 4.6, np.nan]))
    assert values[0] == pytest.approx(0.0, abs=1e-12)
    assert values[2] == pytest.approx(np.deg2rad(42.0))
    assert outside.tolist() == [False, True, True, False]
    assert np.isnan(values[3])
    assert calibration.hysteresis is None
    assert calibration.range == (0.5, 4.5)


def test_standard_errors_cover_the_true_line():
    rng = np.random.default_rng(0)
    reading = np.linspace(0.0, 5.0, 12)
    inside = 0
    for _ in range(400):
        pairs = np.column_stack([3.0 + 2.0 * reading + 0.1 * rng.standard_normal(12), reading])
        slope = calibrate(points_from_pairs(pairs), "linear", "N").coefficients[1]
        inside += abs(slope.value - 2.0) < 2.228 * slope.std  # Student's t, 10 degrees of freedom, 95 %
    assert 0.92 < inside / 400 < 0.98


def test_polynomial_recovers_its_coefficients():
    reading = np.linspace(1000.0, 2000.0, 9)
    pairs = np.column_stack([1e-4 * (reading - 1500.0) + 1e-7 * (reading - 1500.0) ** 2, reading])
    calibration = calibrate(points_from_pairs(pairs), "polynomial:2", "rad")
    values, _ = calibration.apply(np.array([1500.0, 1750.0]))
    assert values == pytest.approx([0.0, 0.025 + 0.00625], abs=1e-12)
    assert calibration.coefficients[2].value == pytest.approx(1e-7)


def test_pitot_by_water_column_gives_calibrated_airspeed_and_its_zero():
    # dV = k V^2 with k = 0.004, zero at 2.5 V; 1 mm of water is 9.80665 Pa = 1.225 V^2 / 2
    head = np.array([-5.0, 0.0, 5.0, 10.0, 20.0, 40.0])
    squared = 2.0 * head * WATER_MM / 1.225
    pairs = np.column_stack([head, 2.5 + 0.004 * squared])
    calibration = calibrate(points_from_pairs(pairs), "pitot", "mmH2O")
    k, zero = calibration.coefficients
    assert (k.value, zero.value) == pytest.approx((0.004, 2.5))
    speeds, outside = calibration.apply(np.array([2.5 + 0.004 * 225.0, 2.5 - 0.004 * 4.0, 5.5]))
    assert speeds[:2] == pytest.approx([15.0, -2.0])
    assert outside.tolist() == [False, False, True]
    assert calibration.si_unit == "m/s"
    same = calibrate(points_from_pairs(np.column_stack([head * WATER_MM, pairs[:, 1]])), "pitot", "Pa")
    assert same.coefficients[0].value == pytest.approx(0.004)
    wind_tunnel = np.column_stack([[0.0, 5.0, 10.0, 15.0], 0.004 * np.array([0.0, 25.0, 100.0, 225.0])])
    assert calibrate(points_from_pairs(wind_tunnel), "pitot", "m/s").coefficients[0].value == pytest.approx(0.004)


def test_spline_is_monotone_and_passes_the_points():
    pairs = [[0.0, 0.5], [1.0, 0.6], [5.0, 0.8], [5.5, 2.0], [9.0, 4.0]]
    calibration = calibrate(points_from_pairs(pairs), "spline", "N")
    at_points, _ = calibration.apply(np.array([p[1] for p in pairs]))
    assert at_points == pytest.approx([p[0] for p in pairs])
    fine, outside = calibration.apply(np.linspace(0.4, 4.1, 200))
    assert np.all(np.diff(fine) >= 0.0)
    assert outside[0]
    assert outside[-1]
    with pytest.raises(CalibrationError, match="turn back between references 1 and 5"):
        calibrate(points_from_pairs([[0.0, 0.5], [1.0, 0.9], [5.0, 0.8], [9.0, 4.0]]), "spline", "N")


def test_hysteresis_is_the_gap_between_up_and_down(tmp_path):
    text = "reference,reading,direction\n0,0.0,up\n100,1.0,up\n200,2.0,up\n200,2.0,down\n100,1.1,down\n0,0.0,down\n"
    calibration = calibrate(read_points(write(tmp_path, text)), "linear", "gf")
    slope = calibration.coefficients[1].value
    assert calibration.hysteresis == pytest.approx(0.1 * slope)
    values, _ = calibration.apply(np.array([2.0]))
    assert values[0] == pytest.approx(1.961, abs=0.03)  # 200 gf in N


def test_json_has_the_schema_and_no_nan():
    calibration = calibrate(points_from_pairs([[0.0, 0.5], [1.0, 0.6], [5.0, 0.8]]), "spline", "Pa")
    text = json.dumps(calibration.to_json(), allow_nan=False)
    assert set(json.loads(text)) == {
        *("schema", "form", "unit", "coefficients", "residual_rms", "hysteresis", "range"),
    }


@pytest.mark.parametrize(
    ("text", "form", "message"),
    [
        ("", "linear", "is empty"),
        ("volt,deg\n1,2\n", "linear", "row 1: the header must be"),
        ("reference,reading\n1,2\n3,x\n", "linear", "row 3: reading 'x' is not a number"),
        ("reference,reading\n1,2\n3\n", "linear", "row 3: 1 cells"),
        ("reference,reading,direction\n1,2,left\n", "linear", "row 2: direction must be up or down"),
        ("reference,reading\n1,2\n2,3\n", "linear", "2 points are too few"),
        ("reference,reading\n1,2\n2,3\n3,4\n", "polynomial:3", "3 points are too few"),
        ("reference,reading\n1,2\n2,2\n3,2\n", "linear", "did not respond"),
        ("reference,reading\n1,2\n2,3\n3,4\n", "cubic", "unknown form 'cubic'"),
        ("reference,reading\n5,2\n5,3\n5,4\n", "linear", "every reference is 5"),
        ("reference,reading\n0,0\n1,1e-300\n2,2e-300\n", "linear", "the readings, 0 to 2e-300, hardly differ"),
        ("reference,reading\n0,0\n1,1e-300\n2,2e-300\n", "pitot", "the readings, 0 to 2e-300, hardly differ"),
        ("reference,reading\n0,0\n1e-300,1\n2e-300,2\n", "spline", "the references, 0 to 2e-300, hardly differ"),
        ("reference,reading\n0,0\n1,-1e200\n2,2\n", "linear", "a reading of -1e.200 is no instrument's"),
        ("reference,reading\n1,2\n1,3\n1,4\n", "spline", "1 references are too few"),
    ],
)
def test_bad_points_are_refused_in_one_line(tmp_path, text, form, message):
    with pytest.raises(CalibrationError, match=message) as caught:
        calibrate(read_points(write(tmp_path, text)), form, "Pa")
    assert "\n" not in str(caught.value)


def test_units_and_missing_files_are_refused(tmp_path):
    with pytest.raises(CalibrationError, match="unknown unit 'psi'"):
        calibrate(points_from_pairs([[0, 0], [1, 1], [2, 2]]), "linear", "psi")
    with pytest.raises(CalibrationError, match="Pa, mmH2O or m/s"):
        calibrate(points_from_pairs([[0, 0], [1, 1], [2, 2]]), "pitot", "deg")
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_points(tmp_path / "none.csv")


def test_u_tube():
    assert u_tube_pressure(0.01) == pytest.approx(98.0665)
    assert u_tube_pressure(0.01, 800.0) == pytest.approx(78.4532)

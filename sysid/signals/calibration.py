"""Bench calibration: points of reference against reading -> the curve that turns a reading into SI.

Forms: `linear` and `polynomial:N` give the reference as a polynomial of the reading; `spline` is a monotone cubic
through the mean reading of each reference (F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5(2), 1984: PCHIP);
`pitot` is dV = k V^2 at 1.225 kg/m3, odd in dV, which gives calibrated airspeed.

A CSV of points has the header `reference,reading` or `reference,reading,direction`:

    reference,reading,direction
    0,2.501,up
    50,2.548,up
    50,2.551,down
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sysid.arrays import Array
from sysid.errors import CalibrationError

WATER_DENSITY = 1000.0  # kg/m^3, of a U-tube at the bench

# Unit of the references -> (SI unit, factor). Microseconds stay: they are a servo's own unit everywhere.
UNITS = {
    "": ("", 1.0),
    "Pa": ("Pa", 1.0),
    "mmH2O": ("Pa", STANDARD_GRAVITY),
    "N": ("N", 1.0),
    "gf": ("N", 1e-3 * STANDARD_GRAVITY),
    "deg": ("rad", float(np.pi / 180.0)),
    "rad": ("rad", 1.0),
    "us": ("us", 1.0),
    "V": ("V", 1.0),
    "m/s": ("m/s", 1.0),
}
MAX_DEGREE = 9  # of a polynomial; readings at which a thrust's mode is sought, and its step in standard errors
_MODE_GRID, _MODE_STEP = 801, 1e-2
# Of readings and references in any unit: the largest, and the smallest spread.
_LARGEST, _SMALLEST = 1e12, 1e-12


@dataclass(frozen=True)
class BenchPoints:
    """Points of one sensor: reference, reading (M,) each, direction "up", "down" or "" of each, and their source."""

    reference: Array
    reading: Array
    direction: tuple[str, ...]
    source: str


@dataclass(frozen=True)
class CalibrationCoefficient:
    """One coefficient of a curve, in the units of references and readings; std None where no point is left for it."""

    name: str
    value: float
    std: float | None


@dataclass(frozen=True)
class Calibration:
    """A curve from reading to value.

    form, unit: as asked for; coefficients are in that unit. si_unit: unit of what `apply` gives ("m/s" for pitot).
    residual_rms: of the fit, in the references' unit, for pitot in the readings'. hysteresis: largest difference
    between up and down at one reference, same unit; None without both directions. range: lowest and highest reading.
    covariance: (K, K) of the coefficients, NaN where no point is left for it.
    """

    form: str
    unit: str
    si_unit: str
    coefficients: tuple[CalibrationCoefficient, ...]
    residual_rms: float
    hysteresis: float | None
    range: tuple[float, float]
    covariance: Array = field(default_factory=lambda: np.full((1, 1), np.nan), compare=False)

    def apply(self, readings: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Values in SI and a mask of the readings outside the bench's range, whose values are extrapolated.

        readings: (N,) in the bench's reading unit; NaN gives NaN and counts as inside. A spline goes on straight.
        """
        readings = np.asarray(readings, dtype=np.float64)
        outside = (readings < self.range[0]) | (readings > self.range[1])
        return self._curve(readings, np.array([c.value for c in self.coefficients])), outside

    def _curve(self, readings: Array, values: Array) -> Array:
        """Values in SI (N,) of readings (N,) for these coefficients (K,)."""
        if self.form == "pitot":
            squared = (readings - values[1]) / values[0]
            return np.asarray(np.sign(squared) * np.sqrt(np.abs(squared)))
        if self.form == "spline":
            knots = np.array([float(c.name.removeprefix("at_")) for c in self.coefficients])
            result = _spline(knots, values, readings)
        else:
            result = np.asarray(np.polynomial.polynomial.polyval(readings, values), dtype=np.float64)
        return np.asarray(result * UNITS[self.unit][1])

    @property
    def error_known(self) -> bool:
        """Whether the bench had points to spare, whose scatter gives the curve's error."""
        return bool(np.isfinite(self.covariance).all())

    def error_modes(self, values: Array) -> Array:
        """What the curve's own error adds to measured values (N,) [SI], as (K, N) independent parts of one sigma each.

        The covariance of the curve at two values is the sum over the parts of their products. To first order in the
        coefficients' errors; zeros where the bench does not determine them (`error_known`).
        """
        values = np.asarray(values, dtype=np.float64)
        if not self.error_known:
            return np.zeros((len(self.coefficients), values.size))
        curve, modes = self._modes
        return np.array([np.interp(values, curve, mode) for mode in modes])

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """The curve at points over the bench's range, rising, and the parts of its error (K, points) there."""
        best = np.array([c.value for c in self.coefficients])
        readings = np.asarray(np.linspace(*self.range, _MODE_GRID), dtype=np.float64)
        curve = self._curve(readings, best)
        std = np.sqrt(np.diag(self.covariance))
        slopes = np.zeros((best.size, readings.size))
        for i, step in enumerate(_MODE_STEP * std):
            ends = [self._curve(readings, best + sign * step * np.eye(best.size)[i]) for sign in (1.0, -1.0)]
            if step > 0.0:
                slopes[i] = (ends[0] - ends[1]) / (2.0 * step)
        # Scaled, since coefficients of high powers differ from the others by orders of magnitude.
        scale = np.where(std > 0.0, std, 1.0)
        power, axes = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        modes = (slopes.T * scale @ axes * np.sqrt(np.maximum(power, 0.0))).T
        order = np.argsort(curve, kind="stable")
        return curve[order], modes[:, order]

    def to_json(self) -> dict[str, object]:
        """JSON values of the schema calibration/1."""
        return {
            "schema": "calibration/1",
            "form": self.form,
            "unit": self.unit,
            "coefficients": [{"name": c.name, "value": c.value, "std": c.std} for c in self.coefficients],
            "residual_rms": self.residual_rms,
            "hysteresis": self.hysteresis,
            "range": list(self.range),
        }


def u_tube_pressure(head_m: float, density: float = WATER_DENSITY) -> float:
    """Pressure, Pa, of a U-tube manometer's head (m) of a liquid of this density (kg/m^3): rho g h."""
    return density * STANDARD_GRAVITY * head_m


def read_points(path: str | Path) -> BenchPoints:
    """Bench points of a CSV file. Raises CalibrationError naming the row that is wrong."""
    source = str(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CalibrationError(f"{source}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{source}: is no text in UTF-8; save the table as CSV") from error
    rows = [(number, row) for number, row in enumerate(csv.reader(text.splitlines()), 1) if any(map(str.strip, row))]
    if not rows:
        raise CalibrationError(f"{source}: is empty; the first row must be reference,reading or ...,direction")
    header = [cell.strip().lower() for cell in rows[0][1]]
    if "reference" not in header or "reading" not in header or set(header) - {"reference", "reading", "direction"}:
        raise CalibrationError(
            f"{source} row {rows[0][0]}: the header must be reference,reading or reference,reading,direction,"
            f" not {','.join(header)}"
        )
    points = []
    for number, row in rows[1:]:
        if len(row) != len(header):
            raise CalibrationError(f"{source} row {number}: {len(row)} cells, the header has {len(header)}")
        points.append(_point(source, number, dict(zip(header, (cell.strip() for cell in row), strict=True))))
    return _gather(points, source)


def points_from_pairs(pairs: Iterable[Sequence[float]], source: str = "points") -> BenchPoints:
    """Bench points from [reference, reading] pairs. Raises CalibrationError naming the pair that is wrong."""
    points = []
    for number, pair in enumerate(pairs, 1):
        if len(pair) != 2 or not np.all(np.isfinite(pair)):
            raise CalibrationError(f"{source} pair {number}: must be two numbers, reference and reading, not {pair}")
        points.append((float(pair[0]), float(pair[1]), ""))
    return _gather(points, source)


def calibrate(points: BenchPoints, form: str, unit: str = "") -> Calibration:
    """Fit the curve of a form to bench points.

    form: "linear", "polynomial:N" (N = 1..9), "spline" or "pitot". unit: of the references (UNITS); a pitot's may be
    pressure (Pa, mmH2O), taken as 1/2 1.225 V^2, or airspeed (m/s).
    Raises CalibrationError in one line: unknown form or unit, too few points, a reading that does not change, a spline
    whose readings turn back.
    """
    if unit not in UNITS:
        known = ", ".join(name for name in UNITS if name)
        raise CalibrationError(f"{points.source}: unknown unit {unit!r}; known are {known}")
    if np.ptp(points.reading) == 0.0:
        raise CalibrationError(f"{points.source}: every reading is {points.reading[0]:g}; the sensor did not respond")
    _check_sizes(points)
    if form == "pitot":
        return _pitot(points, unit)
    if form == "spline":
        return _monotone(points, unit)
    return _polynomial(points, form, unit)


def _check_sizes(points: BenchPoints) -> None:
    """Readings and references as instruments give them: of others squares and quotients leave the range of numbers."""
    for name, values in (("reading", points.reading), ("reference", points.reference)):
        largest = values[np.argmax(np.abs(values))]
        if abs(largest) > _LARGEST:
            raise CalibrationError(f"{points.source}: a {name} of {largest:g} is no instrument's; correct the point")
        if 0.0 < np.ptp(values) < _SMALLEST:
            low, high = values.min(), values.max()
            raise CalibrationError(
                f"{points.source}: the {name}s, {low:g} to {high:g}, hardly differ: no instrument distinguishes them;"
                " correct the points or give them in another unit"
            )


def _point(source: str, number: int, cells: dict[str, str]) -> tuple[float, float, str]:
    values = []
    for name in ("reference", "reading"):
        try:
            value = float(cells[name])
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise CalibrationError(f"{source} row {number}: {name} {cells[name]!r} is not a number")
        values.append(value)
    direction = cells.get("direction", "").lower()
    if direction not in ("", "up", "down"):
        raise CalibrationError(f"{source} row {number}: direction must be up or down, not {direction!r}")
    return values[0], values[1], direction


def _gather(points: list[tuple[float, float, str]], source: str) -> BenchPoints:
    if not points:
        raise CalibrationError(f"{source}: holds no points")
    reference, reading, direction = zip(*points, strict=True)
    return BenchPoints(np.array(reference), np.array(reading), tuple(direction), source)


def _least_squares(X: Array, y: Array, source: str, what: str) -> tuple[Array, Array, float]:
    """Values, their covariance and residual rms (degrees of freedom taken off)."""
    n, count = X.shape
    if n < count + 1:
        raise CalibrationError(f"{source}: {n} points are too few for {what}; it takes at least {count + 1}")
    scale = np.abs(X).max(axis=0)
    Q, R = np.linalg.qr(X / scale)
    if np.abs(np.diag(R)).min() < 1e-10 * np.abs(np.diag(R)).max():
        raise CalibrationError(f"{source}: too few different points for {what}; add points or lower the order")
    values = np.linalg.solve(R, Q.T @ y)
    residual = y - X / scale @ values
    rms = float(np.sqrt(residual @ residual / (n - count)))
    inverse = np.linalg.inv(R)
    covariance = rms**2 * inverse @ inverse.T
    return values / scale, covariance / np.outer(scale, scale), rms


def _polynomial(points: BenchPoints, form: str, unit: str) -> Calibration:
    kind, _, order = form.partition(":")
    degree = 1 if form == "linear" else int(order) if kind == "polynomial" and order.isdecimal() else 0
    if not 1 <= degree <= MAX_DEGREE:
        raise CalibrationError(
            f"{points.source}: unknown form {form!r}; use linear, polynomial:N (N = 1 to {MAX_DEGREE}), spline or pitot"
        )
    if points.reference.size > 1 and np.ptp(points.reference) == 0.0:
        raise CalibrationError(f"{points.source}: every reference is {points.reference[0]:g}; add points at others")
    X = np.asarray(np.polynomial.polynomial.polyvander(points.reading, degree), dtype=np.float64)
    values, covariance, rms = _least_squares(X, points.reference, points.source, form)
    names = ["offset", "slope"] if form == "linear" else [f"c{i}" for i in range(degree + 1)]
    at_reading = X @ values
    return Calibration(
        *(form, unit, UNITS[unit][0], _named(names, values, covariance), rms),
        *(_hysteresis(points, at_reading), _range(points), covariance),
    )


def _monotone(points: BenchPoints, unit: str) -> Calibration:
    reference, group = np.unique(points.reference, return_inverse=True)
    if reference.size < 3:
        raise CalibrationError(f"{points.source}: {reference.size} references are too few for a spline; it takes 3")
    count = np.bincount(group)
    reading = np.bincount(group, points.reading) / count
    steps = np.diff(reading)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        turn = int(np.argmax(np.sign(steps) != np.sign(reading[-1] - reading[0])))
        raise CalibrationError(
            f"{points.source}: the readings turn back between references {reference[turn]:g} and"
            f" {reference[turn + 1]:g}; a monotone spline cannot follow: repeat these points or use linear"
        )
    order = np.argsort(reading)
    knots, values = reading[order], reference[order]
    at_reading = _spline(knots, values, points.reading)
    residual = points.reference - at_reading
    free = points.reading.size - reference.size
    rms = float(np.sqrt(residual @ residual / free)) if free > 0 else 0.0
    covariance = np.diag(rms**2 / count[order]) if free > 0 else np.full((knots.size, knots.size), np.nan)
    names = [f"at_{float(knot)!r}" for knot in knots]
    return Calibration(
        *("spline", unit, UNITS[unit][0], _named(names, values, covariance), rms),
        *(_hysteresis(points, at_reading), _range(points), covariance),
    )


def _pitot(points: BenchPoints, unit: str) -> Calibration:
    if unit == "m/s":
        squared = points.reference * np.abs(points.reference)
    elif UNITS[unit][0] == "Pa":
        squared = 2.0 * UNITS[unit][1] * points.reference / SEA_LEVEL_DENSITY
    else:
        raise CalibrationError(
            f"{points.source}: a pitot's references are in Pa, mmH2O or m/s, not {unit or 'no unit'}"
        )
    # Two different flows and a point to spare determine the zero-flow reading; else readings count as differences from
    # it.
    with_zero = np.unique(squared).size >= 2 and squared.size >= 3
    X = np.column_stack([squared, np.ones(squared.size)]) if with_zero else squared[:, None]
    if not np.any(squared):
        raise CalibrationError(f"{points.source}: every reference is 0; a pitot needs points with flow")
    values, covariance, rms = _least_squares(X, points.reading, points.source, "pitot")
    if values[0] == 0.0:
        raise CalibrationError(f"{points.source}: the reading does not change with flow")
    if not with_zero:
        # Readings count as differences from that of no flow: nothing is left to be in error there.
        values, covariance = np.append(values, 0.0), np.pad(covariance, ((0, 1), (0, 1)))
    coefficients = _named(["k", "zero_reading"], values, covariance)
    if not with_zero:
        coefficients = (coefficients[0], replace(coefficients[1], std=None))
    return Calibration(
        *("pitot", unit, "m/s", coefficients, rms, _hysteresis(points, points.reading), _range(points), covariance)
    )


def _named(names: Sequence[str], values: Array, covariance: Array) -> tuple[CalibrationCoefficient, ...]:
    return tuple(
        CalibrationCoefficient(name, float(value), float(s) if np.isfinite(s) else None)
        for name, value, s in zip(names, values, np.sqrt(np.diag(covariance)), strict=True)
    )


def _spline(knots: Array, values: Array, at: Array) -> Array:
    from scipy.interpolate import PchipInterpolator  # slow to import, and seldom wanted

    curve = PchipInterpolator(knots, values)
    slope = curve.derivative()
    inside = np.clip(at, knots[0], knots[-1])
    return np.asarray(curve(inside) + slope(inside) * (at - inside), dtype=np.float64)


def _hysteresis(points: BenchPoints, values: Array) -> float | None:
    """Largest difference between the means going up and going down at one reference."""
    direction = np.array(points.direction)
    gaps = []
    for reference in np.unique(points.reference):
        up = values[(points.reference == reference) & (direction == "up")]
        down = values[(points.reference == reference) & (direction == "down")]
        if up.size and down.size:
            gaps.append(abs(float(up.mean() - down.mean())))
    return max(gaps) if gaps else None


def _range(points: BenchPoints) -> tuple[float, float]:
    return float(points.reading.min()), float(points.reading.max())

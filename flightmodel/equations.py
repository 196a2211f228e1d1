"""Equation error by hand: coefficients along a flight, and least squares on regressors of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightmodel.aircraft import Aircraft
from flightmodel.errors import FlightModelError
from flightmodel.flight import Flight
from flightmodel.optional import library
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sysid.signals.flight import FlightData, FlightSignals

Array = NDArray[np.float64]
_NEEDED = ("ax", "ay", "az", "p", "q", "r", "alpha", "airspeed", "thrust")
_BESIDE = ("beta", "de", "da", "dr", "throttle")
_RATES = ("p", "q", "r")


def coefficients(
    flight: Flight, aircraft: Aircraft, *, start_s: float | None = None, stop_s: float | None = None
) -> dict[str, Array]:
    """Force and moment coefficients at every sample, as the sensors read: nothing is corrected or estimated.

    Parameters
    ----------
    flight : Flight
        With accelerometers, gyros, angle of attack, airspeed and thrust; angular accelerations (pdot, qdot, rdot) where
        it has them, else the derivative of the rates after Fourier smoothing.
    aircraft : Aircraft
        Mass, inertia, wing, thrust line.
    start_s, stop_s : float | None
        The part to take, s from the flight's first stamp.

    Returns
    -------
    dict[str, Array], each of shape (N,)
        time_s [s]; CL, CD, CY, Cl, Cm, Cn; phat, qhat, rhat [1]; alpha, beta, de, da, dr [rad]; V [m/s]; qbar [Pa].

    References
    ----------
    Klein & Morelli, Aircraft System Identification, 2nd ed., section 5.2.

    Examples
    --------
    >>> c = coefficients(flight, aircraft, start_s=2.0)
    >>> fit = least_squares(c["CL"], {"CL_alpha": c["alpha"], "CL_q": c["qhat"], "CL_de": c["de"]})
    >>> fit.r2 > 0.8
    True
    """
    from sysid.equation_error.coefficients import body_of, dynamic_pressure
    from sysid.equation_error.coefficients import coefficients as along

    signals = flight.of(aircraft)
    signals.require(*_NEEDED)
    time_s = signals.signals["q"].time_s
    inside = (time_s >= (-np.inf if start_s is None else start_s)) & (time_s <= (np.inf if stop_s is None else stop_s))
    time_s = time_s[inside]
    if time_s.size < 16:
        raise FlightModelError(f"{flight.name}: {time_s.size} samples lie in the part asked for; give a longer one")
    columns = {key: _on(signals, key, time_s) for key in (*_NEEDED, *_BESIDE) if key in signals.signals}
    columns["air_density"] = _density(signals, aircraft, time_s)
    speed = columns.pop("airspeed")
    if aircraft.vehicle.sensors.airspeed.kind != "true":
        speed = speed * np.sqrt(SEA_LEVEL_DENSITY / columns["air_density"])
    columns["V"] = speed
    interval_s = float(np.median(np.diff(time_s)))
    data = FlightData(flight.name, interval_s, time_s, columns)
    body = body_of(aircraft.vehicle)
    turning = np.column_stack([_turning(signals, key, time_s, columns[key], interval_s) for key in _RATES])
    lengths = dict(zip(_RATES, (body.b, body.c, body.b), strict=True))
    return {
        "time_s": time_s,
        **along(data, body, turning),
        **{f"{key}hat": columns[key] * length / (2.0 * speed) for key, length in lengths.items()},
        **{key: columns[key] for key in ("alpha", *_BESIDE) if key in columns},
        "V": speed,
        "qbar": dynamic_pressure(data, body),
    }


@dataclass(frozen=True)
class LeastSquares:
    """A regression. values, stds: by regressor; the standard errors hold for coloured residuals. r2: of the fit.

    residual: (N,). condition: largest condition index of the regressors.
    """

    values: dict[str, float]
    stds: dict[str, float]
    r2: float
    condition: float
    residual: Array = field(repr=False)

    def table(self) -> str:
        """Estimates and standard errors as text."""
        lines = [f"  {key:<14}{value:>14.6g} ± {self.stds[key]:.3g}" for key, value in self.values.items()]
        return "\n".join([*lines, f"  R2 {self.r2:.5f}, condition {self.condition:.3g}, {self.residual.size} samples"])

    def to_frame(self) -> Any:
        """A pandas frame: value and std of each regressor."""
        pandas = library("pandas", "to_frame")
        return pandas.DataFrame({"value": self.values, "std": self.stds})

    def __str__(self) -> str:
        return self.table()


def least_squares(z: ArrayLike, regressors: Mapping[str, ArrayLike], *, constant: str = "0") -> LeastSquares:
    """Ordinary least squares, z = sum of coefficient * regressor + constant.

    Parameters
    ----------
    z : ArrayLike, shape (N,)
        What is explained, as a coefficient of `coefficients`.
    regressors : Mapping[str, ArrayLike], each of shape (N,)
        What explains it, by name.
    constant : str
        Name of the constant; "" for none.

    Returns
    -------
    LeastSquares
        Estimates with standard errors for coloured residuals.

    References
    ----------
    Klein & Morelli, chapter 5; Morelli & Klein, AIAA 95-3499.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 50)
    >>> fit = least_squares(3.0 * x + 0.5, {"slope": x})
    >>> {key: round(value, 9) for key, value in fit.values.items()}
    {'slope': 3.0, '0': 0.5}
    """
    from sysid.equation_error.least_squares import regress

    known = np.asarray(z, dtype=np.float64)
    columns = {key: np.asarray(one, dtype=np.float64) for key, one in regressors.items()}
    names: Sequence[str] = [*columns, *([constant] if constant else [])]
    ones = [np.ones_like(known)] if constant else []
    if not names:
        raise FlightModelError("least_squares: no regressor was given")
    if any(one.shape != known.shape for one in columns.values()):
        shapes = ", ".join(f"{key} {one.shape}" for key, one in columns.items())
        raise FlightModelError(f"least_squares: z has the shape {known.shape}, and {shapes}: all must be alike")
    found = regress(known, np.column_stack([*columns.values(), *ones]), names)
    return LeastSquares(
        dict(zip(names, found.values.tolist(), strict=True)), dict(zip(names, found.std.tolist(), strict=True)),
        float(found.r2), float(found.condition), found.residual,
    )  # fmt: skip


def _on(signals: FlightSignals, name: str, time_s: Array) -> Array:
    """A signal at these moments, linear between its samples."""
    one = signals.signals[name]
    known = np.isfinite(one.values)
    return np.interp(time_s, one.time_s[known], one.values[known])


def _density(signals: FlightSignals, aircraft: Aircraft, time_s: Array) -> Array:
    fixed = aircraft.vehicle.environment.air_density
    if fixed is not None or "air_density" not in signals.signals:
        return np.full(time_s.size, SEA_LEVEL_DENSITY if fixed is None else fixed)
    return _on(signals, "air_density", time_s)


def _turning(signals: FlightSignals, rate: str, time_s: Array, values: Array, interval_s: float) -> Array:
    """Angular acceleration, rad/s^2: as measured, else the rate's derivative."""
    if f"{rate}dot" in signals.signals:
        return _on(signals, f"{rate}dot", time_s)
    from sysid.numerics.smoothing import fourier_smooth

    even = time_s[0] + interval_s * np.arange(round((time_s[-1] - time_s[0]) / interval_s) + 1)
    smooth = fourier_smooth(np.interp(even, time_s, values), interval_s)
    return np.interp(time_s, even, smooth.derivative)

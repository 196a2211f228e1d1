"""Moving air: steady wind, wind shear, and Dryden turbulence.

Spectra: MIL-F-8785C, 3.7.1.2 (Dryden form, as in MIL-STD-1797A), with one intensity `sigma` and one scale
length `length` for the three components, which a sub-metre aircraft near the ground cannot distinguish from
the low-altitude table:

    Phi_u(w) = sigma^2 (2 tau / pi) / (1 + (tau w)^2)                               tau = length / V
    Phi_v(w) = Phi_w(w) = sigma^2 (tau / pi) (1 + 3 (tau w)^2) / (1 + (tau w)^2)^2  one-sided, integral
    sigma^2
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_arrays

Array = NDArray[np.float64]


@jit_arrays
def _second_order(decay: float, step: float, root: Array, noise: Array, start: Array) -> Array:
    """sqrt(3) x1 + (1 - sqrt(3)) x2 of x1' = (n - x1) / tau, x2' = (x1 - x2) / tau, stepped exactly."""
    c1 = np.sqrt(3.0)
    out = np.empty(noise.shape[0])
    x1, x2 = start[0], start[1]
    for k in range(noise.shape[0]):
        out[k] = c1 * x1 + (1.0 - c1) * x2
        n1, n2 = noise[k, 0], noise[k, 1]
        x2 = decay * (step * x1 + x2) + root[1, 0] * n1 + root[1, 1] * n2
        x1 = decay * x1 + root[0, 0] * n1
    return out


@jit_arrays
def _first_order(decay: float, noise: Array, start: float) -> Array:
    out = np.empty(noise.shape[0])
    x = start
    for k in range(noise.shape[0]):
        out[k] = x
        x = decay * x + np.sqrt(1.0 - decay * decay) * noise[k]
    return out


def dryden_gusts(
    samples: int,
    dt: float,
    *,
    sigma: float,
    length: float,
    airspeed: float,
    generator: np.random.Generator,
    stationary: bool = True,
) -> Array:
    """Gusts of Dryden turbulence, as an aircraft sees them at a constant airspeed.

    The filters are discretised exactly, so variance and correlation hold for any `dt`.

    Parameters
    ----------
    samples : int
        Number of samples.
    dt : float
        Interval of the samples, s.
    sigma : float
        Intensity, standard deviation of each component, m/s.
    length : float
        Scale length, m.
    airspeed : float
        Airspeed of the aircraft, m/s.
    generator : np.random.Generator
        Source of the white noise.
    stationary : bool
        Start from the spectrum's own distribution; otherwise the air is calm in the first sample, as a flight that
        starts in trim wants.

    Returns
    -------
    Array, shape (samples, 3)
        Gusts in body axes u, v, w, m/s.

    References
    ----------
    MIL-F-8785C, 3.7.1.2 (Dryden form, as in MIL-STD-1797A).
    """
    step = dt * airspeed / length
    decay = float(np.exp(-step))
    along = generator.standard_normal(samples + 1)
    across = generator.standard_normal((2, samples + 1, 2))
    # Stationary covariance of (x1, x2) for white noise that gives y unit variance, and what one step adds to
    # it.
    covariance = np.array([[0.5, 0.25], [0.25, 0.25]])
    transition = decay * np.array([[1.0, 0.0], [step, 1.0]])
    root = np.linalg.cholesky(covariance - transition @ covariance @ transition.T)
    start_root = np.linalg.cholesky(covariance) * float(stationary)
    gusts = np.empty((samples, 3))
    gusts[:, 0] = _first_order(decay, np.ascontiguousarray(along[1:]), float(along[0]) * float(stationary))
    for axis in range(2):
        noise = np.ascontiguousarray(across[axis, 1:])
        start = start_root @ across[axis, 0]
        gusts[:, axis + 1] = _second_order(decay, step, root, noise, start)
    return sigma * gusts


@dataclass(frozen=True)
class WindField:
    """The air's motion: `steady` (north, east, down), m/s, and north wind growing by `gradient`, 1/s, with
    height.

    Shear is zero at `reference_altitude`, m; flying north, V' = -gradient h'.
    """

    steady: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gradient: float = 0.0
    reference_altitude: float = 0.0
    sigma: float = 0.0
    length: float = 20.0

    @staticmethod
    def from_effects(
        steady: tuple[float, float, float],
        effects: Mapping[str, Mapping[str, float]],
        reference_altitude: float,
    ) -> WindField:
        """The wind asked for plus the environment effects `steady_wind`, `wind_shear` and `turbulence`."""
        extra = effects.get("steady_wind", {})
        added = (extra.get("north", 0.0), extra.get("east", 0.0), extra.get("down", 0.0))
        total = (steady[0] + added[0], steady[1] + added[1], steady[2] + added[2])
        gradient = effects.get("wind_shear", {}).get("gradient", 0.0)
        turbulence = effects.get("turbulence", {})
        sigma = turbulence.get("sigma", 0.0)
        return WindField(total, gradient, reference_altitude, sigma, turbulence.get("length", 20.0))

    def at(self, altitude: float) -> Array:
        """Velocity of the air (north, east, down), m/s, without gusts, at `altitude`, m."""
        north, east, down = self.steady
        return np.array([north + self.gradient * (altitude - self.reference_altitude), east, down])

    def gusts(self, samples: int, dt: float, airspeed: float, generator: np.random.Generator) -> Array:
        """Gusts (samples, 3), body axes, m/s, growing from calm air; zeros without turbulence."""
        if self.sigma == 0.0:
            return np.zeros((samples, 3))
        return dryden_gusts(
            samples,
            dt,
            sigma=self.sigma,
            length=self.length,
            airspeed=airspeed,
            generator=generator,
            stationary=False,
        )

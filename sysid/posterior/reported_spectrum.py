"""The spectrum of what a simulation leaves of each output, beside what the sensor alone would leave: for reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.observations import joined_at
from sysid.posterior.residual_spectrum import ResidualSpectrum

_SENSORS = {
    **dict.fromkeys(("p", "q", "r"), ("gyro", "rad/s")),
    **dict.fromkeys(("ax", "ay", "az"), ("accelerometer", "m/s^2")),
    "alpha": ("alpha_vane", "rad"), "beta": ("beta_vane", "rad"),
}  # fmt: skip


@dataclass(frozen=True)
class NoiseSpectrum:
    """What is left of one output of one flight.

    unit: of the densities, the output's own per sqrt(Hz). frequencies: (F,) Hz, those that counted. density: (F,)
    one-sided amplitude. sensor: the flat density of the sensor's own noise; None where the vehicle file has none.
    """

    flight: str
    output: str
    unit: str
    frequencies: Array
    density: Array
    sensor: float | None

    def to_json(self) -> dict[str, Any]:
        """The entry of a result file, numbers to four digits."""
        return {
            "flight": self.flight, "output": self.output, "unit": self.unit,
            "frequency_hz": [_rounded(one) for one in self.frequencies],
            "density": [_rounded(one) for one in self.density],
            "sensor": None if self.sensor is None else _rounded(self.sensor),
        }  # fmt: skip


def noise_spectra(
    outputs: Sequence[str], spectra: Mapping[str, ResidualSpectrum], parts: Sequence[FlightPart], vehicle: Vehicle,
    whole: bool = False,
) -> tuple[NoiseSpectrum, ...]:  # fmt: skip
    """What is left of every output of every flight. spectra: flight -> matrices in the order of outputs. whole: whether
    all of the band counted.
    """
    found = []
    for flight, spectrum in spectra.items():
        own = [part for part in parts if part.flight == flight]
        for i, name in enumerate(outputs):
            highest = max(part.highest_hz(name, whole) for part in own)
            counted = (spectrum.frequencies > 0.0) & (spectrum.frequencies <= highest)
            sensor, unit = _SENSORS[name]
            density = np.sqrt(spectrum.matrices[counted, i, i].real)
            level = sensor_density(vehicle.sensors[sensor].noise, name, own)
            found.append(NoiseSpectrum(flight, name, f"{unit}/sqrt(Hz)", spectrum.frequencies[counted], density, level))
    return tuple(found)


def sensor_density(noise: float | None, output: str, parts: Sequence[FlightPart]) -> float | None:
    """One-sided amplitude density per sqrt(Hz) of white noise (1 sigma) in an output, as the residuals hold it.

    noise sqrt(2 dt), dt the message's interval. A message faster than the common grid is not averaged there: its noise
    folds, and stands higher.
    """
    if noise is None:
        return None
    power, points = 0.0, 0
    for part in parts:
        weights = joined_at(part.channels[output].time_s, part.common.points)[np.flatnonzero(part.common.counted)]
        power += 2.0 * part.common.interval_s * float(np.sum(np.asarray(weights.sum(axis=0)) ** 2))
        points += weights.shape[0]
    return noise * float(np.sqrt(power / points))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")

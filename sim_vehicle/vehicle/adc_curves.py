"""Analogue sensors: what the board's converter reads, through curves that only the hardware knows.

A data file beside the vehicle file (NAME.analogue.json) holds the true curves; the user knows them only
through bench points (`sim_vehicle.vehicle.bench_points`), as with real sensors:

    {"schema": "analogue/1", "supply": 5.0, "bits": 12,
     "channels": [{"adc": 3, "signal": "airspeed", "form": "pitot", "coefficients": [0.62, 0.0049]}, ...]}

`pitot`: volts = c0 + c1 v |v|, v calibrated airspeed, m/s. `polynomial`: volts = c0 + c1 x + c2 x^2 + ..., x
in SI.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_vehicle.errors import VehicleFileError

Array = NDArray[np.float64]
SCHEMA = "analogue/1"
FORMS = ("pitot", "polynomial")


@dataclass(frozen=True)
class AnalogueChannel:
    """One input of the converter: its number, the signal it carries, and its true curve to volts."""

    adc: int
    signal: str
    form: str
    coefficients: tuple[float, ...]

    def volts(self, value: ArrayLike) -> Array:
        """Volts at the converter's input for the signal's value, SI."""
        x: Any = value if isinstance(value, float) else np.asarray(value, dtype=np.float64)
        powers = x * abs(x) if self.form == "pitot" else x
        volts = 0.0 * powers
        for coefficient in reversed(self.coefficients):
            volts = volts * powers + coefficient
        return np.asarray(volts)


@dataclass(frozen=True)
class AnalogueBoard:
    """The converter: supply voltage (its full scale), bits, and channels."""

    supply: float
    bits: int
    channels: tuple[AnalogueChannel, ...]

    def read(self, values: Mapping[str, float], *, exact: bool) -> dict[str, float]:
        """Volts of every channel, `adc3` and so on, for the signals' values, SI. exact: not in steps."""
        volts = np.array([channel.volts(values[channel.signal]) for channel in self.channels])
        names = [f"adc{channel.adc}" for channel in self.channels]
        return dict(zip(names, (volts if exact else self.converted(volts)).tolist(), strict=True))

    def converted(self, volts: ArrayLike) -> Array:
        """Volts as the converter reads them: whole steps of supply / 2^bits, within its range."""
        step = self.supply / 2**self.bits
        return np.asarray(np.clip(np.round(np.asarray(volts) / step), 0, 2**self.bits - 1) * step)


def load_analogue(vehicle_path: Path) -> AnalogueBoard | None:
    """The analogue board of a vehicle, None where no NAME.analogue.json lies beside NAME.toml.

    Raises VehicleFileError in one line for a file that is not as above.
    """
    path = vehicle_path.with_suffix(".analogue.json")
    if not path.is_file():
        return None
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise VehicleFileError(f'{path}: its "schema" must be "{SCHEMA}"')
        channels = tuple(
            AnalogueChannel(
                int(entry["adc"]),
                str(entry["signal"]),
                str(entry["form"]),
                tuple(float(value) for value in entry["coefficients"]),
            )
            for entry in data["channels"]
        )
        board = AnalogueBoard(float(data["supply"]), int(data["bits"]), channels)
    except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise VehicleFileError(f"{path}: cannot be read as JSON: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise VehicleFileError(f"{path}: a key is missing or has the wrong type: {error}") from None
    for channel in channels:
        if channel.form not in FORMS or not 0 <= channel.adc <= 15:
            raise VehicleFileError(f"{path}: channel {channel.adc}: adc is 0 to 15, form {' or '.join(FORMS)}")
    return board

"""What one simulated flight leaves behind: the truth, and what the sensors measured of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.errors import SinkError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlownSegment:
    """A manoeuvre as flown: begin and end, s since the first sample."""

    manoeuvre: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class FlownFlight:
    """Truth and measurements of one flight.

    time_s: (N,) ticks, s since the first sample. truth: every OUTPUT of the plant, (N,), at the centre of gravity.
    command: (N, 4) de, da, dr, throttle as the servos got them, held from each tick to the next. servos:
    output number -> (N,) us. wind_ned, gust_body: (N, 3) m/s, the wind of the step that ends at each tick, and the gust
    that a sensor meets there.
    measured: signal -> (times, values), as a recording carries them. sensor_errors: the true ones, by the
    names of an identification's result. failures: what broke, its size and when, s.
    """

    time_s: Array
    truth: dict[str, Array]
    command: Array
    servos: dict[int, Array]
    wind_ned: Array
    gust_body: Array
    measured: dict[str, tuple[Array, Array]]
    sensor_errors: dict[str, float]
    segments: tuple[FlownSegment, ...]
    airborne: NDArray[np.bool_]
    failures: tuple[Mapping[str, object], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The truth as JSON values; measurements are left to the recording."""
        return {
            "schema": "truth/1",
            "time_s": self.time_s.tolist(),
            "truth": {name: values.tolist() for name, values in self.truth.items()},
            "command": self.command.tolist(),
            "wind_ned": self.wind_ned.tolist(),
            "gust_body": self.gust_body.tolist(),
            "sensor_errors": self.sensor_errors,
            "segments": [segment.__dict__ for segment in self.segments],
            "airborne": self.airborne.tolist(),
            **({"failures": [dict(one) for one in self.failures]} if self.failures else {}),
        }

    def write_truth(self, path: str | Path) -> None:
        """Write the truth as JSON; SinkError where the disk refuses."""
        try:
            Path(path).write_text(json.dumps(self.to_json(), allow_nan=False) + "\n", encoding="utf-8")
        except OSError as error:
            raise SinkError(f"{path}: cannot write the truth: {error.strerror}") from None

"""The true errors of a simulated flight's signals as they reach the estimator: the sensor's own, and the bench's."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from gcs.flights.signals import load_calibration
from sim_vehicle.vehicle.adc_curves import load_analogue
from sim_vehicle.vehicle.vehicle_file import Vehicle

# Where the signals are in a flight of the demonstration: SI, rad.
RANGES = {"alpha": (-0.02, 0.2), "beta": (-0.1, 0.1), "airspeed": (12.0, 18.0)}


def signal_errors(vehicle: Vehicle, hidden: Mapping[str, float], estimated: Collection[str]) -> dict[str, float]:
    """True scale and bias of every signal after its calibration, by the names of an identification's result.

    hidden: the sensors' own errors as the simulator flew them. estimated: names that were estimated; what they cannot
    absorb of a curve's error is left to the standard errors of the coefficients.
    """
    found = dict(hidden)
    board = load_analogue(vehicle.path)
    for channel in board.channels if board else ():
        source, ends = vehicle.calibration.get(channel.signal), RANGES.get(channel.signal)
        names = [name for name in (f"{channel.signal}_scale", f"{channel.signal}_bias") if name in estimated]
        if source is None or ends is None or not names:
            continue
        true = np.linspace(*ends, 200)
        felt = (1.0 + hidden[f"{channel.signal}_scale"]) * true + hidden[f"{channel.signal}_bias"]
        read, _ = load_calibration(source).apply(channel.volts(felt))
        design = np.column_stack([true if name.endswith("_scale") else np.ones(true.size) for name in names])
        found |= dict(zip(names, np.linalg.lstsq(design, read - true, rcond=None)[0].tolist(), strict=True))
    return found

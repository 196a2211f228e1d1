"""What the data compatibility check leaves open of a motion that is taken from it instead of being simulated.

Where only lateral surfaces moved, airspeed and angle of attack are those of the reconstructed path, and with them the
dynamic pressure: a scale error of the airspeed of 0.3 % moves a control derivative by 0.6 %, twenty times what the
noise of such a flight leaves open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.problem.estimation_problem import Problem
from sysid.signals.record import STATES, Record
from sysid.uncertainty.bench_errors import BenchError

SOURCE = "measured motion"
# Sensor errors that move the longitudinal states. Those of the lateral ones, where these are imposed, act on a
# longitudinal motion by products of small numbers alone.
_MOVING = ("airspeed_scale", "airspeed_bias", "alpha_scale", "alpha_bias", "theta_scale", "theta_bias", "gyro_bias_q")
_U, _W, _Q, _THETA = (STATES.index(name) for name in ("u", "w", "q", "theta"))
_SMALLEST = 1e-9  # of the covariance's largest mode, in units of each error's own standard deviation


def held_errors(compatible: CompatibilityResult, problem: Problem) -> list[BenchError]:
    """Independent parts, of one standard deviation, of what is open of the longitudinal states that `problem` imposes.

    They come from the covariance of the sensor errors that were taken off and are not estimated with the coefficients.
    """
    if problem.motion.longitudinal:
        return []
    known = list(compatible.parameters)
    names = [name for name in _MOVING if name in known and name not in problem.sensors]
    if not names:
        return []
    place = [known.index(name) for name in names]
    covariance = compatible.covariance[np.ix_(place, place)]
    unit = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    sizes, modes = np.linalg.eigh(covariance / np.outer(unit, unit))
    found = []
    for size, mode in zip(sizes, modes.T, strict=True):
        if size > _SMALLEST * sizes[-1]:
            error = dict(zip(names, (unit * mode * np.sqrt(size)).tolist(), strict=True))
            found.append(BenchError(SOURCE, partial(shifted, errors=error)))
    return found


def shifted(record: Record, errors: Mapping[str, float]) -> Record:
    """The record with the longitudinal states that it imposes as they are if these sensor errors are so much larger."""

    def off(name: str, reading: Array) -> Array:
        """What a signal is too high by."""
        return errors.get(f"{name}_scale", 0.0) * reading + errors.get(f"{name}_bias", 0.0)

    held = record.imposed_states.copy()
    u, w = record.imposed_states[:, _U], record.imposed_states[:, _W]
    along = np.hypot(u, w)
    stretched, turned = 1.0 - off("airspeed", along) / along, -off("alpha", np.arctan2(w, u))
    held[:, _U], held[:, _W] = u * stretched - w * turned, w * stretched + u * turned
    held[:, _THETA] -= off("theta", record.imposed_states[:, _THETA])
    held[:, _Q] -= errors.get("gyro_bias_q", 0.0)
    return replace(record, imposed_states=held)

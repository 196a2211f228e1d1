"""A model about steady level flight: the matrices that control.ss, scipy.signal.StateSpace and MATLAB's ss take."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from gcs.exports.exported import Exported, require_new
from gcs.text.files import write_whole
from sim_vehicle.effects import EFFECTS, Remembers, Stage
from sim_vehicle.physics.atmosphere import density
from sysid.identification.linear_model import linearise
from sysid.uncertainty.total import error_parts


def state_space(model: Exported) -> dict[str, Any]:
    """Matrices, names, trim and modes at the vehicle file's airspeed and height. Raises SimVehicleError for no trim."""
    flight, stated = model.vehicle.flight, model.vehicle.environment.air_density
    air = float(density(np.array(flight.altitude))) if stated is None else stated
    linear = linearise(model.vehicle, model.model, flight.airspeed, air, error_parts(model.model))
    modes = [mode.to_json() for mode in linear.modes()]
    for mode in modes:
        # A mode that neither grows nor decays has no time constant.
        if not math.isfinite(mode["time_constant_s"]["value"]):
            mode["time_constant_s"] = None
    return {**linear.system.to_json(), "modes": modes}


def write(model: Exported, path: Path) -> list[str]:
    """Write them as JSON. Returns what the form does not hold, a line each."""
    require_new(path)
    model.require_values()
    found = {"title": model.title, "not_identified": model.model.not_identified(), **state_space(model)}
    write_whole(path, json.dumps(found, indent=1, allow_nan=False) + "\n")
    return [*model.left_out, *(f"{name} is no part of eight states" for name in _not_held(model))]


def _not_held(model: Exported) -> list[str]:
    """Effects between command and surface, and those with memory: deflections act at once in a state space of these."""
    effects = [EFFECTS[one.name] for one in model.model.effects]
    every = [one for one in effects if one.stage not in (Stage.SENSOR, Stage.ENVIRONMENT)]
    return [one.name for one in every if one.stage is Stage.ACTUATOR or one.memory is not Remembers.NONE]

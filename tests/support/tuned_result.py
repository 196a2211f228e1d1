"""A made-up result of gcs identify, of the paper's aircraft, with an autopilot's parameters."""

from __future__ import annotations

import tomllib
from typing import Any

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import VEHICLES

SPEED = 15.0
NOW = {"ARSPD_RATIO": 2.0, "SCALING_SPEED": 15.0, "AHRS_TRIM_Y": 0.01, "RLL_RATE_FF": 0.3, "LIM_ROLL_CD": 4500.0}


def a_result(model: Model, now: dict[str, float] | None = None, **changes: Any) -> dict[str, Any]:
    """As gcs identify writes it, of the paper's aircraft."""
    return {
        "schema": "identification/1", "flights": ["morning"], "model": model.to_json(),
        "state_space": {"airspeed": SPEED, "air_density": SEA_LEVEL_DENSITY},
        "sensor_errors": {},
        "aircraft": {
            "file": {
                key: table
                for key, table in tomllib.loads((VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")).items()
                if key != "calibration"
            },
            "parameters": NOW if now is None else now, "airspeed": "VFR_HUD.airspeed",
        },
        "made": {"settings": {"vehicle": "iitb-mav"}},
        **changes,
    }  # fmt: skip

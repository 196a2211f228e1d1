"""A made-up result of gcs identify, of the paper's aircraft, with an autopilot's parameters."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import Any

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Coefficient, Model, read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES

SPEED = 15.0
NOW = {"ARSPD_RATIO": 2.0, "SCALING_SPEED": 15.0, "AHRS_TRIM_Y": 0.01, "RLL_RATE_FF": 0.3, "LIM_ROLL_CD": 4500.0}

# Gains of ArduPilot's rate loops.
BOARD = {
    "RLL_RATE_P": 0.12, "RLL_RATE_I": 0.15, "RLL_RATE_D": 0.004, "RLL_RATE_FF": 0.18, "RLL2SRV_TCONST": 0.45,
    "PTCH_RATE_P": 0.1, "PTCH_RATE_I": 0.05, "PTCH_RATE_D": 0.006, "PTCH_RATE_FF": 0.1, "PTCH2SRV_TCONST": 0.6,
    "SCHED_LOOP_RATE": 50.0, "INS_GYRO_FILTER": 20.0, "SCALING_SPEED": 17.0, "RLL_RATE_FLTE": 0.0,
}  # fmt: skip


def damped() -> Model:
    """The paper's aircraft with a damping in pitch, which its table lacks."""
    model = read_model("iitb-mav")
    return replace(model, coefficients={**model.coefficients, "Cm_q": Coefficient(-9.0), "CL_q": Coefficient(3.0)})


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

"""How large each effect is flown: the least and the greatest of its usual range for a fixed wing below two metres.

Signs and ranges are those of the catalogue's table for an aircraft of about 1 kg and 1 m of span.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

Value = float | str
_DEG = math.pi / 180.0

# effect -> parameter -> (least, greatest); a text is no number and is the same at every size.
RANGES: dict[str, dict[str, tuple[float, float] | str]] = {
    "pitch_damping": {"Cm_q": (-1.4, -20.0)},
    "downwash_lag": {"Cm_alphadot": (-0.3, -6.0), "CL_alphadot": (0.1, 2.0)},
    "pitch_curvature": {"Cm_alpha2": (-0.3, -2.0)},
    "lift_pitch_rate": {"CL_q": (2.0, 8.0)},
    "polar_offset": {"CD_CL": (0.01, 0.05)},
    "control_drag": {"CD_de2": (0.2, 2.0)},
    "lift_alpha_elevator": {"CL_alpha_de": (0.5, 2.0)},
    "dihedral": {"Cl_beta": (-0.02, -0.12)},
    "weathercock": {"Cn_beta": (0.02, 0.25)},
    "roll_damping": {"Cl_p": (-0.2, -0.6)},
    "yaw_damping": {"Cn_r": (-0.01, -0.35)},
    "cross_roll_yaw": {"Cl_r": (0.03, 0.3), "Cn_p": (-0.01, -0.1)},
    "adverse_yaw": {"Cn_da": (-0.003, -0.03)},
    "rudder_roll": {"Cl_dr": (0.002, 0.02)},
    "asymmetry": {"Cl_0": (0.0005, 0.005), "Cn_0": (-0.0005, -0.005)},
    "side_force": {"CY_beta": (-0.2, -1.0)},
    "sideslip_drag": {"CD_beta2": (0.2, 2.0)},
    "stall": {"alpha_stall": (11.0 * _DEG, 9.0 * _DEG)},
    "propwash_elevator": {"k": (0.1, 1.5)},
    "elastic_tail": {"k": (0.02, 0.2)},
    "reynolds_drag": {"n": (0.2, 0.5)},
    "unsteady_lift": {"tau": (0.02, 0.1)},
    "thrust_line_offset": {"z_T": (0.003, 0.03)},
    "thrust_speed_loss": {"dT_dV": (-0.1, -0.5)},
    "thrust_scale": {"scale": (0.02, 0.1)},
    "motor_lag": {"tau": (0.15, 0.3)},
    "propeller_torque": {"k_Q": (0.005, 0.08)},
    "p_factor": {"k_P": (0.05, 0.3)},
    "propeller_gyroscopic": {"I_P": (2e-5, 2e-4)},
    "propeller_normal_force": {"k": (0.2, 0.9)},
    "actuator_lag": {"tau": (0.02, 0.08)},
    "actuator_rate_limit": {"rate": (4.0, 1.05)},
    "actuator_delay": {"delay": (0.01, 0.06)},
    "actuator_backlash": {"width": (0.2 * _DEG, 1.5 * _DEG)},
    "elevator_gain": {"scale": (0.05, 0.2)},
    "vane_lag": {"tau": (0.01, 0.06)},
    "vane_upwash": {"scale": (0.02, 0.15)},
    "vane_rate_error": {"x": (0.1, 1.0), "y": (0.05, 0.3)},
    "airspeed_error": {"scale": (0.01, 0.08), "bias": (0.2, 1.5)},
    "pitot_lag": {"tau": (0.05, 0.3)},
    "accelerometer_misalignment": {"pitch": (0.5 * _DEG, 3.0 * _DEG), "roll": (0.25 * _DEG, 1.5 * _DEG)},
    "accelerometer_offset": {"x": (0.01, 0.1), "y": (0.003, 0.03), "z": (-0.005, -0.05)},
    "imu_scale": {"scale": (0.002, 0.01)},
    "attitude_lag": {"tau": (0.02, 0.2)},
    "steady_wind": {"north": (1.0, 6.0), "east": (-0.5, -4.0)},
    "turbulence": {"sigma": (0.2, 1.0)},
    "wind_shear": {"gradient": (0.01, 0.1)},
    "mass_error": {"scale": (0.01, 0.05)},
    "density_error": {"scale": (0.02, 0.1)},
    "inertia_error": {"scale": (0.05, 0.2)},
    "sensor_time_skew": {"delay": (0.005, 0.05), "group": "imu"},
    "servo_deadband": {"width": (0.1 * _DEG, 0.5 * _DEG)},
    "linkage_nonlinearity": {"cubic": (1.0, 8.0)},
    "ground_effect": {"lift_gain": (0.05, 0.2), "drag_reduction": (0.1, 0.4)},
    "configuration_step": {"dCL": (0.01, 0.1), "dCD": (0.005, 0.05), "dCm": (-0.001, -0.01)},
    "mass_drop": {"fraction": (0.05, 0.3)},
    "battery_sag": {"rate": (0.002, 0.008)},
    "cg_shift": {"x": (0.002, 0.01)},
    "thrust_sensor_hysteresis": {"width": (0.05, 0.3)},
}
# Share of the way from the least to the greatest, geometrically, by the number of sizes that are flown.
SHARES: dict[int, tuple[float, ...]] = {1: (1.0,), 2: (1.0, 0.0), 3: (1.0, 0.5, 0.0)}
# When an effect that comes at a moment comes, s after the first stamp.
MOMENT_S = 11.0


def values_at(effect: str, share: float) -> dict[str, Value]:
    """The effect's parameters, `share` of the way from least (0) to greatest (1)."""
    found: dict[str, Value] = {}
    for name, ends in RANGES[effect].items():
        if isinstance(ends, str):
            found[name] = ends
        else:
            low, high = ends
            found[name] = math.copysign(abs(low) ** (1.0 - share) * abs(high) ** share, high)
    if effect in ("configuration_step", "mass_drop"):
        found["time"] = MOMENT_S
    return found


def effect_text(effect: str, values: Mapping[str, Value]) -> str:
    """As the simulator's option takes it."""
    pairs = (f"{name}={value!r}" if isinstance(value, float) else f"{name}={value}" for name, value in values.items())
    return ":".join((effect, *pairs))

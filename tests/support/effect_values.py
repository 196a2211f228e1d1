"""For every effect of the catalogue: values that show it, and values at which it is not there."""

from __future__ import annotations

# Usual sizes of the effects for a fixed wing below two metres.
VALUES: dict[str, dict[str, float]] = {
    "pitch_damping": {"Cm_q": -5.0},
    "downwash_lag": {"Cm_alphadot": -2.0, "CL_alphadot": 1.5},
    "pitch_curvature": {"Cm_alpha2": -0.5, "Cm_alpha3": 2.0},
    "lift_pitch_rate": {"CL_q": 4.0},
    "polar_offset": {"CD_CL": 0.03},
    "control_drag": {"CD_de2": 1.0},
    "lift_alpha_elevator": {"CL_alpha_de": 1.0},
    "dihedral": {"Cl_beta": -0.11},
    "weathercock": {"Cn_beta": 0.2},
    "roll_damping": {"Cl_p": -0.3},
    "yaw_damping": {"Cn_r": -0.3},
    "cross_roll_yaw": {"Cl_r": 0.3, "Cn_p": -0.1},
    "adverse_yaw": {"Cn_da": 0.05},
    "rudder_roll": {"Cl_dr": 0.02},
    "asymmetry": {"Cl_0": 0.004, "Cn_0": -0.003},
    "side_force": {"CY_beta": -0.9},
    "sideslip_drag": {"CD_beta2": 1.5},
    "stall": {"alpha_stall": 0.15, "sharpness": 50.0},
    "propwash_elevator": {"k": 0.3},
    "elastic_tail": {"k": 0.15},
    "reynolds_drag": {"n": 0.3},
    "unsteady_lift": {"tau": 0.05},
    "thrust_line_offset": {"z_T": 0.01},
    "thrust_speed_loss": {"dT_dV": -0.3},
    "thrust_scale": {"scale": 0.05},
    "motor_lag": {"tau": 0.2},
    "propeller_torque": {"k_Q": 0.02},
    "p_factor": {"k_P": 0.2},
    "propeller_gyroscopic": {"I_P": 1e-4},
    "propeller_normal_force": {"k": 0.5},
    "actuator_lag": {"tau": 0.04},
    "actuator_rate_limit": {"rate": 1.0},
    "actuator_delay": {"delay": 0.03},
    "actuator_backlash": {"width": 0.01},
    "elevator_gain": {"scale": 0.1},
    "vane_lag": {"tau": 0.04},
    "vane_upwash": {"scale": 0.08, "bias": 0.01},
    "vane_rate_error": {"x": 0.3, "y": 0.4},
    "airspeed_error": {"scale": 0.03, "bias": 0.5},
    "pitot_lag": {"tau": 0.15},
    "accelerometer_misalignment": {"pitch": 0.02, "roll": 0.01},
    "accelerometer_offset": {"x": 0.05, "y": 0.02, "z": -0.03},
    "imu_scale": {"scale": 0.01, "bias": 0.003},
    "attitude_lag": {"tau": 0.05},
    "steady_wind": {"north": 3.0, "east": -2.0, "down": 0.5},
    "turbulence": {"sigma": 0.5, "length": 20.0},
    "wind_shear": {"gradient": 0.05},
    "density_error": {"scale": 0.08},
    "mass_error": {"scale": 0.05},
    "inertia_error": {"scale": 0.1},
    "configuration_step": {"dCL": 0.2, "dCD": 0.02, "dCm": -0.03, "time": 0.513, "duration": 0.1},
    "ground_effect": {"lift_gain": 0.15, "drag_reduction": 0.3},
    "battery_sag": {"rate": 0.02},
    "linkage_nonlinearity": {"cubic": 2.0},
    "servo_deadband": {"width": 0.01},
    # Of the inertial unit, by the place of its name among the groups.
    "sensor_time_skew": {"delay": 0.033, "group": 2.0},
    "thrust_sensor_hysteresis": {"width": 0.1},
    "mass_drop": {"fraction": 0.1, "time": 0.507, "duration": 0.1},
    "cg_shift": {"x": 0.005},
}
# Height above the ground at which an effect shows, m.
HEIGHTS = {"ground_effect": 0.1}

# Values at which a term is what the packaged aircraft has already, or the effect is nothing.
NEUTRAL: dict[str, dict[str, float]] = {
    **{
        name: dict.fromkeys(VALUES[name], 0.0)
        for name in VALUES
        if name
        not in (
            "dihedral", "weathercock", "roll_damping", "yaw_damping", "cross_roll_yaw", "adverse_yaw", "side_force",
            "stall", "unsteady_lift", "motor_lag", "actuator_lag", "actuator_rate_limit", "vane_lag", "pitot_lag",
            "attitude_lag",
        )
    },
    "dihedral": {"Cl_beta": -0.08},
    "weathercock": {"Cn_beta": 0.08},
    "roll_damping": {"Cl_p": -0.45},
    "yaw_damping": {"Cn_r": -0.12},
    "cross_roll_yaw": {"Cl_r": 0.1, "Cn_p": -0.03},
    "adverse_yaw": {"Cn_da": -0.01},
    "side_force": {"CY_beta": -0.4},
    "stall": {"alpha_stall": 3.0, "sharpness": 100.0},
    "motor_lag": {"tau": 0.1},
    "actuator_rate_limit": {"rate": 1e9},
    "turbulence": {"sigma": 0.0, "length": 20.0},
    "configuration_step": {"dCL": 0.0, "dCD": 0.0, "dCm": 0.0, "time": 0.5, "duration": 0.1},
    "mass_drop": {"fraction": 0.0, "time": 0.5, "duration": 0.1},
}  # fmt: skip
# A lag of no time at all is not written down; it is left out.
WITHOUT_NEUTRAL = {"unsteady_lift", "actuator_lag", "vane_lag", "pitot_lag", "attitude_lag"}

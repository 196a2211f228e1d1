"""Which effects are easily mistaken for one another, and the manoeuvre that distinguishes such a pair.

An empty manoeuvre is the effect's general one (`Effect.separated_by`).
"""

_SPEEDS = "the same manoeuvre at two speeds"
_Q_ALONE = "pull-ups, turns and loaded rolls, in which the pitch rate stays while the angle of attack does not change"
_POWER = "elevator multisine at idle and at full power, and at two speeds with the same throttle"
_TWO_AMPLITUDES = "the same multisine at two amplitudes, with content from 3 to 6 Hz"
_THROTTLE = "throttle steps or a throttle multisine at fixed elevator"
_WEIGH = "weigh the aircraft; throttle steps and a power-off glide"
_ORBIT = "an orbit or triangle with GPS in steady wind"
_ORTHOGONAL = "orthogonal rudder and aileron multisines"
_GLIDE = "a power-off glide against power-on flight"
_REVERSED = "the same run with reversed heading"
_BENCH = "a bench protractor"
_CUBE = "a bench cube for the accelerometers; rolls"

CONFUSIONS: dict[str, dict[str, str]] = {
    "pitch_damping": {
        "downwash_lag": _Q_ALONE,
        "lift_pitch_rate": _Q_ALONE,
        "unsteady_lift": "elevator sweep from 2 to 6 Hz",
        "actuator_lag": _TWO_AMPLITUDES,
        "actuator_rate_limit": _TWO_AMPLITUDES,
        "actuator_delay": _TWO_AMPLITUDES,
    },
    "downwash_lag": {"pitch_damping": _Q_ALONE, "unsteady_lift": "elevator sweep from 2 to 6 Hz"},
    "pitch_curvature": {"stall": "", "thrust_line_offset": ""},
    "lift_pitch_rate": {
        "unsteady_lift": "elevator sweep from 2 to 6 Hz",
        "pitch_damping": _Q_ALONE,
        "downwash_lag": _Q_ALONE,
    },
    "polar_offset": {"accelerometer_misalignment": "", "vane_upwash": ""},
    "control_drag": {"linkage_nonlinearity": _BENCH},
    "lift_alpha_elevator": {"mass_error": ""},
    "dihedral": {"vane_upwash": "", "yaw_damping": _ORTHOGONAL},
    "weathercock": {"inertia_error": "a bench swing test"},
    "roll_damping": {"actuator_lag": "bank-to-bank rolls at two amplitudes"},
    "yaw_damping": {"cross_roll_yaw": _ORTHOGONAL},
    "cross_roll_yaw": {"yaw_damping": _ORTHOGONAL},
    "adverse_yaw": {
        "yaw_damping": "aileron steps alone, judged within 0.2 s",
        "cross_roll_yaw": "aileron steps alone, judged within 0.2 s",
        "propeller_torque": "",
    },
    "rudder_roll": {"cross_roll_yaw": "rudder steps alone, judged within 0.2 s", "dihedral": ""},
    "asymmetry": {"propeller_torque": _GLIDE, "p_factor": _GLIDE},
    "side_force": {"accelerometer_misalignment": _CUBE, "accelerometer_offset": ""},
    "sideslip_drag": {"polar_offset": "", "yaw_damping": ""},
    "stall": {"pitch_curvature": ""},
    "propwash_elevator": {"elastic_tail": _POWER},
    "elastic_tail": {"propwash_elevator": _POWER},
    "reynolds_drag": {
        "thrust_scale": "level flight over the whole range of speed; a power-off glide",
        "mass_error": "",
    },
    "unsteady_lift": {
        "pitch_damping": "",
        "downwash_lag": "",
        "actuator_lag": _TWO_AMPLITUDES,
        "actuator_delay": _TWO_AMPLITUDES,
    },
    "configuration_step": {"turbulence": "", "mass_error": "", "mass_drop": ""},
    "ground_effect": {"wind_shear": ""},
    "thrust_line_offset": {
        "airspeed_error": _THROTTLE,
        "imu_scale": _THROTTLE,
        "lift_pitch_rate": _THROTTLE,
    },
    "thrust_speed_loss": {
        "pitot_lag": "a fast zoom",
        "thrust_scale": "",
        "polar_offset": "",
        "reynolds_drag": "",
    },
    "thrust_scale": {"mass_error": _WEIGH, "reynolds_drag": "a power-off glide and throttle steps"},
    "motor_lag": {"thrust_scale": ""},
    "battery_sag": {"thrust_scale": "", "mass_drop": _WEIGH},
    "propeller_torque": {"asymmetry": _GLIDE, "p_factor": "throttle steps at two angles of attack"},
    "p_factor": {"asymmetry": _GLIDE, "propeller_torque": ""},
    "propeller_gyroscopic": {"cross_roll_yaw": "fast pitch multisine at two propeller speeds, and in a glide"},
    "propeller_normal_force": {"propwash_elevator": ""},
    "actuator_lag": {
        "actuator_delay": _TWO_AMPLITUDES,
        "actuator_rate_limit": _TWO_AMPLITUDES,
        "sensor_time_skew": "hardware that stamps servos and sensors on one clock; a tap on the airframe",
    },
    "actuator_rate_limit": {"actuator_lag": "", "actuator_delay": ""},
    "actuator_delay": {
        "actuator_lag": _TWO_AMPLITUDES,
        "sensor_time_skew": "hardware that stamps servos and sensors on one clock; a tap on the airframe",
    },
    "actuator_backlash": {"servo_deadband": "", "linkage_nonlinearity": _BENCH},
    "elevator_gain": {},
    "linkage_nonlinearity": {"control_drag": _BENCH, "actuator_backlash": _BENCH},
    "servo_deadband": {"actuator_backlash": "", "linkage_nonlinearity": _BENCH},
    "vane_lag": {"vane_rate_error": _SPEEDS, "sensor_time_skew": "vane steps on the bench"},
    "vane_upwash": {"accelerometer_misalignment": _CUBE},
    "vane_rate_error": {"vane_lag": ""},
    "airspeed_error": {"wind_shear": _ORBIT, "thrust_line_offset": _THROTTLE},
    "pitot_lag": {"thrust_speed_loss": ""},
    "accelerometer_misalignment": {
        "vane_upwash": _CUBE,
        "polar_offset": _CUBE,
        "thrust_speed_loss": _THROTTLE,
    },
    "accelerometer_offset": {"control_drag": "", "lift_pitch_rate": ""},
    "sensor_time_skew": {"actuator_delay": "", "attitude_lag": ""},
    "imu_scale": {"airspeed_error": "", "attitude_lag": ""},
    "attitude_lag": {"sensor_time_skew": ""},
    "thrust_sensor_hysteresis": {"thrust_scale": ""},
    "steady_wind": {"airspeed_error": ""},
    "turbulence": {"airspeed_error": _REVERSED, "reynolds_drag": _REVERSED},
    "wind_shear": {"airspeed_error": _REVERSED, "reynolds_drag": _REVERSED},
    "density_error": {},
    "mass_error": {"thrust_scale": _WEIGH},
    "mass_drop": {"thrust_scale": _WEIGH, "configuration_step": ""},
    "inertia_error": {},
    "cg_shift": {"accelerometer_offset": ""},
}

"""What columns of flight data are usually called, and what they are then: the dictionary that headers are matched with.

Names are in the form that `plain` gives them: lower case, words joined by "_". Of several columns of one signal the one
that stands first here counts.
"""

from __future__ import annotations

import re

from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS

# Signal -> SI unit. `true_airspeed` is the air's velocity itself, `airspeed` what a pitot tube makes of its pressure.
SIGNAL_UNITS: dict[str, str] = {
    **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s^2"),
    **dict.fromkeys(("phi", "theta", "psi", "alpha", "beta"), "rad"),
    **{name: one.unit for name, one in SECOND_SENSORS.items()},
    **dict.fromkeys(("airspeed", "true_airspeed", "vn", "ve", "vd"), "m/s"),
    **dict.fromkeys(("differential_pressure", "static_pressure"), "Pa"),
    **{"temperature": "K", "air_density": "kg/m^3", "altitude": "m", "height": "m", "thrust": "N", "rpm": "1/min"},
    **{"battery_voltage": "V", "battery_current": "A"},
    **dict.fromkeys(("de", "da", "dr"), "rad"),
    "throttle": "1",
    **{f"servo{number}": "us" for number in range(1, 17)},
}
TIME = "time"
# What moves the aircraft: a value that repeats is held, not read again.
INPUTS = ("de", "da", "dr", "throttle", *(f"servo{number}" for number in range(1, 17)))

USUAL_NAMES: dict[str, tuple[str, ...]] = {
    TIME: (
        *("time", "t", "time_s", "timestamp", "sim_time", "simulation_time", "elapsed_time", "flight_time", "timeus"),
        *("time_usec", "time_boot", "totl_time", "missn_time", "real_time", "sim_time_sec", "seconds"),
    ),
    "ax": ("ax", "acc_x", "accel_x", "accelerometer_x", "x_acc", "xacc", "accx", "imu_accx", "bodyaccel_x", "fx_m"),
    "ay": ("ay", "acc_y", "accel_y", "accelerometer_y", "y_acc", "yacc", "accy", "imu_accy", "bodyaccel_y"),
    "az": ("az", "acc_z", "accel_z", "accelerometer_z", "z_acc", "zacc", "accz", "imu_accz", "bodyaccel_z"),
    "p": ("p", "roll_rate", "rollrate", "rollspeed", "gyro_x", "gyr_x", "gx", "xgyro", "gyrx", "imu_gyrx", "omega_x"),
    "q": (
        "q",
        "pitch_rate",
        "pitchrate",
        "pitchspeed",
        "gyro_y",
        "gyr_y",
        "gy",
        "ygyro",
        "gyry",
        "imu_gyry",
        "omega_y",
    ),
    "r": ("r", "yaw_rate", "yawrate", "yawspeed", "gyro_z", "gyr_z", "gz", "zgyro", "gyrz", "imu_gyrz", "omega_z"),
    "pdot": ("pdot", "p_dot", "roll_acceleration"),
    "qdot": ("qdot", "q_dot", "pitch_acceleration"),
    "rdot": ("rdot", "r_dot", "yaw_acceleration"),
    "phi": ("phi", "roll", "roll_angle", "bank", "bank_angle", "att_roll"),
    "theta": ("theta", "pitch", "pitch_angle", "att_pitch", "the"),
    "psi": ("psi", "yaw", "heading", "yaw_angle", "true_heading", "heading_true", "hding_true", "att_yaw", "hdg"),
    "alpha": ("alpha", "alfa", "aoa", "angle_of_attack", "angleofattack", "alpha_vane", "aoa_aoa"),
    "beta": ("beta", "aos", "ssa", "sideslip", "angle_of_sideslip", "sideslip_angle", "beta_vane", "aoa_ssa"),
    **{name: (name,) for name in SECOND_SENSORS},
    "true_airspeed": ("tas", "true_airspeed", "vtas", "vt", "vtrue", "v_total", "v_true", "v_tas", "v"),
    "airspeed": (
        *("cas", "ias", "airspeed", "calibrated_airspeed", "indicated_airspeed", "vcas", "vias", "vc", "vind"),
        *("arsp_airspeed", "vfr_hud_airspeed"),
    ),
    "differential_pressure": (
        "differential_pressure",
        "diff_pressure",
        "diff_press",
        "qbar",
        "q_bar",
        "dynamic_pressure",
    ),
    "static_pressure": ("static_pressure", "abs_pressure", "baro_pressure", "pressure", "press", "ps", "p_ambient"),
    "temperature": ("temperature", "temp", "oat", "air_temperature", "outside_air_temperature"),
    "air_density": ("rho", "air_density", "density"),
    "altitude": ("altitude", "alt", "h", "altitude_asl", "pressure_altitude", "baro_alt", "h_sl", "p_alt", "hbaro"),
    "height": ("height", "agl", "altitude_agl", "height_agl", "h_agl", "distance_agl", "rangefinder"),
    "vn": ("vn", "v_north", "vel_n", "vel_north", "velocity_north", "north_velocity", "gps_vn"),
    "ve": ("ve", "v_east", "vel_e", "vel_east", "velocity_east", "east_velocity", "gps_ve"),
    "vd": ("vd", "v_down", "vel_d", "vel_down", "velocity_down", "down_velocity", "gps_vd"),
    "thrust": ("thrust", "engine_thrust", "propeller_thrust"),
    "rpm": ("rpm", "motor_rpm", "engine_rpm", "propeller_rpm", "engn1"),
    "battery_voltage": ("battery_voltage", "voltage", "vbat", "battery_v", "bat_volt", "voltage_v", "vbatlatest"),
    "battery_current": ("battery_current", "current", "battery_a", "bat_curr", "current_a", "amperagelatest"),
    "de": (
        "de",
        "elevator",
        "elev",
        "delta_e",
        "elevator_deflection",
        "elevator_position",
        "elevator_pos",
        "elev1",
        "elevator_cmd",
    ),
    "da": ("da", "aileron", "ail", "delta_a", "aileron_deflection", "aileron_position", "aileron_pos", "aileron_cmd"),
    "dr": (
        "dr",
        "rudder",
        "rud",
        "delta_r",
        "rudder_deflection",
        "rudder_position",
        "rudder_pos",
        "rudd1",
        "rudder_cmd",
    ),
    "throttle": ("throttle", "thr", "dthr", "delta_t", "throttle_position", "throttle_pos", "throttle_cmd"),
    **{
        f"servo{n}": (f"servo{n}", f"servo{n}_raw", f"servo_output_{n}", f"rcou_c{n}", f"pwm{n}", f"servo_{n}")
        for n in range(1, 17)
    },
}
# Two columns that together are one signal: half of the first less half of the second.
USUAL_PAIRS: dict[str, tuple[tuple[str, str], ...]] = {
    "da": (
        *(("left_aileron_position", "right_aileron_position"), ("left_aileron_pos", "right_aileron_pos")),
        *(("left_aileron", "right_aileron"), ("aileron_left", "aileron_right"), ("da_l", "da_r")),
    ),
}
# Names that one program alone uses, and the unit that it always means by them: ArduPilot's, MAVLink's and JSBSim's.
UNIT_OF_NAME: dict[str, str] = {
    **{"timeus": "us", "time_usec": "us"},
    **{f"{of}rpm": "rpm" for of in ("", "motor_", "engine_", "propeller_")},
    **dict.fromkeys(("att_roll", "att_pitch", "att_yaw", "aoa_aoa", "aoa_ssa"), "deg"),
    **dict.fromkeys(("imu_gyrx", "imu_gyry", "imu_gyrz", "rollspeed", "pitchspeed", "yawspeed"), "rad/s"),
    **dict.fromkeys(("imu_accx", "imu_accy", "imu_accz"), "m/s^2"),
    **dict.fromkeys(("arsp_airspeed", "vfr_hud_airspeed"), "m/s"),
    **dict.fromkeys(("bodyaccel_x", "bodyaccel_y", "bodyaccel_z"), "ft/s^2"),
    **{name: "us" for n in range(1, 17) for name in (f"servo{n}", f"servo{n}_raw", f"rcou_c{n}", f"servo_output_{n}")},
}


def plain(text: str) -> str:
    """A header as the dictionary spells it: lower case, words joined by "_"."""
    text = text.strip().lower().replace("{", "").replace("}", "").replace("δ", "delta_").replace("α", "alpha")
    text = text.replace("β", "beta").replace("φ", "phi").replace("θ", "theta").replace("ψ", "psi").replace("ρ", "rho")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")

"""The errors of sensors that a flight may be asked for."""

from __future__ import annotations

# Sensor errors, and the wind that velocity over ground holds: name -> (output it acts on, "bias" or "scale", unit, size
# a cheap sensor or a day fit to fly may plausibly have).
SENSOR_ERRORS: dict[str, tuple[str, str, str, float]] = {
    "accel_bias_x": ("ax", "bias", "m/s^2", 0.5),
    "accel_bias_y": ("ay", "bias", "m/s^2", 0.5),
    "accel_bias_z": ("az", "bias", "m/s^2", 0.5),
    "gyro_bias_p": ("p", "bias", "rad/s", 0.02),
    "gyro_bias_q": ("q", "bias", "rad/s", 0.02),
    "gyro_bias_r": ("r", "bias", "rad/s", 0.02),
    "alpha_scale": ("alpha", "scale", "1", 0.1),
    "alpha_bias": ("alpha", "bias", "rad", 0.02),
    "beta_scale": ("beta", "scale", "1", 0.1),
    "beta_bias": ("beta", "bias", "rad", 0.02),
    "airspeed_scale": ("airspeed", "scale", "1", 0.05),
    "airspeed_bias": ("airspeed", "bias", "m/s", 0.5),
    "phi_bias": ("phi", "bias", "rad", 0.02),
    "theta_scale": ("theta", "scale", "1", 0.05),
    "theta_bias": ("theta", "bias", "rad", 0.02),
    "wind_north": ("vn", "bias", "m/s", 3.0),
    "wind_east": ("ve", "bias", "m/s", 3.0),
    "wind_down": ("vd", "bias", "m/s", 0.5),
}

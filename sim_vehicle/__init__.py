"""The vehicle: equations of motion, aerodynamics and effects, sensors, manoeuvres, MAVLink telemetry."""

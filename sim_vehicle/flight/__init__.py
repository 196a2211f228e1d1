"""A vehicle in flight: plant, trim, wind, sensors, autopilot, arming."""

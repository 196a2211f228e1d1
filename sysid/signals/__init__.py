"""From recorded signals to prepared stretches of flight: calibration, time base, segments, thrust, delays."""

"""Filter error: maximum likelihood of a Kalman filter's innovations, for flights in turbulence."""

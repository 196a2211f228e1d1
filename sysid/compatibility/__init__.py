"""Data compatibility: one motion from IMU, air data, attitude and GPS, and the sensors' errors."""

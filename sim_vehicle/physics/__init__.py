"""Equations of motion, propeller, actuators and ideal sensors, compiled."""

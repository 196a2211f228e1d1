"""Samples as they come: one time base, sensors' noise and errors, the motion through the air."""

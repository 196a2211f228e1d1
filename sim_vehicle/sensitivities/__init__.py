"""Derivatives of the simulation by states and parameters, compiled."""

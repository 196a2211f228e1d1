"""Equation error: regression in the time and the frequency domain, and the choice of structure."""

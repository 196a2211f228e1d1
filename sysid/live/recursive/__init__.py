"""Recursive regressions in the time and the frequency domain, and changes of the aircraft."""

"""Identification while the aircraft flies: samples in, coefficients with error bars out."""

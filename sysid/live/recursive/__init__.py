"""Recursive regression: what watches for changes, and reports coefficients where there is no window."""

"""Discrepancy on flights of the textbooks: candidates compared by filter error."""

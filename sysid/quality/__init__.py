"""Whether a flight is good for identification, and what it told: one verdict with its reasons."""

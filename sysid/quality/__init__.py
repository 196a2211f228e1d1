"""Whether a flight is good for identification, and what it determined: one verdict with its reasons."""

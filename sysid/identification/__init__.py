"""Identification of one or more flights, from signals to the result file."""

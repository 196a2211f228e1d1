"""Manoeuvres: shapes, multisines, plans of a flight."""

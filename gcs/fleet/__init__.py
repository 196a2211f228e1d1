"""Hundreds of flights: the same job for each, here or on other machines, their table, and what they say together."""

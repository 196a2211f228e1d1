"""Flights from tables: columns of numbers, whatever they are called and measured in, become signals in SI units."""

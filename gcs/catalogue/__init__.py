"""Flights, jobs, results and models: their catalogue, and reading, taking in and deleting what it names."""

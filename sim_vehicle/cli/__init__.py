"""The command sim-vehicle."""

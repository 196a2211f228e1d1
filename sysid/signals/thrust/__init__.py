"""Thrust: where it comes from, without its noise, and by what the battery gives."""

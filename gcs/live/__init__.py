"""Signals and estimates while an aircraft flies."""

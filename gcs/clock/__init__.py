"""The vehicles' clocks against the station's: round trips, fits, and one clock for a flight."""

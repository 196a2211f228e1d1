"""The simulator as the physics of an autopilot's own simulation: ArduPilot's JSON interface."""

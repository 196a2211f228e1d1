"""What an identified model says of an autopilot's parameters."""

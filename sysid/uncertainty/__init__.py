"""What the statistical standard error leaves out: bench, inputs, reconstruction, vehicle file."""

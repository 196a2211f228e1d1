"""What is worked out from recordings: estimations as jobs run them, noise at rest, and results as text."""

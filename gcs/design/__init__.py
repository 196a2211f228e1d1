"""Flight tests: what a planned one can identify, and the plan in forms that a board can fly."""

"""Flight tests: what a planned one will tell, and the plan in forms that a board can fly."""

"""Physical constants, each defined once. What a vehicle file says of its place (gravity, density) goes before them."""

STANDARD_GRAVITY = 9.80665  # m/s^2, ISO 80000-3
SEA_LEVEL_DENSITY = 1.225  # kg/m^3, ICAO standard atmosphere
GAS_CONSTANT = 287.05287  # J/(kg K), dry air, ICAO standard atmosphere

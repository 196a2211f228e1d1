"""Figures of a performance sheet in words."""

from __future__ import annotations

WORDS = {
    "best_glide_ratio": "best glide ratio", "best_glide_speed": "speed for best glide", "min_sink": "least sink",
    "min_sink_speed": "speed for least sink", "max_climb": "best climb", "max_climb_speed": "speed for best climb",
    "max_speed": "largest speed in level flight", "ceiling": "ceiling (climb of 0.5 m/s)",
    "min_turn_radius": "tightest level turn, radius", "stall_speed": "stall speed, level",
    "drive_efficiency": "of the battery's power at the shaft", "min_battery_power": "least power of the battery",
    "min_battery_power_speed": "speed for the longest flight", "min_energy_per_km": "least energy, still air",
    "min_energy_speed": "speed for the farthest flight", "endurance": "longest flight", "range": "farthest, still air",
}  # fmt: skip

"""What to do when the job names what would separate effects: its words as a plan of the simulator, or a test on the
ground.
"""

from __future__ import annotations

from dataclasses import replace

from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.manoeuvres.shapes import manoeuvre

_FAST_SWEEP = replace(manoeuvre("elevator-sweep"), low=2.0, high=6.0)
_TWO_SPEEDS = Plan((manoeuvre("elevator-multisine"), manoeuvre("deceleration"), manoeuvre("elevator-multisine")))
_LARGE = replace(manoeuvre("elevator-doublet"), amplitude=0.06)
# Tests on the ground, and the effect that each would measure.
BENCHES = {
    "weigh": "mass_error",
    "balance jig": "cg_shift",
    "swing test": "inertia_error",
    "barometer": "density_error",
    "vane steps on the bench": "vane_lag",
    "protractor": "linkage_nonlinearity",
    "bench cube": "accelerometer_misalignment",
}
# The first words that are found in what the job says decide.
PLANS: dict[str, Plan] = {
    "throttle step": plan_of(["throttle-step", "throttle-multisine"]),
    "whole throttle": plan_of(["throttle-step", "throttle-multisine"]),
    "power-off glide": plan_of(["throttle-step", "throttle-multisine"]),
    "level acceleration": plan_of(["throttle-step", "throttle-step"]),
    "idle and at full power": plan_of(["throttle-step", "elevator-multisine"]),
    "two propeller speeds": plan_of(["throttle-step", "elevator-multisine"]),
    "2 to 6 Hz": Plan((_FAST_SWEEP,)),
    "3 to 6 Hz": Plan((_FAST_SWEEP,)),
    "two speeds": _TWO_SPEEDS,
    "range of speed": _TWO_SPEEDS,
    "two angles of attack": _TWO_SPEEDS,
    "low and high lift": _TWO_SPEEDS,
    "deceleration": _TWO_SPEEDS,
    "pull-up": plan_of(["roller-coaster", "elevator-pulse"]),
    "zoom": plan_of(["roller-coaster", "elevator-pulse"]),
    "dive and climb": plan_of(["roller-coaster", "elevator-pulse"]),
    "amplitude": Plan((_LARGE, manoeuvre("elevator-3211"))),
    "large steps": Plan((_LARGE, manoeuvre("elevator-3211"))),
    "roll": plan_of(["aileron-doublet", "aileron-3211"]),
    "aileron": plan_of(["aileron-doublet", "aileron-3211"]),
    "sideslip": plan_of(["rudder-doublet", "rudder-pulse"]),
    "rudder": plan_of(["rudder-doublet", "rudder-3211"]),
    "elevator multisine": plan_of(["elevator-multisine"]),
}


def plan_named(words: str) -> str:
    """Key of the plan that the job's words ask for, "" where nothing can be flown."""
    return next((key for key in PLANS if key in words), "")


def bench_named(words: str) -> str:
    """The effect that a test on the ground among the job's words would measure, "" where there is none."""
    return next((effect for key, effect in BENCHES.items() if key in words), "")

"""Aircraft with more controls than four, flown by JSBSim: a flap, a spoiler on one wing, and a difference of thrust."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jsbsim_flight import Aircraft, drawn_aircraft, multisine
from jsbsim_twin import Array, linear_coefficients

from sim_vehicle.model.model_file import Coefficient
from sim_vehicle.vehicle.controls import Control

# What each does, by the aircraft of `named_aircraft`: other controls leave those terms at 0.
EFFECTS: Mapping[str, Mapping[str, float]] = {
    "flap": {"CL_flap": 0.75, "CD_flap": 0.055, "Cm_flap": -0.09},
    "left_spoiler": {"CL_left_spoiler": -0.16, "CD_left_spoiler": 0.05, "Cl_left_spoiler": -0.03,
                     "Cn_left_spoiler": -0.012},
    "thrust_difference": {"Cn_thrust_difference": 0.011, "Cl_thrust_difference": 0.0015},
}  # fmt: skip
_STEP_S, _FIRST_S = 5.0, 3.0


def named_aircraft(number: int) -> Aircraft:
    """A drawn aircraft with three controls of their own names, whose deflections the log holds."""
    base = drawn_aircraft(number)
    draw = np.random.default_rng([number, 23]).uniform
    own = {name: value * draw(0.7, 1.3) for terms in EFFECTS.values() for name, value in terms.items()}
    controls = {name: Control(name, "command", (), (), (), ()) for name in EFFECTS}
    vehicle = replace(base.vehicle, controls={**base.vehicle.controls, **controls})
    model = replace(base.model, coefficients={**base.model.coefficients, **{k: Coefficient(v) for k, v in own.items()}})
    return Aircraft(f"named-{number}", vehicle, model, linear_coefficients(vehicle, model))


def moves(times: Array, generator: np.random.Generator) -> dict[str, Array]:
    """A flap set twice, a spoiler put out now and then, and a difference of thrust that goes to and fro."""
    flap, spoiler = np.zeros(times.size), np.zeros(times.size)
    for begin in np.arange(_FIRST_S, float(times[-1]), _STEP_S):
        flap[times >= begin] = generator.uniform(0.0, 0.35)
        out = begin + generator.uniform(0.5, 3.0)
        spoiler[(times >= out) & (times < out + generator.uniform(0.4, 1.2))] = generator.uniform(0.3, 0.9)
    return {
        "flap": flap,
        "left_spoiler": spoiler,
        "thrust_difference": multisine(times, 0.35 * generator.uniform(0.8, 1.2), 1, generator),
    }

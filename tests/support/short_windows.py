"""Short flights of aircraft that the default structure only nearly is: windows out of JSBSim's, and their truth.

What the aircraft have beside it: "drag" by the squares of sideslip and aileron; "slipstream" over elevator and rudder,
which then work the better the more the propeller pulls, drag as above; "stall", a smooth one, drag as above; "linear"
has nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jsbsim_effects import hidden, with_terms
from jsbsim_flight import Aircraft, Flown, drawn_aircraft, slopes
from jsbsim_twin import product, regressor, value_of

from sysid.signals.flight import FlightSignals

MODES = ("linear", "drag", "slipstream", "stall")
BEGINS_S = 2.5
# Length and begin of each window, s.
WINDOWS = ((4.0, BEGINS_S), (6.0, 6.5), (8.0, 12.5), (9.0, 20.9))
_DRAG = {"beta": 1.0, "da": 0.5}
_WASH = 3.0  # of thrust over dynamic pressure and wing area
_BLOWN = {"CL_de": "de", "Cm_de": "de", "CY_dr": "dr", "Cn_dr": "dr"}
_RATIO = "<quotient><property>forces/fbx-external-lbs</property><property>aero/qbar-area</property></quotient>"
_STALL_SIZE = 0.5


def aircraft_of(mode: str, number: int) -> Aircraft:
    """A drawn aircraft with what its mode adds; its vehicle file and its own coefficients are those without."""
    base = drawn_aircraft(number)
    if mode == "linear":
        return base
    functions = hidden("stall", _STALL_SIZE, base).flown.functions if mode == "stall" else base.functions
    squares = "".join(
        product(value_of(size), regressor(name, base.vehicle), regressor(name, base.vehicle))
        for name, size in _DRAG.items()
    )
    functions = with_terms(functions, {"CD": squares})
    if mode == "slipstream":
        own = base.model.values()
        for name, surface in _BLOWN.items():
            term = product(value_of(_WASH * own[name]), _RATIO, regressor(surface, base.vehicle))
            functions = with_terms(functions, {name.partition("_")[0]: term})
    return replace(base, functions=functions)


def part_of(flown: Flown, begin_s: float, end_s: float) -> Flown:
    """A window of a flight."""
    inside = (flown.time_s >= begin_s) & (flown.time_s < end_s)
    cut = [{name: values[inside] for name, values in of.items()} for of in (flown.true, flown.commands)]
    return Flown(flown.time_s[inside], *cut, {name: values[inside] for name, values in flown.coefficients.items()})


def window_of(signals: FlightSignals, begin_s: float, end_s: float, name: str) -> FlightSignals:
    """The same of what was logged, as a flight of its own."""
    found = {}
    for key, one in signals.signals.items():
        inside = (one.time_s >= begin_s) & (one.time_s < end_s)
        if np.count_nonzero(inside) > 1:
            found[key] = replace(one, time_s=one.time_s[inside], values=one.values[inside])
    return replace(signals, name=name, signals=found)


def truth_of(flown: Flown, aircraft: Aircraft, mode: str) -> dict[str, float]:
    """The coefficients of the default structure that are right along a flight: the nearest to JSBSim's own; of moments
    in a slipstream, which turns the aircraft as no regressor of theirs does, those of the aircraft at the mean thrust.
    """
    own = aircraft.model.values()
    truth = slopes(flown, aircraft.vehicle, (*own, "CY_0", "Cl_0", "Cn_0"))
    if mode != "slipstream":
        return truth
    pressure = 0.5 * flown.true["air_density"] * flown.true["true_airspeed"] ** 2 * aircraft.vehicle.geometry.S
    wash = 1.0 + _WASH * float(np.mean(flown.commands["thrust"] / pressure))
    del truth["Cm_0"]  # what the wash makes of an elevator that is set stands in it too
    moments = [name for name in truth if name in own and name[:2] in ("Cm", "Cl", "Cn")]
    return {**truth, **{name: own[name] * (wash if name in _BLOWN else 1.0) for name in moments}}

"""Effects in flights as test pilots plan them: steps, doublets, 3-2-1-1, sweeps, decelerations, throttle steps, turns.

Surfaces are logged in whole microseconds, as commands or as positions, and nothing is as ideal for a search as one long
multisine: each axis moves for a while and rests for another. The effects of jsbsim_effects, and others that sensors and
servos make; `UNLISTED` are ones that no catalogue holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from field_effects import HiddenFlight
from field_flight import MICROSECOND, VANE_LAG_HZ, at_rate, textbook
from field_inputs import DOUBLET, STICK, THREE_TWO_ONE_ONE
from field_plant import STEP, SURFACES, Hold, Inputs, Servo, fly_field
from field_sensors import sense
from jsbsim_effects import NAMES, Hidden, hidden, with_terms
from jsbsim_flight import STEP as FINE_STEP
from jsbsim_flight import Aircraft, drawn_aircraft, multisine
from jsbsim_twin import FT, Array, product, property_of, regressor, value_of
from scipy import signal

SECONDS = 80.0
SIZE = {"de": 0.06, "da": 0.07, "dr": 0.08}  # rad
NOTHING = "none"


@dataclass(frozen=True)
class Planned:
    """What is hidden beyond a term of the aerodynamics. terms: JSBSim's, by axis. sensors: of Field."""

    parameters: Mapping[str, float]
    terms: Mapping[str, str] = field(default_factory=dict)
    sensors: Mapping[str, float] = field(default_factory=dict)
    servo: Servo = field(default_factory=Servo)


_ALPHA, _BETA, _RUDDER = (property_of(f"{name}-rad") for name in ("aero/alpha", "aero/beta", "fcs/rudder-pos"))
_SECONDS = property_of("simulation/sim-time-sec")


def _thrust_share(base: Aircraft, scale: float) -> str:
    """Thrust over dynamic pressure and wing area, times scale."""
    area = base.vehicle.geometry.S / FT**2
    pressure = f"<product>{property_of('aero/qbar-psf')}{value_of(area)}</product>"
    return (
        f"<quotient>{product(value_of(scale), property_of('external_reactions/thrust/magnitude'))}{pressure}</quotient>"
    )


def _propwash(base: Aircraft, size: float) -> Planned:
    own = base.model.values()["Cm_de"]
    return Planned(
        {"k": 1.5 * size}, {"Cm": product(_thrust_share(base, 1.5 * size * own), regressor("de", base.vehicle))}
    )


def _torque(base: Aircraft, size: float) -> Planned:
    arm = 0.02 * size
    return Planned({"k_Q": arm}, {"Cl": _thrust_share(base, -arm / base.vehicle.geometry.b)})


def _downwash(base: Aircraft, size: float) -> Planned:
    half = 0.5 * base.vehicle.geometry.c / FT
    turn = product(value_of(-4.0 * size * half), property_of("aero/alphadot-rad_sec"))
    return Planned(
        {"Cm_alphadot": -4.0 * size}, {"Cm": f"<quotient>{turn}{property_of('velocities/vt-fps')}</quotient>"}
    )


# Of sensors, servos and the power: what is listed, by the catalogue's name.
MORE: dict[str, Callable[[Aircraft, float], Planned]] = {
    "asymmetry": lambda _, size: Planned(
        {"Cl_0": 0.004 * size, "Cn_0": -0.002 * size}, {"Cl": value_of(0.004 * size), "Cn": value_of(-0.002 * size)}
    ),
    "propwash_elevator": _propwash,
    "propeller_torque": _torque,
    "downwash_lag": _downwash,
    "actuator_delay": lambda _, size: Planned({"delay": 0.06 * size}, servo=Servo(delay=0.06 * size)),
    "actuator_backlash": lambda _, size: Planned({"width": 0.03 * size}, servo=Servo(backlash=0.015 * size)),
    "vane_lag": lambda _, size: Planned(
        {"tau": 0.06 * size}, sensors={"vane_hz_natural": VANE_LAG_HZ / size, "vane_damping": 0.7}
    ),
    "pitot_lag": lambda _, size: Planned({"tau": 0.25 * size}, sensors={"pneumatic_lag": 0.25 * size}),
    "thrust_scale": lambda _, size: Planned({"scale": 0.15 * size}, sensors={"thrust_scale": 0.15 * size}),
    "airspeed_error": lambda _, size: Planned({"scale": 0.08 * size}, sensors={"airspeed_scale": 0.08 * size}),
    "sensor_time_skew": lambda _, size: Planned({"delay": 0.06 * size}, sensors={"vane_offset": 0.06 * size}),
}
# Terms that no catalogue holds.
_MADE_UP: dict[str, Callable[[float], Mapping[str, str]]] = {
    "lift_ripple": lambda size: {
        "CL": product(
            value_of(0.05 * size), f"<sin>{product(value_of(float(2.0 * np.pi / np.radians(3.0))), _ALPHA)}</sin>"
        )
    },
    "periodic_moment": lambda size: {
        "Cm": product(value_of(0.006 * size), f"<sin>{product(value_of(2.0 * np.pi * 0.9), _SECONDS)}</sin>")
    },
    "one_sided_rudder": lambda size: {
        "Cn": product(value_of(-0.05 * size), f"<max>{_RUDDER}{value_of(0.0)}</max>"),
    },
    "sideslip_notch": lambda size: {
        "Cl": product(
            value_of(0.006 * size),
            f"<exp>{product(value_of(float(-0.5 / np.radians(0.7) ** 2)), _BETA, _BETA)}</exp>",
        )
    },
    "slow_lift_loss": lambda size: {"CL": product(value_of(-0.1 * size / SECONDS), _SECONDS)},
    "shifting_battery": lambda size: {
        "Cm": product(
            value_of(0.08 * size),
            property_of("aero/twin/CL"),
            f"<ifthen><gt>{_SECONDS}{value_of(0.45 * SECONDS)}</gt>{value_of(1.0)}{value_of(0.0)}</ifthen>",
        )
    },
}
UNLISTED = tuple(_MADE_UP)
LISTED = (*NAMES, *MORE)
EFFECTS = (NOTHING, *LISTED, *UNLISTED)


def planned_inputs(seed: int, seconds: float = SECONDS) -> Inputs:
    """One manoeuvre after another, each surface in turn, between them decelerations, throttle steps and turns."""
    g = np.random.default_rng([seed, 61])
    times = np.arange(round(seconds / STEP) + 1) * STEP
    moves: dict[str, Array] = {name: np.zeros(times.size) for name in SURFACES}
    throttle, bank, pitch = (np.zeros(times.size) for _ in range(3))
    at, place = 1.0, int(g.integers(3))
    while at < seconds - 2.0:
        kind = str(g.choice(["steps", "doublet", "3211", "sweep", "sines", "sticks", "slower", "power", "turn"]))
        sign = float(g.choice([-1.0, 1.0]))
        name, long = SURFACES[place % 3], float(g.uniform(4.0, 7.0))
        here = (times >= at) & (times < at + long)
        since = times[here] - at
        if kind == "slower":
            throttle[here], pitch[here] = -g.uniform(0.3, 0.6), g.uniform(0.08, 0.3)
        elif kind == "power":
            throttle[here] = sign * g.uniform(0.2, 0.4)
        elif kind == "turn":
            bank[here] = sign * g.uniform(0.3, 0.6)
        else:
            place += 1
            size = SIZE[name] * g.uniform(0.5, 1.2)
            if kind == "sweep":
                wave = signal.chirp(since, 0.3, long, g.uniform(1.5, 3.0))
                moves[name][here] += sign * size * wave
            elif kind == "sines":
                moves[name][here] += multisine(since + 2.0, size, place % 3, g)
            elif kind == "sticks":
                edges = np.sort(g.uniform(0.0, long, 8))
                moves[name][here] += size * g.uniform(-1.0, 1.0, 9)[np.searchsorted(edges, since)]
            else:
                pattern = {"steps": (3,), "doublet": DOUBLET, "3211": THREE_TWO_ONE_ONE}[kind]
                edges = np.cumsum(np.abs(pattern)) * g.uniform(0.3, 0.5)
                level = np.append(np.sign(pattern), 0.0)[np.searchsorted(edges, since, side="right")]
                moves[name][here] += sign * size * level
        at += long * (1.0 if kind not in ("doublet", "steps") else 0.5) + g.uniform(0.3, 1.5)
    left = float(np.exp(-STEP / STICK))
    moved = {name: np.asarray(signal.lfilter([1.0 - left], [1.0, -left], x)) for name, x in moves.items()}
    return Inputs(moved, throttle, bank, pitch)


def planned_flight(name: str, aircraft: int, seed: int, folder: Path, off: float, size: float) -> HiddenFlight:
    """Fly an effect of EFFECTS. aircraft: number of the one drawn. off: most that a coefficient told is wrong by."""
    base = drawn_aircraft(aircraft)
    more = MORE[name](base, size) if name in MORE else Planned({})
    terms = _MADE_UP[name](size) if name in _MADE_UP else more.terms
    if name in NAMES:
        effect = hidden(name, size, base)
    else:
        flown = replace(base, functions=with_terms(base.functions, terms))
        effect = Hidden(name, more.parameters, flown, base.vehicle, base.model)
    # What lags by a share of each step lags by another share of longer ones.
    ratio = STEP / FINE_STEP
    lags = tuple(replace(lag, share=1.0 - (1.0 - lag.share) ** ratio) for lag in effect.flown.lags)
    flown = replace(effect.flown, lags=lags)
    draw = np.random.default_rng([seed, aircraft, 67])
    hz, positions = float(draw.choice([50.0, 50.0, 100.0])), bool(draw.uniform() < 0.5)
    # What servos do is seen where commands are logged, each stamped when it was sent: a log's row has the one before,
    # and JSBSim acts on a new one half a step late.
    positions = positions and more.servo == Servo()
    sent_hz = 250.0 if positions else 50.0
    rate = at_rate(textbook(), hz)
    known = replace(rate, **more.sensors, pulse=MICROSECOND, positions=positions)
    if not positions:
        known = replace(known, command_hz=sent_hz, command_offset=0.5 * STEP - 1.0 / sent_hz)
    inputs = planned_inputs(1000 * aircraft + seed)
    log = fly_field(
        folder, flown, inputs, seed, servo=more.servo, hold=Hold(0.12, 0.25, hz=sent_hz), resolution=MICROSECOND
    )
    signals = sense(log, flown.vehicle, known, seed, f"{name}-planned-{aircraft}-{seed}")
    controls = effect.vehicle.controls
    if positions:
        controls = {key: replace(control, signal="position") for key, control in controls.items()}
    told = replace(effect.vehicle, controls=controls)
    return HiddenFlight(signals, told, effect.baseline(seed, off), dict(effect.parameters))

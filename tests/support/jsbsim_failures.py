"""Aircraft that break while JSBSim flies them, and sensors of the field that fail, each after some seconds.

What breaks changes JSBSim's own coefficients while it runs, or stops a surface; of the package under test only what a
broken sensor reads is used (`sim_vehicle.flight.failures`), since that is a definition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from field_air import Air
from field_flight import plan_of
from field_inputs import inputs_of
from field_plant import fly_field
from field_sensors import sense
from jsbsim_flight import Aircraft, linear_aircraft
from jsbsim_twin import AXES, Array, Lag, function, product, regressor

from sim_vehicle.flight.failures import KINDS, BrokenReading, parse_failure
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals, Signal

Values = Mapping[str, float]
# Bragg et al., AIAA 2002-0813, a Twin Otter's heavy coat, of the larger ones.
_COAT = {
    "CL_alpha": -0.10, "CD_0": 0.50, "Cm_alpha": -0.10, "Cm_de": -0.10, "CY_beta": -0.20, "Cl_beta": -0.10,
    "Cl_p": -0.10, "Cl_da": -0.10, "Cn_beta": -0.20, "Cn_dr": -0.08,
}  # fmt: skip
_FIN = ("CY_beta", "CY_r", "CY_dr", "Cl_dr", "Cn_beta", "Cn_r", "Cn_dr")
# How far a tail's loss moves the neutral point: half of the downwash's rest over a lever in chords (Etkin & Reid, 5.3).
_TAIL_STIFFNESS = 0.1


def _scaled(values: Values, names: Any, share: float) -> dict[str, float]:
    return {name: (share - 1.0) * values[name] for name in names if name in values}


def _surface(control: str, share: float) -> Callable[[Values], dict[str, float]]:
    return lambda values: _scaled(values, [n for n in values if control in parse_term(n).factors], share)


def _tail(values: Values) -> dict[str, float]:
    return {
        **_scaled(values, ("Cm_q", "Cm_de", "CL_de", "CL_q"), 0.6),
        "Cm_alpha": -0.4 * _TAIL_STIFFNESS * values["Cm_q"],
    }


def _gravity(values: Values) -> dict[str, float]:
    """5 % of the chord back: lift has an arm."""
    return {f"Cm_{name[3:]}": 0.05 * value for name, value in values.items() if name.startswith("CL_")}


#: Case of the campaign -> what it adds to JSBSim's coefficients.
BREAKS: Mapping[str, Callable[[Values], dict[str, float]]] = {
    "elevator=0.5": _surface("de", 0.5),
    "aileron=0.5": _surface("da", 0.5),
    "rudder=0.5": _surface("dr", 0.5),
    "elevator=0": _surface("de", 0.0),
    "rudder=0": _surface("dr", 0.0),
    "one-aileron=5": lambda v: {**_surface("da", 0.5)(v), "Cl_0": 0.5 * math.radians(5.0) * v["Cl_da"],
                                "Cn_0": 0.5 * math.radians(5.0) * v["Cn_da"]},
    "tail=0.6": _tail,
    "fin=0.5": lambda v: _scaled(v, _FIN, 0.5),
    "ice=1.5": lambda v: {name: 1.5 * share * v[name] for name, share in _COAT.items()},
    "flap=0.2": lambda v: {"CL_0": 0.2, "CD_0": 0.03, "Cm_0": -0.02},
    "gear=0.03": lambda v: {"CD_0": 0.03},
    "cg=0.05": _gravity,
    "elevator-stuck": lambda v: {},
}  # fmt: skip
AT_REST = ("CY_0", "Cl_0", "Cn_0")


def breaking_aircraft() -> Aircraft:
    """The linear aircraft, each of whose coefficients has a property beside it, 0 as long as nothing breaks."""
    aircraft = linear_aircraft()
    values = {**aircraft.model.values(), **dict.fromkeys(AT_REST, 0.0)}
    functions = {
        axis: function(
            axis,
            [
                product(
                    f"<sum><value>{value!r}</value><property>{_property(name)}</property></sum>",
                    *(regressor(factor, aircraft.vehicle) for factor in parse_term(name).factors),
                )
                for name, value in values.items()
                if parse_term(name).axis == axis
            ],
        )
        for axis in AXES
    }
    held = [Lag(_property(n), f"<property>{_property(n)}</property>", _property(n), 0.0) for n in values]
    return replace(aircraft, functions=functions, lags=tuple(held))


def _property(name: str) -> str:
    return f"broken/{name}"


def broken_flight(
    folder: Path, case: str, at_s: float, seconds: float, gust_m_s: float, seed: int, *, kind: str = "multisine"
) -> tuple[FlightSignals, Vehicle]:
    """Fly JSBSim with servos, sensors and links of the field's mild family; something fails after `at_s` seconds.

    case: of BREAKS, a sensor's failure, or another word for none. kind: of the inputs.
    """
    aircraft, plan = breaking_aircraft(), plan_of("mild", seed)
    values = {**aircraft.model.values(), **dict.fromkeys(AT_REST, 0.0)}
    inputs = inputs_of(kind, seconds, np.random.default_rng([seed, 23]))
    stands: list[float] = []

    def breaks(time_s: float, twin: Any, moved: Array) -> Array:
        if case not in BREAKS or time_s < at_s:
            return moved
        if not stands:
            stands.append(float(moved[0]))
            for name, change in BREAKS[case](values).items():
                twin.set_property_value(_property(name), change)
        return np.array([stands[0], *moved[1:]]) if case == "elevator-stuck" else moved

    air = Air(gust=gust_m_s, length=80.0, rolling=1.0 if gust_m_s else 0.0, wind=(2.0, -1.0))
    log = fly_field(folder, aircraft, inputs, seed, servo=plan.servo, air=air, hold=plan.hold, breaks=breaks)
    signals = sense(log, aircraft.vehicle, replace(plan.field, bursts=0.0), seed, case)
    name = case.partition("=")[0]
    if case not in BREAKS and (name in KINDS or case.replace("=", "-") in KINDS):
        signals = failed_sensor(signals, case, at_s)
    return signals, aircraft.vehicle


def failed_sensor(signals: FlightSignals, case: str, at_s: float) -> FlightSignals:
    """The flight as a sensor reads it that fails."""
    failure = parse_failure(f"{case}@{at_s:g}")
    if failure.name == "gps-lost":
        cut = {n: s if n not in ("vn", "ve", "vd") else _until(s, at_s) for n, s in signals.signals.items()}
        return replace(signals, signals=cut)
    if failure.kind.control:
        name = {"elevator": "de", "aileron": "da", "rudder": "dr"}[failure.kind.control]
        sent = signals.signals[name]
        last = float(sent.values[np.searchsorted(sent.time_s, at_s)])
        held = np.where(sent.time_s >= at_s, last, sent.values)
        return replace(signals, signals={**signals.signals, name: replace(sent, values=held)})
    law = failure.kind.law
    assert law is not None
    read = signals.signals[failure.kind.channel]
    found, seen = read.values.copy(), None
    for i in np.flatnonzero(read.time_s >= at_s):
        value, age = float(read.values[i]), float(read.time_s[i]) - at_s
        before = seen or BrokenReading(value, value, age, 0.0)
        now = replace(before, age_s=age, step_s=age - before.age_s)
        found[i] = law(value, failure.size, now)
        seen = replace(now, last=float(found[i]))
    return replace(signals, signals={**signals.signals, failure.kind.channel: replace(read, values=found)})


def _until(signal: Signal, end_s: float) -> Signal:
    kept = signal.time_s < end_s
    return replace(signal, time_s=signal.time_s[kept], values=signal.values[kept])

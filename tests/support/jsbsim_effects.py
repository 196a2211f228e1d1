"""Effects that a model may lack, written for JSBSim: terms of its functions, lags, masses and forces.

None of this project's effects is used, only their names and those of their parameters. Each flight is of the linear
aircraft with one effect; the baseline is told everything but that, and every coefficient of it is off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jsbsim_flight import AIRSPEED, STEP, Aircraft, linear_aircraft
from jsbsim_twin import FT, Lag, function, linear_coefficients, product, regressor, value_of

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle

_AXIS_END = "</sum></function>"
_ALPHA = "<property>aero/alpha-rad</property>"


@dataclass(frozen=True)
class Hidden:
    """One effect in one aircraft.

    name, parameters: as the catalogue calls it, at the values flown. flown: what JSBSim flies. vehicle, model: what is
    told of it.
    """

    name: str
    parameters: Mapping[str, float]
    flown: Aircraft
    vehicle: Vehicle
    model: Model

    def baseline(self, seed: int, share: float) -> Model:
        """The model that is told with every coefficient off by up to `share`."""
        generator = np.random.default_rng([seed, 3])
        values = self.model.values()
        off = {name: value * (1.0 + share * generator.uniform(-1.0, 1.0)) for name, value in values.items()}
        return replace(self.model, coefficients={name: Coefficient(value) for name, value in off.items()})


def with_terms(functions: Mapping[str, str], terms: Mapping[str, str]) -> dict[str, str]:
    """Functions of the coefficients with one more term on some axes."""
    return {
        axis: text.removesuffix(_AXIS_END) + terms[axis] + _AXIS_END if axis in terms else text
        for axis, text in functions.items()
    }


def _lag(name: str, follows: str, start: str, tau: float) -> Lag:
    return Lag(f"fcs/{name}", follows, start, -math.expm1(-STEP / tau))


# Linear terms: axis and regressors of each parameter. The aircraft's own value is of size 1 where it has one.
_TERMS: dict[str, dict[str, tuple[str, tuple[str, ...]]]] = {
    "pitch_damping": {"Cm_q": ("Cm", ("q",))},
    "pitch_curvature": {"Cm_alpha2": ("Cm", ("alpha", "alpha"))},
    "lift_pitch_rate": {"CL_q": ("CL", ("q",))},
    "polar_offset": {"CD_CL": ("CD", ("CL",))},
    "control_drag": {"CD_de2": ("CD", ("de", "de"))},
    "lift_alpha_elevator": {"CL_alpha_de": ("CL", ("alpha", "de"))},
    "dihedral": {"Cl_beta": ("Cl", ("beta",))},
    "weathercock": {"Cn_beta": ("Cn", ("beta",))},
    "roll_damping": {"Cl_p": ("Cl", ("p",))},
    "yaw_damping": {"Cn_r": ("Cn", ("r",))},
    "cross_roll_yaw": {"Cl_r": ("Cl", ("r",)), "Cn_p": ("Cn", ("p",))},
    "rudder_roll": {"Cl_dr": ("Cl", ("dr",))},
    "adverse_yaw": {"Cn_da": ("Cn", ("da",))},
    "side_force": {"CY_beta": ("CY", ("beta",))},
    "sideslip_drag": {"CD_beta2": ("CD", ("beta", "beta"))},
}
# Values of what the linear aircraft does not have, within what is usual for its size.
_VALUES = {"Cm_alpha2": -2.0, "CD_CL": 0.03, "CD_de2": 1.5, "CL_alpha_de": 2.0, "CD_beta2": 1.0}


def _term_effect(name: str, base: Aircraft, size: float) -> Hidden:
    own = base.model.values()
    parameters = {key: size * _VALUES.get(key, own.get(key, 0.0)) for key in _TERMS[name]}
    rest = _without(base.model, parameters)
    terms = {
        axis: product(value_of(parameters[key]), *(regressor(factor, base.vehicle) for factor in factors))
        for key, (axis, factors) in _TERMS[name].items()
    }
    functions = with_terms(linear_coefficients(base.vehicle, rest), terms)
    return Hidden(name, parameters, Aircraft(name, base.vehicle, rest, functions), base.vehicle, rest)


def _without(model: Model, names: Mapping[str, float]) -> Model:
    return replace(model, coefficients={key: c for key, c in model.coefficients.items() if key not in names})


def _stall(base: Aircraft, size: float) -> Hidden:
    """Lift and drag go over to those of a flat plate: Beard & McLain (2012), eq. (4.9) and (4.10). Of half the size it
    comes 0.02 rad later.
    """
    angle, sharpness = 0.13 + 0.04 * (1.0 - size), 50.0

    def rise(offset: float, sign: float) -> str:
        shifted = f"<sum>{_ALPHA}{value_of(offset)}</sum>"
        return f"<exp><product>{value_of(sign * sharpness)}{shifted}</product></exp>"

    above, below = rise(-angle, -1.0), rise(angle, 1.0)
    share = (
        f'<function name="aero/twin/separated"><quotient><sum>{value_of(1.0)}{above}{below}</sum><product>'
        f"<sum>{value_of(1.0)}{above}</sum><sum>{value_of(1.0)}{below}</sum></product></quotient></function>"
    )
    separated, sine = "<property>aero/twin/separated</property>", f"<sin>{_ALPHA}</sin>"
    plate = product(value_of(2.0), sine, f"<abs>{sine}</abs>", f"<cos>{_ALPHA}</cos>")
    attached = "<property>aero/twin/CL-attached</property>"
    left = product(f"<difference>{value_of(1.0)}{separated}</difference>", attached)
    blend = share + function("CL", [left, product(separated, plate)])
    functions = linear_coefficients(base.vehicle, base.model)
    functions["CL"] = functions["CL"].replace("aero/twin/CL", "aero/twin/CL-attached") + blend
    drag = product(value_of(2.0), separated, f"<pow><abs>{sine}</abs>{value_of(3.0)}</pow>")
    functions = with_terms(functions, {"CD": drag})
    flown = Aircraft("stall", base.vehicle, base.model, functions)
    return Hidden("stall", {"alpha_stall": angle}, flown, base.vehicle, base.model)


def _reynolds_drag(base: Aircraft, size: float) -> Hidden:
    """The drag at zero lift goes with airspeed to the power -n about that of the flight."""
    n = 0.5 * size
    rest = _without(base.model, {"CD_0": 0.0})
    ratio = f"<quotient><property>velocities/vt-fps</property>{value_of(AIRSPEED / FT)}</quotient>"
    term = product(value_of(base.model.values()["CD_0"]), f"<pow>{ratio}{value_of(-n)}</pow>")
    functions = with_terms(linear_coefficients(base.vehicle, rest), {"CD": term})
    flown = Aircraft("reynolds_drag", base.vehicle, base.model, functions)
    return Hidden("reynolds_drag", {"n": n}, flown, base.vehicle, base.model)


def _unsteady_lift(base: Aircraft, size: float) -> Hidden:
    """Lift follows the angle of attack of before, by a lag."""
    tau = 0.06 * size
    functions = linear_coefficients(base.vehicle, base.model)
    functions["CL"] = functions["CL"].replace("aero/alpha-rad", "fcs/felt-alpha")
    flow = "<property>velocities/w-fps</property><property>velocities/u-fps</property>"
    lag = _lag("felt-alpha", f"<atan2>{flow}</atan2>", "ic/alpha-rad", tau)
    flown = Aircraft("unsteady_lift", base.vehicle, base.model, functions, (lag,))
    return Hidden("unsteady_lift", {"tau": tau}, flown, base.vehicle, base.model)


def _actuator_lag(base: Aircraft, size: float) -> Hidden:
    """The surfaces follow the commands by lags."""
    tau = 0.05 * size
    surfaces = {"elevator": "elevator-pos-rad", "aileron": "left-aileron-pos-rad", "rudder": "rudder-pos-rad"}
    functions = linear_coefficients(base.vehicle, base.model)
    for name, command in surfaces.items():
        functions = {axis: text.replace(f"fcs/{command}", f"fcs/{name}-lagged") for axis, text in functions.items()}
    lags = tuple(
        _lag(f"{name}-lagged", f"<property>fcs/{command}</property>", f"fcs/{command}", tau)
        for name, command in surfaces.items()
    )
    flown = Aircraft("actuator_lag", base.vehicle, base.model, functions, lags)
    return Hidden("actuator_lag", {"tau": tau}, flown, base.vehicle, base.model)


def _thrust_line_offset(base: Aircraft, size: float) -> Hidden:
    """The force of the thrust acts lower than the vehicle file says."""
    offset = 0.02 * size
    assert base.vehicle.propulsion is not None
    x, y, z = base.vehicle.propulsion.line
    true = replace(base.vehicle, propulsion=replace(base.vehicle.propulsion, line=(x, y, z + offset)))
    return Hidden("thrust_line_offset", {"z_T": offset}, replace(base, vehicle=true), base.vehicle, base.model)


def _mass_error(base: Aircraft, size: float) -> Hidden:
    """The aircraft weighs more than the vehicle file says; its moments of inertia are as told."""
    scale = 0.05 * size
    true = replace(base.vehicle, mass=replace(base.vehicle.mass, mass=(1.0 + scale) * base.vehicle.mass.mass))
    return Hidden("mass_error", {"scale": scale}, replace(base, vehicle=true), base.vehicle, base.model)


_OTHERS: dict[str, Callable[[Aircraft, float], Hidden]] = {
    "stall": _stall,
    "reynolds_drag": _reynolds_drag,
    "unsteady_lift": _unsteady_lift,
    "actuator_lag": _actuator_lag,
    "thrust_line_offset": _thrust_line_offset,
    "mass_error": _mass_error,
}
NAMES = (*_TERMS, *_OTHERS)


def hidden(name: str, size: float = 1.0, base: Aircraft | None = None) -> Hidden:
    """The effect of that name (one of `NAMES`) in JSBSim, of that share of its usual size.

    base: a linear aircraft, the usual one if it is not given.
    """
    base = base or linear_aircraft()
    return _OTHERS[name](base, size) if name in _OTHERS else _term_effect(name, base, size)

"""The same aircraft for JSBSim, written from a vehicle and a model, and flown there.

What it takes to make JSBSim's round, rotating, oblate earth a flat one: a planet of its own, a sphere of a hundred
earth radii without rotation and J2, with the GM that gives the vehicle's gravity. Lengths are feet and masses slugs,
by exact factors (JSBSim's own kg m^2 to slug ft^2 is off by 9e-5). The product of inertia is made of two point masses
rather than given as a number, so that no sign convention of JSBSim's is relied on. The aerodynamics are functions for
the body axes, since JSBSim's LIFT, DRAG and SIDE are wind axes, which sideslip turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import jsbsim
import numpy as np
from numpy.typing import NDArray

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

FT = 0.3048  # m, exact
POUND = 0.45359237  # kg, exact
NEWTON_PER_POUND_FORCE = POUND * 9.80665
SLUG = NEWTON_PER_POUND_FORCE / FT  # kg
JSBSIM_SLUG_TO_POUND = 32.174049  # FGJSBBase: weights given in pounds are divided by it
PLANET_RADIUS = 100 * 6.371e6  # m
NAME = "twin"
AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")

STATES = ("north", "east", "down", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")
_PROPERTIES = {
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "de": "fcs/elevator-pos-rad",
    "da": "fcs/left-aileron-pos-rad",
    "dr": "fcs/rudder-pos-rad",
    "CL": "aero/twin/CL",
}


@dataclass(frozen=True)
class Lag:
    """A property that follows an expression with a lag of the first order.

    follows: expression of JSBSim's. start: property with the value that it begins at. share: of the way that it goes in
    one step, 1 - exp(-step / tau). JSBSim's own lag filter begins at 0, far from any trim.
    """

    name: str
    follows: str
    start: str
    share: float


def settle(twin: jsbsim.FGFDMExec, lags: Iterable[Lag]) -> None:
    """Begin lags where they end in steady flight; initial conditions and inputs must be set."""
    for lag in lags:
        twin.set_property_value(lag.name, twin.get_property_value(lag.start))


def value_of(x: float) -> str:
    return f"<value>{x!r}</value>"


def property_of(name: str) -> str:
    return f"<property>{name}</property>"


def named_property(control: str) -> str:
    """Where the deflection of a control of its own name stands."""
    return f"fcs/own/{control}"


def regressor(name: str, vehicle: Vehicle) -> str:
    """JSBSim expression of alpha, beta, a surface, CL, or a nondimensional rate."""
    if name in _PROPERTIES:
        return property_of(_PROPERTIES[name])
    if name in vehicle.controls:
        return property_of(named_property(name))
    length = {"p": vehicle.geometry.b, "q": vehicle.geometry.c, "r": vehicle.geometry.b}[name] / FT
    return (
        f"<quotient><product>{property_of(f'velocities/{name}-rad_sec')}{value_of(0.5 * length)}</product>"
        f"{property_of('velocities/vt-fps')}</quotient>"
    )


def function(axis: str, terms: Iterable[str]) -> str:
    """JSBSim function of one coefficient (CL ... Cn): the sum of its terms."""
    # A sum of JSBSim's has two members at least.
    return f'<function name="aero/twin/{axis}"><sum>{value_of(0.0)}{value_of(0.0)}{"".join(terms)}</sum></function>'


def product(*factors: str) -> str:
    """Product of JSBSim expressions."""
    return f"<product>{value_of(1.0)}{''.join(factors)}</product>"


def linear_coefficients(vehicle: Vehicle, model: Model) -> dict[str, str]:
    """Functions of the six coefficients of a model."""
    return {axis: _coefficient(axis, vehicle, model) for axis in AXES}


def _coefficient(axis: str, vehicle: Vehicle, model: Model) -> str:
    """Function text of one coefficient: the sum of its terms."""
    terms: list[tuple[Term, float]] = [(parse_term(name), value) for name, value in model.values().items()]
    return function(
        axis,
        [
            product(value_of(value), *(regressor(f, vehicle) for f in term.factors))
            for term, value in terms
            if term.axis == axis
        ],
    )


def _axis(name: str, size: float, body: str) -> str:
    """One axis: dynamic pressure times `size` (ft^2 or ft^3) times `body`. Force in pounds, moment in foot-pounds."""
    return (
        f'<axis name="{name}"><function name="aero/twin/{name}"><product>{property_of("aero/qbar-psf")}'
        f"{value_of(size)}{body}</product></function></axis>"
    )


def _aerodynamics(vehicle: Vehicle, coefficients: Mapping[str, str]) -> str:
    geometry = vehicle.geometry
    S, b, c = geometry.S / FT**2, geometry.b / FT, geometry.c / FT
    CL, CD = property_of("aero/twin/CL"), property_of("aero/twin/CD")
    cos, sin = f"<cos>{property_of('aero/alpha-rad')}</cos>", f"<sin>{property_of('aero/alpha-rad')}</sin>"
    X = f"<difference><product>{CL}{sin}</product><product>{CD}{cos}</product></difference>"
    Z = f"<sum><product>{value_of(-1.0)}{CL}{cos}</product><product>{value_of(-1.0)}{CD}{sin}</product></sum>"
    return "".join(
        [
            "<aerodynamics>",
            *(coefficients[axis] for axis in AXES),
            _axis("X", S, X),
            _axis("Y", S, property_of("aero/twin/CY")),
            _axis("Z", S, Z),
            _axis("ROLL", S * b, property_of("aero/twin/Cl")),
            _axis("PITCH", S * c, property_of("aero/twin/Cm")),
            _axis("YAW", S * b, property_of("aero/twin/Cn")),
            "</aerodynamics>",
        ]
    )


def _location(name: str, xyz: tuple[float, float, float]) -> str:
    """A place given in body axes, m, in JSBSim's structural frame: x aft, z up."""
    attribute = f' name="{name}"' if name else ""
    x, y, z = -xyz[0] / FT, xyz[1] / FT, -xyz[2] / FT
    return f'<location{attribute} unit="FT"><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></location>'


def _mass_balance(vehicle: Vehicle) -> str:
    """Mass, inertias, and two point masses on the line that makes Ixz = + integral of x z dm."""
    mass = vehicle.mass
    arm = math.sqrt(abs(mass.Ixz) / (0.2 * mass.mass)) if mass.Ixz else 0.0
    point = 0.1 * mass.mass if mass.Ixz else 0.0
    z = math.copysign(arm, mass.Ixz)
    own = 2.0 * point * arm * arm
    inertia = {"ixx": mass.Ixx - own, "iyy": mass.Iyy - 2.0 * own, "izz": mass.Izz - own}
    pounds = JSBSIM_SLUG_TO_POUND / SLUG
    text = "".join(f'<{k} unit="SLUG*FT2">{v / (SLUG * FT**2)!r}</{k}>' for k, v in inertia.items())
    text += "".join(f'<{k} unit="SLUG*FT2">0.0</{k}>' for k in ("ixy", "ixz", "iyz"))
    text += f'<emptywt unit="LBS">{(mass.mass - 2.0 * point) * pounds!r}</emptywt>{_location("CG", (0.0, 0.0, 0.0))}'
    for name, x, down in (("fore", arm, z), ("aft", -arm, -z)):
        if point:
            text += f'<pointmass name="{name}"><weight unit="LBS">{point * pounds!r}</weight>'
            text += f"{_location(name, (x, 0.0, down))}</pointmass>"
    return f"<mass_balance>{text}</mass_balance>"


def write_twin(
    folder: Path,
    vehicle: Vehicle,
    model: Model,
    coefficients: Mapping[str, str] | None = None,
    lags: Iterable[Lag] = (),
) -> None:
    """Write planet and aircraft of a vehicle with a model without effects (alphadot and throttle terms excepted).

    coefficients: JSBSim functions of CL CD CY Cl Cm Cn, as `function` gives them, to fly instead of the model's.
    lags: properties that the functions may use beside JSBSim's own.
    """
    geometry = vehicle.geometry
    assert vehicle.propulsion is not None
    tilt = vehicle.propulsion.inclination
    radius, gravity = PLANET_RADIUS / FT, vehicle.environment.gravity / FT
    planet = (
        f'<planet name="flat"><equatorial_radius unit="FT">{radius!r}</equatorial_radius>'
        f'<polar_radius unit="FT">{radius!r}</polar_radius><rotation_rate unit="RAD/SEC">0.0</rotation_rate>'
        f'<GM unit="FT3/SEC2">{gravity * radius**2!r}</GM><J2>0.0</J2></planet>'
    )
    metrics = (
        f'<metrics><wingarea unit="FT2">{geometry.S / FT**2!r}</wingarea><wingspan unit="FT">'
        f'{geometry.b / FT!r}</wingspan><chord unit="FT">{geometry.c / FT!r}</chord>'
        f"{_location('AERORP', (0.0, 0.0, 0.0))}</metrics>"
    )
    thrust = (
        f'<external_reactions><force name="thrust" frame="BODY">{_location("", vehicle.propulsion.line)}'
        f"<direction><x>{math.cos(tilt)!r}</x><y>0.0</y><z>{-math.sin(tilt)!r}</z></direction></force></external_reactions>"
    )
    aircraft = (
        f'<fdm_config name="{NAME}" version="2.0" release="BETA">{metrics}{_mass_balance(vehicle)}<ground_reactions/>'
        f"{thrust}<propulsion/>{_flight_control(lags, vehicle.named_controls)}"
        f"{_aerodynamics(vehicle, coefficients or linear_coefficients(vehicle, model))}</fdm_config>"
    )
    (folder / "aircraft" / NAME).mkdir(parents=True, exist_ok=True)
    (folder / "planet.xml").write_text(planet, encoding="utf-8")
    (folder / "aircraft" / NAME / f"{NAME}.xml").write_text(aircraft, encoding="utf-8")


def _flight_control(lags: Iterable[Lag], named: Iterable[str]) -> str:
    """Components that run once a step, before the aerodynamics. named: controls of their own names."""
    declared = "".join(
        f'<property value="0.0">{one}</property>'
        for one in (*(lag.name for lag in lags), *(named_property(name) for name in named))
    )
    moved = "".join(
        f'<fcs_function name="{lag.name}-next"><function><sum>{property_of(lag.name)}<product>{value_of(lag.share)}'
        f"<difference>{lag.follows}{property_of(lag.name)}</difference></product></sum></function>"
        f"<output>{lag.name}</output></fcs_function>"
        for lag in lags
    )
    return f'<flight_control name="{NAME}">{declared}<channel name="{NAME}">{moved}</channel></flight_control>'


def fly_twin(folder: Path, start: Array, surfaces: Array, thrust: Array, dt: float, density: float | None) -> Array:
    """States (N, 12) in the order of STATES, SI, of the twin from `start` (12,) under inputs at every `dt` seconds.

    surfaces: (N, 3) de, da, dr, rad. thrust: (N,) N. density: kg/m^3, None for JSBSim's standard atmosphere.
    """
    twin = load_twin(folder, start, dt, density)
    set_inputs(twin, surfaces[0], thrust[0])
    assert twin.run_ic()
    states = np.empty((len(thrust), len(STATES)))
    states[0] = _state(twin)
    for i in range(1, len(thrust)):
        set_inputs(twin, surfaces[i], thrust[i])
        twin.run()
        states[i] = _state(twin)
    states[:, :2] += start[:2] - states[0, :2]
    return states


def load_twin(folder: Path, start: Array, dt: float, density: float | None) -> jsbsim.FGFDMExec:
    """The twin with its initial conditions set, not run yet. Arguments as for `fly_twin`."""
    twin = jsbsim.FGFDMExec(str(folder))
    twin.set_debug_level(0)
    twin.set_aircraft_path("aircraft")
    assert twin.load_planet(str(folder / "planet.xml"), False)
    assert twin.load_model(NAME)
    twin.set_dt(dt)
    for part in ("rate/rotational", "rate/translational", "position/rotational", "position/translational"):
        twin.set_property_value(f"simulation/integrator/{part}", 5)  # Adams-Bashforth of fourth order
    twin.set_property_value("simulation/gravity-model", 0)
    if density is not None:
        twin.set_property_value("atmosphere/override/density", density / SLUG * FT**3)
    for name, value in zip(("u", "v", "w"), start[3:6], strict=True):
        twin.set_property_value(f"ic/{name}-fps", value / FT)
    for name, value in zip(("phi", "theta", "psi-true"), start[6:9], strict=True):
        twin.set_property_value(f"ic/{name}-rad", value)
    for name, value in zip(("p", "q", "r"), start[9:12], strict=True):
        twin.set_property_value(f"ic/{name}-rad_sec", value)
    twin.set_property_value("ic/h-sl-ft", -start[2] / FT)
    return twin


def set_inputs(twin: jsbsim.FGFDMExec, surfaces: Array, thrust: float) -> None:
    for name, value in zip(("de", "da", "dr"), surfaces, strict=True):
        twin.set_property_value(_PROPERTIES[name], float(value))
    twin.set_property_value("external_reactions/thrust/magnitude", thrust / NEWTON_PER_POUND_FORCE)


def _state(twin: jsbsim.FGFDMExec) -> Array:
    get = twin.get_property_value
    return np.array(
        [
            get("position/lat-gc-rad") * PLANET_RADIUS,
            get("position/long-gc-rad") * PLANET_RADIUS,
            -get("position/h-sl-ft") * FT,
            *(get(f"velocities/{name}-fps") * FT for name in "uvw"),
            *(get(f"attitude/{name}-rad") for name in ("phi", "theta", "psi")),
            *(get(f"velocities/{name}-rad_sec") for name in "pqr"),
        ]
    )

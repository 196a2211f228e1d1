"""Test flights made by JSBSim, with sensors of our own, and the truth that an identification of them is judged by.

Two aircraft with the mass, size and sensor places of the Ultra Stick 25e: `LINEAR` with linear aerodynamics, `TABLES`
with tables in angle of attack (one of them over the elevator too). Of the package under test only the vehicle and the
names of coefficients are used: trim, motion, forces, commands and sensor errors are made here or by JSBSim.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jsbsim_twin import (
    AXES,
    FT,
    NEWTON_PER_POUND_FORCE,
    SLUG,
    Array,
    Lag,
    function,
    linear_coefficients,
    load_twin,
    named_property,
    product,
    regressor,
    set_inputs,
    settle,
    write_twin,
)
from scipy import optimize
from scipy.interpolate import CubicSpline, RectBivariateSpline

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightSignals, Signal

TICK = 0.02  # s, of sensors and commands
BLOCKS, STEPS = 10, 10  # of a tick: changes of thrust, and JSBSim's steps between them
STEP = TICK / (BLOCKS * STEPS)
SECONDS = 30.0
AIRSPEED, HEIGHT = 17.0, 300.0
# Paper's Table II: noise of one sample, largest bias, step of the converter (SI).
NOISE = {
    **dict.fromkeys(("ax", "ay", "az"), (0.0785, 0.1962, 16.0 * 9.81 / 2**16)),
    **dict.fromkeys(("p", "q", "r"), tuple(np.radians((0.03, 0.25, 1000.0 / 2**16)))),
    **dict.fromkeys(("alpha", "beta"), (float(np.radians(0.3)), 0.0, 0.0)),
    **dict.fromkeys(("phi", "theta", "psi"), (float(np.radians(0.05)), 0.0, 0.0)),
    **dict.fromkeys(("vn", "ve", "vd"), (0.1, 0.0, 0.0)),
    "airspeed": (0.02, 0.0, 0.0),
    "thrust": (0.02, 0.0, 0.0),
}
VANE_SCALE = 0.005
FULL_THRUST, MOTOR_LAG = 7.86, 0.169  # N, s

_DEGREES = np.arange(-6.0, 19.0, 2.0)
# JSBSim goes in straight lines between the entries of a table; so fine, their kinks are below any sensor.
_FINE = np.arange(-6.0, 18.1, 0.25)
# Over the angles above: an aerofoil that rounds off, its drag, a tail that works less in the wake of a lifting wing,
# and derivatives of sideslip and roll that change with lift.
_TABLES: dict[tuple[str, str], tuple[float, ...]] = {
    ("CL", "0"): (-0.372, -0.208, -0.045, 0.116, 0.274, 0.428, 0.577, 0.720, 0.856, 0.981, 1.090, 1.179, 1.243),
    ("CD", "0"): (
        0.0560, 0.0487, 0.0443, 0.0432, 0.0455, 0.0513, 0.0606, 0.0735, 0.0899, 0.1100, 0.1340, 0.1622, 0.1955,
    ),
    ("Cm", "0"): (0.054, 0.026, -0.001, -0.027, -0.053, -0.080, -0.108, -0.138, -0.170, -0.205, -0.243, -0.284, -0.329),
    ("Cl", "beta"): (
        -0.034, -0.040, -0.046, -0.0515, -0.057, -0.0625, -0.068, -0.073, -0.078, -0.083, -0.088, -0.092, -0.096,
    ),
    ("Cl", "p"): (
        -0.465, -0.463, -0.460, -0.456, -0.451, -0.445, -0.438, -0.430, -0.420, -0.408, -0.394, -0.378, -0.360,
    ),
    ("Cn", "beta"): (0.078, 0.077, 0.0755, 0.074, 0.0725, 0.071, 0.069, 0.067, 0.065, 0.0625, 0.060, 0.057, 0.054),
}  # fmt: skip
# Pitching moment over angle of attack (rows: -6, 2, 10, 18 deg) and elevator (-20, -10, 0, 10, 20 deg).
_ELEVATOR = (
    (-20.0, (0.278, 0.293, 0.296, 0.280)),
    (-10.0, (0.146, 0.150, 0.149, 0.139)),
    (0.0, (0.0, 0.0, 0.0, 0.0)),
    (10.0, (-0.147, -0.149, -0.146, -0.134)),
    (20.0, (-0.287, -0.290, -0.281, -0.256)),
)
_LINEAR = {
    "CL_0": 0.1086, "CL_alpha": 4.58, "CL_q": 8.1, "CL_de": 0.0983, "CD_0": 0.0477, "CD_k": 0.0815, "Cm_0": -0.0278,
    "Cm_alpha": -0.723, "Cm_q": -13.5664, "Cm_de": -0.8488, "CY_beta": -0.5349, "CY_p": -0.0375, "CY_r": 0.15,
    "CY_dr": 0.1913, "Cl_beta": -0.0545, "Cl_p": -0.4496, "Cl_r": 0.1086, "Cl_da": -0.1646, "Cl_dr": 0.0115,
    "Cn_beta": 0.0723, "Cn_p": -0.03, "Cn_r": -0.1833, "Cn_da": 0.0174, "Cn_dr": -0.1811,
}  # fmt: skip
_TABULATED = ("CL_0", "CL_alpha", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_de", "Cl_beta", "Cl_p", "Cn_beta")


@dataclass(frozen=True)
class Aircraft:
    """An aircraft in JSBSim: what its vehicle file says, the functions of its six coefficients, and its lags."""

    name: str
    vehicle: Vehicle
    model: Model
    functions: Mapping[str, str]
    lags: tuple[Lag, ...] = ()


@dataclass(frozen=True)
class Flown:
    """One flight without sensor errors, at every TICK, (N,) each.

    true: what ideal sensors at their places read. commands: de, da, dr [rad], throttle, and thrust [N].
    coefficients: CL ... Cn.
    """

    time_s: Array
    true: dict[str, Array]
    commands: dict[str, Array]
    coefficients: dict[str, Array]


def _vehicle() -> Vehicle:
    """The Ultra Stick 25e without its propeller's curves: the thrust given to JSBSim is a force without a torque."""
    vehicle = load_vehicle("ultrastick25e")
    assert vehicle.propulsion is not None
    sensors = replace(
        vehicle.sensors, accelerometer=replace(vehicle.sensors.accelerometer, position=(0.05, -0.01, 0.02))
    )
    return replace(vehicle, sensors=sensors, propulsion=replace(vehicle.propulsion, CT=(), CQ=()))


def _model(names: Mapping[str, float]) -> Model:
    return Model("jsbsim", {name: Coefficient(value) for name, value in names.items()})


def linear_aircraft() -> Aircraft:
    """The aircraft whose aerodynamics have the default structure."""
    vehicle, model = _vehicle(), _model(_LINEAR)
    return Aircraft("linear", vehicle, model, linear_coefficients(vehicle, model))


def drawn_aircraft(number: int) -> Aircraft:
    """The linear aircraft for 0; for others one of its size, with mass, wing, inertia and derivatives drawn."""
    if number == 0:
        return linear_aircraft()
    draw = np.random.default_rng([number, 17]).uniform
    vehicle = _vehicle()
    mass, geometry = vehicle.mass, vehicle.geometry
    heavier, larger = draw(0.85, 1.2), draw(0.95, 1.15)
    span, chord = geometry.b * draw(0.85, 1.2), geometry.c * draw(0.85, 1.2)
    turned = {
        "Ixx": heavier * (span / geometry.b) ** 2 * draw(0.8, 1.25),
        "Iyy": heavier * draw(0.8, 1.25),
    }
    moments = {name: getattr(mass, name) * share for name, share in turned.items()}
    # A flat body turns about the vertical as about both others together, less what stands up.
    moments["Izz"] = draw(0.93, 0.99) * (moments["Ixx"] + moments["Iyy"])
    moments["Ixz"] = mass.Ixz * draw(0.0, 1.5)
    vehicle = replace(
        vehicle,
        name=f"drawn-{number}",
        mass=replace(mass, mass=heavier * mass.mass, **moments),
        geometry=replace(geometry, S=larger * geometry.S, b=span, c=chord),
    )
    model = _model({name: value * draw(0.7, 1.35) for name, value in _LINEAR.items()})
    return Aircraft(vehicle.name, vehicle, model, linear_coefficients(vehicle, model))


def table_aircraft() -> Aircraft:
    """The aircraft whose aerodynamics are tables, as a wind tunnel or a panel code gives them."""
    vehicle = _vehicle()
    rest = _model({name: value for name, value in _LINEAR.items() if name not in _TABULATED})
    functions = {}
    for axis in AXES:
        terms = [
            product(f"<value>{value!r}</value>", *(regressor(f, vehicle) for f in parse_term(name).factors))
            for name, value in rest.values().items()
            if parse_term(name).axis == axis
        ]
        for (of, factor), values in _TABLES.items():
            if of == axis:
                table = _table(values)
                terms.append(table if factor == "0" else product(table, regressor(factor, vehicle)))
        if axis == "Cm":
            terms.append(_elevator_table())
        functions[axis] = function(axis, terms)
    return Aircraft("tables", vehicle, rest, functions)


def _table(values: tuple[float, ...]) -> str:
    """Table over angle of attack in fine steps, smooth through the values given."""
    smooth = CubicSpline(_DEGREES, values)
    rows = "\n".join(f"{float(np.radians(a))!r} {float(smooth(a))!r}" for a in _FINE)
    return f"<table><independentVar>aero/alpha-rad</independentVar><tableData>\n{rows}\n</tableData></table>"


def _elevator_table() -> str:
    """Table over angle of attack and elevator, smooth through the values given."""
    elevator = np.array([de for de, _ in _ELEVATOR])
    smooth = RectBivariateSpline(np.array([-6.0, 2.0, 10.0, 18.0]), elevator, np.array([v for _, v in _ELEVATOR]).T)
    wide = np.arange(elevator[0], elevator[-1] + 0.5, 1.0)
    columns = " ".join(repr(float(np.radians(de))) for de in wide)
    rows = "\n".join(
        f"{float(np.radians(a))!r} " + " ".join(repr(float(smooth(a, de)[0, 0])) for de in wide) for a in _FINE
    )
    return (
        '<table><independentVar lookup="row">aero/alpha-rad</independentVar>'
        '<independentVar lookup="column">fcs/elevator-pos-rad</independentVar>'
        f"<tableData>\n{columns}\n{rows}\n</tableData></table>"
    )


def multisine(times: Array, size: float, first: int, generator: np.random.Generator) -> Array:
    """Sum of sines at every third harmonic of 1/20 s from 0.1 to 2 Hz, with the least peaked of some random phases."""
    harmonics = np.arange(2 + first, 41, 3)
    waves = []
    for _ in range(40):
        angles = 2.0 * np.pi * np.outer(times / 20.0, harmonics) + generator.uniform(0.0, 2.0 * np.pi, harmonics.size)
        wave = np.sin(angles).sum(axis=1)
        waves.append(wave / np.abs(wave).max())
    ramp = np.clip((times - 1.0) / 1.0, 0.0, 1.0)
    return size * ramp * waves[int(np.argmax([wave.std() for wave in waves]))]


def fly(
    folder: Path,
    aircraft: Aircraft,
    seed: int,
    seconds: float = SECONDS,
    density: float | None = None,
    resolution: float = 0.0,
    named: Callable[[Array, np.random.Generator], Mapping[str, Array]] = lambda times, generator: {},
) -> Flown:
    """Trim and fly one flight in JSBSim; the multisines' phases and sizes come from the seed.

    density: kg/m^3, None for JSBSim's standard atmosphere. resolution: step of the commands, rad, 0 for none.
    named: what controls of their own names do, 0 where the flight is trimmed, at the times (N,) given.
    """
    write_twin(folder, aircraft.vehicle, aircraft.model, aircraft.functions, aircraft.lags)
    generator = np.random.default_rng([seed, 1])
    times = np.arange(round(seconds / TICK) + 1) * TICK
    alpha, de, thrust = _trim(folder, aircraft.lags, density)
    size = generator.uniform(0.8, 1.2, 4)
    slow = np.clip(times, 0.0, 1.0) * np.sin(2.0 * np.pi * times / 13.0 + generator.uniform(0.0, 2.0 * np.pi))
    given = {
        "de": de + multisine(times, 0.07 * size[0], 0, generator),
        "da": multisine(times, 0.05 * size[1], 1, generator),
        "dr": multisine(times, 0.06 * size[2], 2, generator),
        "throttle": thrust / FULL_THRUST * (1.0 + 0.35 * size[3] * slow),
        **named(times, generator),
    }
    twin = load_twin(folder, _start(alpha), STEP, density)
    set_inputs(twin, np.array([de, 0.0, 0.0]), thrust)
    settle(twin, aircraft.lags)
    assert twin.run_ic()
    before = now = _ideal(twin, aircraft.vehicle)
    rows, flown = [], []
    pull, block = thrust, TICK / BLOCKS
    for i in range(times.size):
        # JSBSim's multi-step integrators act on a new command half a step late; that is when the sensors read.
        rows.append({name: now[name] + 0.5 * _difference(name, now[name], before[name]) for name in now})
        command = {name: float(values[i]) for name, values in given.items()}
        # A weak hold of bank and pitch keeps the flight where the sensors work; it acts on what was read just before.
        command["da"] += 0.06 * rows[-1]["phi"]
        command["de"] += 0.10 * (rows[-1]["theta"] - alpha)
        if resolution:
            command = {name: round(value / resolution) * resolution for name, value in command.items()}
        flown.append({**command, "thrust": pull})
        for part in range(BLOCKS):
            # A motor that follows the throttle with a lag of the first order; its mean over the block acts.
            gap, left = pull - FULL_THRUST * command["throttle"], float(np.exp(-block / MOTOR_LAG))
            pull -= gap * (1.0 - left)
            mean = FULL_THRUST * command["throttle"] + gap * (1.0 - left) * MOTOR_LAG / block
            set_inputs(twin, np.array([command[name] for name in ("de", "da", "dr")]), mean)
            for control in aircraft.vehicle.named_controls:
                twin.set_property_value(named_property(control), command[control])
            for step in range(STEPS):
                twin.run()
                if part == BLOCKS - 1 and step == STEPS - 2:
                    before = _ideal(twin, aircraft.vehicle)
        now = _ideal(twin, aircraft.vehicle)
    true = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    coefficients = {axis: true.pop(axis) for axis in AXES}
    return Flown(times, true, {name: np.array([one[name] for one in flown]) for name in flown[0]}, coefficients)


def _difference(name: str, now: float, before: float) -> float:
    """now - before, the shorter way round for a heading."""
    return float(np.angle(np.exp(1j * (now - before)))) if name == "psi" else now - before


def _start(alpha: float) -> Array:
    start = np.zeros(12)
    start[2], start[3], start[5], start[7] = -HEIGHT, AIRSPEED * np.cos(alpha), AIRSPEED * np.sin(alpha), alpha
    return start


def _trim(folder: Path, lags: Sequence[Lag], density: float | None) -> tuple[float, float, float]:
    """Angle of attack, elevator (rad) and thrust (N) of level flight, by JSBSim's own accelerations."""

    def accelerations(unknown: Array) -> Array:
        twin = load_twin(folder, _start(float(unknown[0])), STEP, density)
        set_inputs(twin, np.array([unknown[1], 0.0, 0.0]), float(unknown[2]))
        settle(twin, lags)
        assert twin.run_ic()
        get = twin.get_property_value
        u, w = (get(f"accelerations/{name}dot-ft_sec2") * FT for name in "uw")
        return np.array([u, w, get("accelerations/qdot-rad_sec2")])

    found = optimize.root(accelerations, np.array([0.08, -0.05, 3.0]), tol=1e-9)
    assert np.abs(accelerations(found.x)).max() < 1e-3, found
    return float(found.x[0]), float(found.x[1]), float(found.x[2])


def _ideal(twin: object, vehicle: Vehicle) -> dict[str, float]:
    """What sensors without errors read at their places, and the six coefficients."""
    get = twin.get_property_value  # type: ignore[attr-defined]
    v = {name: get(f"velocities/{name}-fps") * FT for name in "uvw"}
    rates = np.array([get(f"velocities/{name}-rad_sec") for name in "pqr"])
    turn = np.array([get(f"accelerations/{name}dot-rad_sec2") for name in "pqr"])
    force = np.array([get(f"forces/fb{x}-aero-lbs") + get(f"forces/fb{x}-external-lbs") for x in "xyz"])
    arm = np.array(vehicle.sensors.accelerometer.position)
    specific = (
        force * NEWTON_PER_POUND_FORCE / vehicle.mass.mass + np.cross(turn, arm) + np.cross(rates, np.cross(rates, arm))
    )
    speed = float(np.sqrt(sum(x * x for x in v.values())))
    p, q, r = rates
    vane, flank = vehicle.sensors.alpha_vane.position, vehicle.sensors.beta_vane.position
    density = get("atmosphere/rho-slugs_ft3") * SLUG / FT**3
    return {
        **dict(zip(("ax", "ay", "az"), specific.tolist(), strict=True)),
        **dict(zip("pqr", rates.tolist(), strict=True)),
        "alpha": float(np.arctan2(v["w"], v["u"])) - vane[0] * q / speed + vane[1] * p / speed,
        "beta": float(np.arcsin(v["v"] / speed)) + flank[0] * r / speed - flank[2] * p / speed,
        "airspeed": speed * float(np.sqrt(density / 1.225)),
        **{name: get(f"attitude/{name}-rad") for name in ("phi", "theta", "psi")},
        "vn": get("velocities/v-north-fps") * FT,
        "ve": get("velocities/v-east-fps") * FT,
        "vd": get("velocities/v-down-fps") * FT,
        "air_density": density,
        "true_airspeed": speed,
        "true_alpha": float(np.arctan2(v["w"], v["u"])),
        "true_beta": float(np.arcsin(v["v"] / speed)),
        **{axis: get(f"aero/twin/{axis}") for axis in AXES},
    }


def measure(flown: Flown, seed: int, name: str) -> tuple[FlightSignals, dict[str, float]]:
    """The flight as sensors of Table II tell it, and their hidden biases (uniform in the table's range)."""
    generator = np.random.default_rng([seed, 2])
    signals, hidden = {}, {}
    for key, (noise, largest, step) in NOISE.items():
        true = flown.commands["thrust"] if key == "thrust" else flown.true[key]
        bias = float(generator.uniform(-largest, largest))
        scale = float(generator.uniform(-VANE_SCALE, VANE_SCALE)) if key in ("alpha", "beta") else 0.0
        read = (1.0 + scale) * true + bias + noise * generator.standard_normal(true.size)
        read = np.round(read / step) * step if step else read
        hidden |= {f"{key}_bias": bias, f"{key}_scale": scale}
        every = 10 if key in ("vn", "ve", "vd") else 1
        signals[key] = Signal(flown.time_s[::every], read[::every], "SI", "JSBSim")
    signals["air_density"] = Signal(flown.time_s, flown.true["air_density"], "kg/m^3", "JSBSim")
    for key in (name for name in flown.commands if name != "thrust"):
        signals[key] = Signal(flown.time_s, flown.commands[key], "rad", "JSBSim")
    return FlightSignals(name, signals), hidden


def regressors(flown: Flown, vehicle: Vehicle) -> dict[str, Array]:
    """(N - 1,) of every regressor of coefficient names along the true motion, from the second sample on.

    What acts at a sample is the command of the one before.
    """
    true, g = {name: values[1:] for name, values in flown.true.items()}, vehicle.geometry
    V = true["true_airspeed"]
    return {
        "alpha": true["true_alpha"],
        "beta": true["true_beta"],
        "p": true["p"] * g.b / (2.0 * V),
        "q": true["q"] * g.c / (2.0 * V),
        "r": true["r"] * g.b / (2.0 * V),
        "CL": flown.coefficients["CL"][1:],
        **{name: flown.commands[name][:-1] for name in ("de", "da", "dr")},
    }


def slopes(flown: Flown, vehicle: Vehicle, structure: tuple[str, ...]) -> dict[str, float]:
    """The structure's coefficients that come nearest to JSBSim's own six coefficients over the flight.

    Least squares without noise along the true motion: the local slopes of the tables, each angle of attack counting as
    often as it was flown. For aerodynamics within the structure these are its coefficients.
    """
    along = regressors(flown, vehicle)
    ones = np.ones(flown.time_s.size - 1)
    found = {}
    for axis in AXES:
        names = [name for name in structure if parse_term(name).axis == axis]
        X = np.stack([np.prod([along[f] for f in parse_term(n).factors] or [ones], axis=0) for n in names], axis=1)
        values = np.linalg.lstsq(X, flown.coefficients[axis][1:], rcond=None)[0]
        found |= dict(zip(names, values.tolist(), strict=True))
    return found

"""An aircraft in JSBSim as the field flies it: servos that are late and loose, moving air, an autopilot or a hand.

Everything is logged at JSBSim's own step. After a step, motion, forces and surfaces belong to the same instant, so that
nothing is late but what a knob makes late; all knobs at 0 are the textbook's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from field_air import Air, air_motion
from jsbsim_flight import AIRSPEED, FULL_THRUST, HEIGHT, MOTOR_LAG, Aircraft
from jsbsim_twin import AXES, FT, NEWTON_PER_POUND_FORCE, SLUG, Array, Lag, load_twin, set_inputs, settle, write_twin
from scipy import linalg, optimize

from sim_vehicle.vehicle.mass_properties import Geometry
from sim_vehicle.vehicle.vehicle_file import Vehicle

STEP = 0.004  # s, of JSBSim and of the log
SURFACES = ("de", "da", "dr")
SERVO_DAMPING, SERVO_FREQUENCY = 0.8, 1.6  # natural frequency is the second, over the lag, which is then its delay
ROLLING_GUST = "field/p-gust-rad_sec"
FORCES = ("aero", "prop", "external")
READ = {
    **{f"{x}_air": (f"velocities/{x}-aero-fps", FT) for x in "uvw"},
    **{x: (f"velocities/{x}-rad_sec", 1.0) for x in "pqr"},
    **{f"{x}dot": (f"accelerations/{x}dot-rad_sec2", 1.0) for x in "pqr"},
    **{f"{x}_{of}": (f"forces/fb{x}-{of}-lbs", NEWTON_PER_POUND_FORCE) for of in FORCES for x in "xyz"},
    **{f"{x}_aero_moment": (f"moments/{x}-aero-lbsft", NEWTON_PER_POUND_FORCE * FT) for x in "lmn"},
    **{x: (f"attitude/{x}-rad", 1.0) for x in ("phi", "theta", "psi")},
    **{f"v{x[0]}": (f"velocities/v-{x}-fps", FT) for x in ("north", "east", "down")},
    "air_density": ("atmosphere/rho-slugs_ft3", SLUG / FT**3),
    "height": ("position/h-sl-ft", FT),
}


@dataclass(frozen=True)
class Servo:
    """A servo of the second order.

    delay: s, pure. lag: s, of a slow ramp. backlash: rad, half of the play. rate_limit: rad/s, 0 for none. droop: share
    of a deflection by which the air bends servo and linkage back at the airspeed of trim.
    """

    delay: float = 0.0
    lag: float = 0.0
    backlash: float = 0.0
    rate_limit: float = 0.0
    droop: float = 0.0


@dataclass(frozen=True)
class Hold:
    """What an autopilot or a pilot feeds back, rad per rad and rad per rad/s; `hz` is how often it sends."""

    bank: float = 0.06
    pitch: float = 0.10
    roll_rate: float = 0.0
    pitch_rate: float = 0.0
    yaw_rate: float = 0.0
    hz: float = 250.0


@dataclass(frozen=True)
class Inputs:
    """(N,) each, at every STEP: surfaces about their trim, rad; throttle's share of its trim; attitudes to hold."""

    surfaces: Mapping[str, Array]
    throttle: Array
    bank: Array
    pitch: Array


@dataclass(frozen=True)
class Log:
    """A flight at every STEP, (N,) each, SI. Names: see `log_of`; `sent_de` ... `sent_throttle` are what was sent."""

    time_s: Array
    columns: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]


class ServoMotion:
    """A servo's position, moved on one STEP at a time."""

    def __init__(self, servo: Servo, start: float) -> None:
        self.servo, self.position, self.rate, self.out = servo, start, 0.0, start
        self.sent = [start] * round(servo.delay / STEP)
        if servo.lag:
            w = SERVO_FREQUENCY / servo.lag
            system = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * SERVO_DAMPING * w, w * w], [0.0, 0.0, 0.0]])
            self.step: list[list[float]] = linalg.expm(system * STEP)[:2].tolist()

    def move(self, command: float) -> float:
        """Position, rad, after one step under the command sent now."""
        self.sent.append(command)
        late = self.sent.pop(0)
        if self.servo.lag:
            # An exact step of the linear servo under a held command.
            (a, b, c), (d, e, f) = self.step
            before = self.position
            self.position, self.rate = (
                a * before + b * self.rate + c * late,
                d * before + e * self.rate + f * late,
            )
            most = self.servo.rate_limit * STEP
            if most and abs(self.position - before) > most:
                self.position = before + math.copysign(most, self.position - before)
                self.rate = math.copysign(self.servo.rate_limit, self.rate)
        else:
            self.position = late
        play = self.servo.backlash
        self.out = min(max(self.out, self.position - play), self.position + play)
        return self.out


def rolling_aircraft(aircraft: Aircraft) -> Aircraft:
    """The aircraft whose aerodynamics turn against the air's own rolling, a property to be set."""
    rate = "<property>velocities/p-rad_sec</property>"
    against = f"<difference>{rate}<property>{ROLLING_GUST}</property></difference>"
    functions = {axis: text.replace(rate, against) for axis, text in aircraft.functions.items()}
    held = Lag(ROLLING_GUST, f"<property>{ROLLING_GUST}</property>", ROLLING_GUST, 0.0)
    return replace(aircraft, functions=functions, lags=(*aircraft.lags, held))


def trim(accelerations: Callable[[Array], Array], start: Array) -> Array:
    """What makes the accelerations vanish."""
    found = optimize.root(accelerations, start, tol=1e-9)
    assert np.abs(accelerations(found.x)).max() < 1e-3, found
    return np.asarray(found.x, dtype=np.float64)


def fly_field(
    folder: Path,
    aircraft: Aircraft,
    inputs: Inputs,
    seed: int,
    *,
    servo: Servo | None = None,
    air: Air | None = None,
    hold: Hold | None = None,
    density: float = 1.12,
    resolution: float = 0.0,
    breaks: Callable[[float, Any, Array], Array] | None = None,
) -> Log:
    """Trim and fly one of our own aircraft. resolution: step of the commands sent, rad. breaks: by the time, s, changes
    JSBSim's properties and gives where the surfaces stand instead of where they would.
    """
    servo, air, hold = servo or Servo(), air or Air(), hold or Hold()
    rolling = rolling_aircraft(aircraft)
    write_twin(folder, rolling.vehicle, rolling.model, rolling.functions, rolling.lags)

    def begin(unknown: Array) -> Any:
        start = np.zeros(12)
        alpha = float(unknown[0])
        start[2], start[3], start[5], start[7] = -HEIGHT, AIRSPEED * np.cos(alpha), AIRSPEED * np.sin(alpha), alpha
        twin = load_twin(folder, start, STEP, density)
        set_inputs(twin, np.array([unknown[1], 0.0, 0.0]), float(unknown[2]))
        settle(twin, rolling.lags)
        assert twin.run_ic()
        return twin

    def accelerations(unknown: Array) -> Array:
        get = begin(unknown).get_property_value
        u, w = (get(f"accelerations/{name}dot-ft_sec2") * FT for name in "uw")
        return np.array([u, w, get("accelerations/qdot-rad_sec2")])

    found = trim(accelerations, np.array([0.08, -0.05, 3.0]))
    twin = begin(found)
    alpha, de, thrust = (float(x) for x in found)
    wind = air_motion(air, inputs.throttle.size, STEP, AIRSPEED, aircraft.vehicle.geometry.b, seed)
    servos = {"de": ServoMotion(servo, de), "da": ServoMotion(servo, 0.0), "dr": ServoMotion(servo, 0.0)}
    every, left = max(1, round(1.0 / (hold.hz * STEP))), math.exp(-STEP / MOTOR_LAG)
    rows, other = [read(twin)], [(de, 0.0, 0.0, thrust, de, 0.0, 0.0, thrust / FULL_THRUST, 0.0)]
    index = {name: i for i, name in enumerate(READ)}
    pull, sent = thrust, dict.fromkeys(SURFACES, 0.0)
    throttle = thrust / FULL_THRUST
    for i in range(1, inputs.throttle.size):
        now = rows[-1]
        phi, theta, psi, p, q, r = (now[index[x]] for x in ("phi", "theta", "psi", "p", "q", "r"))
        if (i - 1) % every == 0:
            # Signs of both aircraft: a positive aileron rolls left, elevator pitches down, rudder yaws left.
            sent = {
                "de": de
                + float(inputs.surfaces["de"][i])
                + hold.pitch * (theta - alpha - float(inputs.pitch[i]))
                + hold.pitch_rate * q,
                "da": float(inputs.surfaces["da"][i]) + hold.bank * (phi - float(inputs.bank[i])) + hold.roll_rate * p,
                "dr": float(inputs.surfaces["dr"][i]) + hold.yaw_rate * r,
            }
            if resolution:
                sent = {name: round(value / resolution) * resolution for name, value in sent.items()}
            throttle = min(max(thrust / FULL_THRUST * (1.0 + float(inputs.throttle[i])), 0.0), 1.0)
        moved = np.array([servos[name].move(sent[name]) for name in SURFACES])
        if servo.droop:
            u, v, w = (now[index[f"{x}_air"]] for x in "uvw")
            neutral = np.array([de, 0.0, 0.0])
            moved = neutral + (moved - neutral) * (1.0 - servo.droop * (u * u + v * v + w * w) / AIRSPEED**2)
        if breaks is not None:
            moved = breaks(i * STEP, twin, moved)
        pull = FULL_THRUST * throttle + (pull - FULL_THRUST * throttle) * left
        set_inputs(twin, moved, pull)
        blow(twin, wind.body[i], wind.down[i], (phi, theta, psi))
        twin.set_property_value(ROLLING_GUST, float(wind.rolling[i]))
        twin.run()
        rows.append(read(twin))
        other.append((*moved.tolist(), pull, *(sent[name] for name in SURFACES), throttle, float(wind.rolling[i])))
    names = (*SURFACES, "thrust", *(f"sent_{name}" for name in SURFACES), "sent_throttle", "p_gust")
    log = log_of(rows, dict(zip(names, np.array(other).T, strict=True)), aircraft.vehicle)
    # A wind that is the same everywhere and always moves the whole flight, and nothing in it.
    carried = {name: log[name] + speed for name, speed in zip(("vn", "ve"), wind.steady, strict=True)}
    return Log(log.time_s, {**log.columns, **carried})


def blow(twin: Any, body: Array, down: float, attitude: tuple[float, float, float]) -> None:
    """Set the gust: velocity of the air, m/s, in body axes, and an updraught (down, m/s)."""
    sp, cp = math.sin(attitude[0]), math.cos(attitude[0])
    st, ct = math.sin(attitude[1]), math.cos(attitude[1])
    sy, cy = math.sin(attitude[2]), math.cos(attitude[2])
    u, v, w = (float(x) for x in body)
    n = ct * cy * u + (sp * st * cy - cp * sy) * v + (cp * st * cy + sp * sy) * w
    e = ct * sy * u + (sp * st * sy + cp * cy) * v + (cp * st * sy - sp * cy) * w
    d = -st * u + sp * ct * v + cp * ct * w + down
    for name, value in (("north", n), ("east", e), ("down", d)):
        twin.set_property_value(f"atmosphere/gust-{name}-fps", value / FT)


def read(twin: Any) -> list[float]:
    """Everything of READ now, SI."""
    get = twin.get_property_value
    return [get(name) * scale for name, scale in READ.values()]


def log_of(rows: list[list[float]], other: Mapping[str, Array], vehicle: Vehicle) -> Log:
    """The log, with V, alpha, beta, specific force fx fy fz at the centre of gravity, and CL ... Cn."""
    raw = dict(zip(READ, np.array(rows).T, strict=True))
    raw["psi"] = np.unwrap(raw["psi"])
    raw["V"] = np.sqrt(raw["u_air"] ** 2 + raw["v_air"] ** 2 + raw["w_air"] ** 2)
    raw["alpha"] = np.arctan2(raw["w_air"], raw["u_air"])
    raw["beta"] = np.arcsin(raw["v_air"] / raw["V"])
    for x in "xyz":
        raw[f"f{x}"] = sum((raw[f"{x}_{of}"] for of in FORCES), np.zeros(len(rows))) / vehicle.mass.mass
    times = np.arange(len(rows)) * STEP
    return Log(times, {**raw, **coefficients(raw, vehicle.geometry), **other})


def coefficients(raw: Mapping[str, Array], geometry: Geometry) -> dict[str, Array]:
    """The six coefficients of the aerodynamic forces and moments."""
    qS = 0.5 * raw["air_density"] * raw["V"] ** 2 * geometry.S
    sin, cos = np.sin(raw["alpha"]), np.cos(raw["alpha"])
    X, Y, Z = (raw[f"{x}_aero"] for x in "xyz")
    values = (
        (X * sin - Z * cos) / qS,
        -(X * cos + Z * sin) / qS,
        Y / qS,
        raw["l_aero_moment"] / (qS * geometry.b),
        raw["m_aero_moment"] / (qS * geometry.c),
        raw["n_aero_moment"] / (qS * geometry.b),
    )
    return dict(zip(AXES, values, strict=True))

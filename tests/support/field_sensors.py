"""Sensors and links as the field has them: a flight's log as signals, each group on its own stamps.

Every error is a knob of its own and 0 by default, which is the textbook's sensor; each draws its noise from its own
generator, so that turning one changes nothing else.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from field_air import slow_noise
from field_filters import first_order, low_pass, low_pass_gain, play, vane
from field_plant import STEP, SURFACES, Log
from jsbsim_twin import Array
from scipy.interpolate import CubicSpline

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals, Signal

FORCE, RATES, ANGLES, GPS = ("ax", "ay", "az"), ("p", "q", "r"), ("phi", "theta", "psi"), ("vn", "ve", "vd")
G = 9.80665
VANE_SPEED = 17.0  # m/s, at which a vane's natural frequency is the knob's
DRIFT = 60.0  # s, correlation of a gyro's and an accelerometer's drift
FULL_SCALE = 0.01  # share of a line's amplitude that reaches a gyro, rad/s per m/s^2


@dataclass(frozen=True)
class Field:
    """Knobs of sensors and links; times in s, angles in rad, the rest SI; sizes are standard deviations unless said.

    *_hz: rates of the messages. *_offset: stamp less the time of what it stamps. phases: whether groups begin at
    times of their own. jitter: of stamps. bursts: losses of the whole link a minute, each burst_s at most.
    filter_hz: IMU's anti-alias filter of the second order, 0 for none. vibration: m/s^2, of the first of two lines at
    line_hz and 2.1 times it. cross_axis: rad. g_sensitivity: rad/s per m/s^2. attitude_*: errors of the filter that
    tells the attitude: correlated over attitude_correlation, late by attitude_lag, and leaning by a share of the turn.
    vane_hz_natural: at VANE_SPEED, in proportion to airspeed, 0 for an ideal vane; vane_scale (upwash) and
    vane_friction (half of the play) as they are. position_error: share of airspeed per rad of alpha. airspeed_scale as
    it is; pneumatic_lag. airspeed_coloured: noise that is correlated over 0.3 s. gps_delay: age of what GPS tells.
    positions: whether a control's signal is where the surface is, rather than what was sent. pulse: rad of one
    microsecond. thrust_scale as it is. dead: signals that stay at one value; zeros: signals that are 0 throughout.
    suite: seed of the sensors' constant errors, None for that of the flight.
    """

    suite: int | None = None
    imu_hz: float = 50.0
    vane_hz: float = 50.0
    airspeed_hz: float = 50.0
    attitude_hz: float = 50.0
    command_hz: float = 50.0
    thrust_hz: float = 50.0
    gps_hz: float = 5.0
    imu_offset: float = 0.0
    vane_offset: float = 0.0
    airspeed_offset: float = 0.0
    attitude_offset: float = 0.0
    command_offset: float = 0.0
    phases: bool = False
    jitter: float = 0.0
    bursts: float = 0.0
    burst_s: float = 1.0
    filter_hz: float = 0.0
    vibration: float = 0.0
    line_hz: float = 87.0
    force_noise: float = 0.0
    force_bias: float = 0.0
    force_drift: float = 0.0
    rate_noise: float = 0.0
    rate_bias: float = 0.0
    rate_drift: float = 0.0
    cross_axis: float = 0.0
    g_sensitivity: float = 0.0
    attitude_noise: float = 0.0
    attitude_error: float = 0.0
    attitude_correlation: float = 10.0
    attitude_lag: float = 0.0
    attitude_lean: float = 0.0
    vane_hz_natural: float = 0.0
    vane_damping: float = 0.3
    vane_scale: float = 0.0
    vane_bias: float = 0.0
    vane_friction: float = 0.0
    vane_noise: float = 0.0
    airspeed_scale: float = 0.0
    position_error: float = 0.0
    pneumatic_lag: float = 0.0
    airspeed_noise: float = 0.0
    airspeed_coloured: float = 0.0
    gps_delay: float = 0.0
    gps_noise: float = 0.0
    positions: bool = False
    pulse: float = 0.0
    thrust_scale: float = 0.0
    thrust_noise: float = 0.0
    dead: tuple[str, ...] = ()
    zeros: tuple[str, ...] = ()


def noise_of(seed: int, name: str) -> np.random.Generator:
    """A generator of one knob's own."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def sense(log: Log, vehicle: Vehicle, field: Field, seed: int, name: str) -> FlightSignals:
    """The flight as sensors at the vehicle's places tell it."""
    f = field
    groups: list[tuple[str, float, float, float, dict[str, Array]]] = [
        ("imu", f.imu_hz, f.imu_offset, 0.0, _imu(log, vehicle, f, seed)),
        ("vane", f.vane_hz, f.vane_offset, f.vane_noise, _vanes(log, vehicle, f, seed)),
        ("airspeed", f.airspeed_hz, f.airspeed_offset, f.airspeed_noise, {"airspeed": _airspeed(log, f, seed)}),
        ("attitude", f.attitude_hz, f.attitude_offset, f.attitude_noise, _attitude(log, f, seed)),
        ("thrust", f.thrust_hz, 0.0, f.thrust_noise, {"thrust": log["thrust"] * (1.0 + f.thrust_scale)}),
        ("gps", f.gps_hz, f.gps_delay, f.gps_noise, {x: log[x] for x in GPS}),
        ("command", f.command_hz, f.command_offset, 0.0, {}),
    ]
    lost = _bursts(log.time_s[-1], f, seed)
    signals: dict[str, Signal] = {}
    for group, hz, offset, noise, true in groups:
        taken, stamps = _times(log.time_s[-1], hz, f, seed, group)
        kept = ~np.any([(stamps >= a) & (stamps < b) for a, b in lost], axis=0) if lost else np.ones(stamps.size, bool)
        taken, stamps = taken[kept], stamps[kept] + offset
        if group == "command":
            signals |= _controls(log, f, taken, stamps)
            continue
        for key, values in true.items():
            read = CubicSpline(log.time_s, values)(taken)
            if group == "imu":
                read += _lines(f, key, taken, seed)
                noise = f.force_noise if key in FORCE else f.rate_noise
            read += noise * noise_of(seed, f"noise {key}").standard_normal(taken.size)
            signals[key] = Signal(stamps, read, "SI", "JSBSim")
    air = signals["airspeed"].time_s
    signals["air_density"] = Signal(air, np.interp(air, log.time_s, log["air_density"]), "kg/m^3", "JSBSim")
    for key in (*f.dead, *f.zeros):
        still = np.full(signals[key].values.size, 0.0 if key in f.zeros else signals[key].values[0])
        signals[key] = Signal(signals[key].time_s, still, "SI", "JSBSim")
    return FlightSignals(name, signals)


def _times(end: float, hz: float, f: Field, seed: int, group: str) -> tuple[Array, Array]:
    """When a group is read, s, and what its stamps would say without an offset."""
    generator = noise_of(seed, f"times {group}")
    phase = generator.uniform(0.0, 1.0) / hz if f.phases else 0.0
    taken = np.arange(phase, end + 1e-9, 1.0 / hz)
    stamps = taken + f.jitter * generator.standard_normal(taken.size)
    return taken, np.maximum.accumulate(stamps)


def _bursts(end: float, f: Field, seed: int) -> list[tuple[float, float]]:
    generator = noise_of(seed, "bursts")
    starts = generator.uniform(2.0, max(end - 2.0, 2.1), generator.poisson(f.bursts * end / 60.0))
    return [(float(at), float(at + generator.uniform(0.2 * f.burst_s, f.burst_s))) for at in starts]


def _imu(log: Log, vehicle: Vehicle, f: Field, seed: int) -> dict[str, Array]:
    """(N,) each before sampling: at its place, crossed, filtered, with bias and drift."""
    arm = np.array(vehicle.sensors.accelerometer.position)
    rates = np.stack([log[x] for x in RATES], axis=1)
    turn = np.stack([log[f"{x}dot"] for x in RATES], axis=1)
    force = np.stack([log[f"f{x}"] for x in "xyz"], axis=1)
    force = force + np.cross(turn, arm) + np.cross(rates, np.cross(rates, arm))
    read = {}
    for names, values, kind in ((FORCE, force, "force"), (RATES, rates, "rate")):
        bias, drift = (f.force_bias, f.force_drift) if kind == "force" else (f.rate_bias, f.rate_drift)
        tilt = f.cross_axis * noise_of(seed, f"cross {kind}").standard_normal(3)
        crossed = values + np.cross(np.broadcast_to(tilt, values.shape), values)
        if kind == "rate":
            crossed = crossed + force @ (f.g_sensitivity * noise_of(seed, "g").standard_normal((3, 3))).T
        for i, name in enumerate(names):
            filtered = low_pass(crossed[:, i], f.filter_hz) if f.filter_hz else crossed[:, i]
            own = noise_of(seed if f.suite is None else f.suite, f"bias {name}")
            constant, wander = bias * own.standard_normal(), slow_noise(log.time_s.size, STEP, DRIFT, own)
            read[name] = filtered + constant + drift * wander
    return read


def _lines(f: Field, key: str, taken: Array, seed: int) -> Array:
    """Vibration as it is sampled: what the filter leaves of it comes out at whatever frequency it is folded to."""
    own = noise_of(seed, f"lines {key}")
    found = np.zeros(taken.size)
    for order, share in ((1.0, 1.0), (2.1, 0.4)):
        hz, phase = f.line_hz * order, own.uniform(0.0, 2.0 * np.pi)
        gain = low_pass_gain(hz, f.filter_hz) if f.filter_hz else 1.0
        # A motor's speed is never quite still.
        wander = 1.5 * slow_noise(taken.size, max(float(np.median(np.diff(taken))), 1e-3), 3.0, own)
        found += share * gain * np.sin(2.0 * np.pi * hz * taken + phase + wander)
    return f.vibration * (1.0 if key in FORCE else FULL_SCALE) * found


def _vanes(log: Log, vehicle: Vehicle, f: Field, seed: int) -> dict[str, Array]:
    at, flank, V = vehicle.sensors.alpha_vane.position, vehicle.sensors.beta_vane.position, log["V"]
    flow = {
        "alpha": log["alpha"] - at[0] * log["q"] / V + at[1] * log["p"] / V,
        "beta": log["beta"] + flank[0] * log["r"] / V - flank[2] * log["p"] / V,
    }
    read = {}
    for name, angle in flow.items():
        # The body's upwash acts on the vane, half as much to the side.
        angle = angle * (1.0 + f.vane_scale * (1.0 if name == "alpha" else 0.5))
        if f.vane_hz_natural:
            angle = vane(angle, 2.0 * np.pi * f.vane_hz_natural * V / VANE_SPEED, f.vane_damping)
        if f.vane_friction:
            angle = play(angle, f.vane_friction)
        read[name] = (
            angle + f.vane_bias * noise_of(seed if f.suite is None else f.suite, f"bias {name}").standard_normal()
        )
    return read


def _airspeed(log: Log, f: Field, seed: int) -> Array:
    """Calibrated airspeed."""
    alpha = log["alpha"] - np.mean(log["alpha"])
    speed = log["V"] * np.sqrt(log["air_density"] / 1.225) * (1.0 + f.airspeed_scale) * (1.0 + f.position_error * alpha)
    if f.pneumatic_lag:
        speed = first_order(speed, f.pneumatic_lag)
    return np.asarray(speed + f.airspeed_coloured * slow_noise(speed.size, STEP, 0.3, noise_of(seed, "coloured")))


def _attitude(log: Log, f: Field, seed: int) -> dict[str, Array]:
    turn = first_order(np.arctan2(log["V"] * log["r"], G), 5.0)
    read = {}
    for name in ANGLES:
        late = np.interp(log.time_s - f.attitude_lag, log.time_s, log[name]) if f.attitude_lag else log[name]
        error = slow_noise(log.time_s.size, STEP, f.attitude_correlation, noise_of(seed, f"attitude {name}"))
        # A filter that takes specific force for gravity leans towards level in a turn; a compass is worse than gravity.
        lean = -f.attitude_lean * turn if name == "phi" else 0.0
        read[name] = late + f.attitude_error * (3.0 if name == "psi" else 1.0) * error + lean
    return read


def _controls(log: Log, f: Field, taken: Array, stamps: Array) -> dict[str, Signal]:
    """What was sent last when the message was made, or where the surface was."""
    held = np.floor(taken / STEP + 1e-6).astype(int)
    reading: Callable[[str], Array]
    if f.positions:
        reading = lambda key: np.asarray(np.interp(taken, log.time_s, log[key]))  # noqa: E731
    else:
        reading = lambda key: log[f"sent_{key}"][held]  # noqa: E731
    found = {}
    for key in (*SURFACES, "throttle"):
        values = log["sent_throttle"][held] if key == "throttle" else reading(key)
        pulse = (0.001 if key == "throttle" else f.pulse) if f.pulse else 0.0
        values = np.round(values / pulse) * pulse if pulse else values
        found[key] = Signal(stamps, values, "rad", "JSBSim")
    return found

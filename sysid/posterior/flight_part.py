"""One part of a flight as the estimator takes it: inputs, imposed motion, outputs, each with its own stamps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS, control_of
from sim_vehicle.vehicle.motors import motor_loads
from sim_vehicle.vehicle.sensors import Sensors
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.posterior.inputs import LOOP_INTERVAL_S, InputSignal, in_steps, input_signal, surface_signal
from sysid.posterior.observations import Channel, CommonGrid, bursts, common_grid
from sysid.posterior.residual_spectrum import HIGHEST_HZ, NYQUIST_SHARE, WHOLE_HZ, WHOLE_SHARE
from sysid.posterior.smoothing import HALF_SAMPLES, Airspeed, airspeed_alone, airspeed_through, expected, smoothed
from sysid.posterior.stated_priors import airspeed_lag
from sysid.signals.flight import FlightSignals, finite
from sysid.signals.record import SURFACES
from sysid.signals.sensor_groups import ESSENTIAL, IMU
from sysid.signals.thrust.electric import BY_BATTERY, BY_BLADES
from sysid.signals.thrust.source import BATTERY, MOTORS, behind_motor, dead_thrust, thrust_in_air

# Step of the simulation, s; residuals are compared at no finer steps than the second.
STEP_S, COMMON_STEP_S = 0.01, 0.02
# No part is shorter, s, or has fewer points at which it is compared.
SHORTEST_S, _FEWEST_POINTS = 0.7, 16
# The start of a part is left out of the spectrum over so long, s.
_RISE_S = 0.5
# Half widths of the windows that smooth what is imposed, s, where samples are not further apart.
_HALF_S = {"rates": 0.06, "angles": 0.10, "airspeed": 0.15, "thrust": 0.10}
# By which an airspeed's position error is estimated, s: speeds change as slowly.
_SLOW_HALF_S = 1.5
_DEAD = 1e-6
# Standard deviation of a sideslip, rad, that an aircraft may fly with.
_USUAL_SIDESLIP = 0.3
# Samples of what an estimate cannot do without, in a part of a flight.
_FEWEST = 10

MEASURED = (*IMU, "alpha", "beta")


@dataclass(frozen=True)
class FlightPart:
    """One part of one flight.

    grid: (N,) s, even. inputs: de, da, dr, throttle and controls of other names as functions of time. motion: alpha,
    beta, p, q, r, phi, theta [rad, rad/s] smoothed, (N,), and slow_alpha. airspeed: true, smoothed. thrust: (N,) N, NaN
    where it follows from the throttle; thrust_from: the signal that gives it, "" for none. rho: (N,) kg/m3. channels:
    measured outputs by name. common: grid of the residuals. rate_hz: of the slowest of its message, the gyros and the
    inputs. position: whether the log holds positions of the surfaces. messages: signal -> the message that carried it.
    thrust_by_blades: (N,) N, change of a thrust by the battery's power with what the blades take, one standard
    deviation; 0 of any other.
    """

    flight: str
    grid: Array
    inputs: Mapping[str, InputSignal]
    motion: Mapping[str, Array]
    airspeed: Airspeed
    thrust: Array
    thrust_from: str
    rho: Array
    channels: Mapping[str, Channel]
    common: CommonGrid
    rate_hz: Mapping[str, float]
    position: bool
    messages: Mapping[str, str]
    thrust_by_blades: Array | float = 0.0

    def highest_hz(self, output: str, whole: bool = False) -> float:
        """Frequency to which an output counts, in the usual band or in the whole."""
        highest, share = (WHOLE_HZ, WHOLE_SHARE) if whole else (HIGHEST_HZ, NYQUIST_SHARE)
        return min(highest, share * self.rate_hz[output])

    @property
    def named(self) -> tuple[str, ...]:
        """Controls of other names than de, da, dr and throttle that were recorded."""
        return tuple(name for name in self.inputs if name not in (*SURFACES, "throttle", *MOTOR_MOMENTS))

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return float(self.grid[-1] - self.grid[0])

    def thinned(self) -> FlightPart:
        """The part with every second point of its grid: slopes of what is simulated need no finer steps."""
        motion = {name: values[::2] for name, values in self.motion.items()}
        speed = replace(self.airspeed, values=self.airspeed.values[::2], by_lag=self.airspeed.by_lag[::2])
        by_blades = self.thrust_by_blades if isinstance(self.thrust_by_blades, float) else self.thrust_by_blades[::2]
        return replace(
            self, grid=self.grid[::2], motion=motion, airspeed=speed, thrust=self.thrust[::2], rho=self.rho[::2],
            thrust_by_blades=by_blades,
        )  # fmt: skip

    @property
    def command_interval_s(self) -> float:
        """Usual interval of the surfaces' commands, s; 0 without any."""
        stamps = [self.inputs[name].time_s for name in SURFACES if name in self.inputs]
        return max((float(np.median(np.diff(one))) for one in stamps if one.size > 1), default=0.0)

    def travel(self, surface: str) -> float:
        """Standard deviation of a surface's command through what counts of the part, rad."""
        counted = self.common.points[self.common.taper > 0.5]
        return float(np.std(self.inputs[surface].at(counted))) if surface in self.inputs and counted.size else 0.0


def held_between(part: FlightPart) -> FlightPart:
    """The part with the commands of its surfaces staying from stamp to stamp where they are a curve now; itself where
    none is, or where a log of them is slower than the loop that sends them.
    """
    curves = [name for name in (*SURFACES, *part.named) if name in part.inputs and part.inputs[name].kind == "splined"]
    if part.position or not curves or part.command_interval_s > LOOP_INTERVAL_S:
        return part
    return replace(part, inputs={**part.inputs, **{name: replace(part.inputs[name], kind="held") for name in curves}})


def inputs_of(
    signals: FlightSignals, vehicle: Vehicle, begin: float, end: float
) -> tuple[dict[str, InputSignal], bool]:
    """de, da, dr and throttle as functions of time from begin to end [s], and whether surfaces are positions."""
    named = vehicle.named_controls
    commands = {name: finite(signals, name, begin, end) for name in (*SURFACES, "throttle", *named)}
    commands = {name: one for name, one in commands.items() if one[0].size >= 2}
    # [signals] may bring what [controls] does not describe. A delay that is known counts from commands that stay.
    controls = {name: vehicle.controls.get(control_of(name)) for name in commands}
    described = {name: one for name, one in controls.items() if one is not None}
    position = any(one.signal == "position" for name, one in described.items() if name in SURFACES)
    held = [name for name, one in described.items() if one.delay.value is not None]
    surfaces = in_steps(values for name, (_, values) in commands.items() if name in SURFACES)
    inputs = {
        name: surface_signal(*one, controls[name], position=position, stepping=surfaces, held=name in held)
        if name in SURFACES
        else input_signal(*one, in_steps([one[1]]), name in held)
        for name, one in commands.items()
        if name not in named
    }
    for name in (name for name in commands if name in named):
        one, control = commands[name], vehicle.controls[name]
        position_too = control.signal == "position"
        inputs[name] = surface_signal(
            *one, control, position=position_too, stepping=in_steps([one[1]]), held=name in held
        )
    return inputs, position


def make_part(
    signals: FlightSignals,
    vehicle: Vehicle,
    begin: float,
    end: float,
    reconstructed: Mapping[str, tuple[Array, Array]] | None = None,
) -> FlightPart:
    """Prepare one part of a flight for the estimator.

    An accelerometer or gyro that the flight does not have at all is taken to read nothing where it is imposed.

    Parameters
    ----------
    signals : FlightSignals
        The flight's signals, each with its own stamps, SI units and rad.
    vehicle : Vehicle
        The vehicle that flew.
    begin, end : float
        First and last moment of the part, s on the flight's clock.
    reconstructed : Mapping[str, tuple[Array, Array]], optional
        alpha or beta by kinematics for where no vane is: stamps [s] and values [rad], shape (M,) each.

    Returns
    -------
    FlightPart
        Inputs, imposed motion and measured outputs from where all that is needed is read, SI units and rad.

    Raises
    ------
    SignalError
        Where something that nothing can stand for is missing, where less than `SHORTEST_S` are left in which all is
        read, or where the airspeed reads nothing.
    """
    read = {name: finite(signals, name, begin, end) for name in (*MEASURED, *ESSENTIAL)}
    inertial = [name for name in IMU if name in signals.signals]
    needed = (*inertial, *ESSENTIAL)
    counts = {name: read[name][0].size for name in needed}
    absent = [name for name in needed if not counts[name]] if inertial else list(IMU)
    few = [f"{counts[name]} samples of {name}" for name in needed if 0 < counts[name] < _FEWEST]
    if absent or few:
        lacking = [*([f"no {', '.join(absent)}"] if absent else []), *([f"only {', '.join(few)}"] if few else [])]
        raise SignalError(
            f"{signals.name}: {' and '.join(lacking)} from {begin:.1f} to {end:.1f} s: coefficients need the"
            f" accelerometers, the gyros, roll and pitch, and the airspeed, {_FEWEST} samples of each at least"
        )
    earliest = begin - 1.0
    begin = max(begin, *(read[name][0][0] for name in needed))
    end = min(end, *(read[name][0][-1] for name in needed))
    if end - begin < SHORTEST_S:
        raise SignalError(
            f"{signals.name}: from {begin:.1f} to {end:.1f} s there are less than {SHORTEST_S:g} s in which all is read"
        )
    grid: Array = begin + STEP_S * np.arange(int((end - begin) / STEP_S), dtype=np.float64)
    inputs, position = inputs_of(signals, vehicle, earliest, end)
    motion = {
        **{name: np.zeros(grid.size) for name in IMU},
        **{name: _smooth(read[name], grid, _HALF_S["rates"]) for name in inertial},
        **{name: _smooth(read[name], grid, _HALF_S["angles"]) for name in ("phi", "theta")},
    }
    rho = _density(signals, vehicle, grid, begin, end)
    stamps, airspeed = read["airspeed"]
    if vehicle.sensors.airspeed.kind != "true":
        airspeed = airspeed * np.sqrt(SEA_LEVEL_DENSITY / np.interp(stamps, grid, rho))
    if float(np.median(airspeed)) < 1.0:
        raise SignalError(f"{signals.name}: the airspeed reads nothing: its sensor is dead or not connected")
    alive = {name: one for name, one in read.items() if one[0].size >= 10 and float(np.std(one[1])) > _DEAD}
    rough = _smooth((stamps, airspeed), grid, _HALF_S["airspeed"])
    motion |= _flow(alive, reconstructed or {}, motion, rough, grid, vehicle)
    # The fast part of a vane's reading is gusts, and what goes with them takes their answer for its own.
    motion["slow_alpha"] = smoothed(grid, motion["alpha"], grid, _SLOW_HALF_S)
    messages = {name: one.source.partition(".")[0] for name, one in signals.signals.items()}
    lag_known = airspeed_lag(vehicle, messages)
    if {"ax", "az"} <= alive.keys():
        along = _along_path(motion, vehicle.environment.gravity)
        speed = airspeed_through(stamps, airspeed, grid, along, lag_known)
    else:
        speed = airspeed_alone(stamps, airspeed, grid, _HALF_S["airspeed"], lag_known)
    if "az" not in alive and "alpha" in alive:
        motion["az"] = _normal_acceleration(motion, speed.values, vehicle.environment.gravity)
    channels = {
        name: Channel(name, *_inside(alive[name], grid)) for name in MEASURED if name in alive and name != "airspeed"
    }
    gyros = read["q" if "q" in inertial else inertial[-1]][0]
    imu = float(np.median(np.diff(gyros)))
    rates = [
        1.0 / imu,
        *(1.0 / float(np.median(np.diff(inputs[n].time_s))) for n in SURFACES if n in inputs),
    ]
    lost = bursts(gyros) + [one for n in SURFACES if n in inputs for one in bursts(inputs[n].time_s)]
    for name in ("alpha", "beta"):
        lost += bursts(channels[name].time_s) if name in channels else []
    common = common_grid(begin, end, max(COMMON_STEP_S, imu), sorted(lost), _RISE_S)
    if common.points.size < _FEWEST_POINTS:
        raise SignalError(f"{signals.name}: {common.points.size} samples from {begin:.1f} to {end:.1f} s are too few")
    rate_hz = {name: min(*rates, _rate(one.time_s)) for name, one in channels.items()}
    thrust, thrust_from = _thrust(signals, vehicle, grid, motion["ax"], speed.values, rho, (begin, end))
    if vehicle.motors and vehicle.motors.keys() <= inputs.keys():
        late = {name: vehicle.controls[name].delay.value or 0.0 for name in vehicle.motors}
        # A motor keeps the throttle that it was sent until the next.
        held = {name: replace(inputs[name], kind="held").at(grid - late[name]) for name in vehicle.motors}
        throttle = {name: behind_motor(held[name], STEP_S, motor.tau) for name, motor in vehicle.motors.items()}
        loads = motor_loads(vehicle, throttle, speed.values, rho)
        made = {**throttle, **dict(zip(MOTOR_MOMENTS, loads.moments.T, strict=True))}
        inputs |= {name: InputSignal(grid, values, "joined") for name, values in made.items()}
        if thrust_from != "thrust":
            thrust, thrust_from = loads.thrust, MOTORS
    return FlightPart(
        signals.name, grid, inputs, motion, speed, thrust, thrust_from, rho, channels, common, rate_hz, position,
        messages, _by_blades(signals, grid, (begin, end)) if thrust_from == BATTERY else 0.0,
    )  # fmt: skip


def _smooth(read: tuple[Array, Array], grid: Array, half: float) -> Array:
    time_s, values = read
    return smoothed(time_s, values, grid, max(half, HALF_SAMPLES * float(np.median(np.diff(time_s)))))


def _inside(read: tuple[Array, Array], grid: Array) -> tuple[Array, Array]:
    inside = (read[0] >= grid[0]) & (read[0] <= grid[-1])
    return read[0][inside], read[1][inside]


def _density(signals: FlightSignals, vehicle: Vehicle, grid: Array, begin: float, end: float) -> Array:
    if vehicle.environment.air_density is not None:
        return np.full(grid.size, vehicle.environment.air_density)
    time_s, values = finite(signals, "air_density", begin, end)
    if not time_s.size:
        return np.full(grid.size, SEA_LEVEL_DENSITY)
    # Density follows height, and no small aircraft climbs within a second: noise of the pressure is not air.
    return smoothed(time_s, values, grid, 1.0) if time_s.size > 10 else np.interp(grid, time_s, values)


def _thrust(
    signals: FlightSignals,
    vehicle: Vehicle,
    grid: Array,
    ahead: Array,
    airspeed: Array,
    rho: Array,
    span: tuple[float, float],
) -> tuple[Array, str]:
    """Thrust, and the signal that gives it: measured, what accelerates the motor on its cell added, or by rpm; NaN
    where the simulation takes it from the throttle, and none where it is not known.
    """
    propulsion = vehicle.propulsion
    time_s, values = finite(signals, "thrust", *span)
    throttle = finite(signals, "throttle", *span)[1]
    if time_s.size >= 10 and not dead_thrust(values, throttle):
        moving = 0.0 if propulsion is None else propulsion.moving_mass
        return np.asarray(_smooth((time_s, values), grid, _HALF_S["thrust"]) + moving * ahead), "thrust"
    if propulsion is None:
        return np.zeros(grid.size), ""
    time_s, values = finite(signals, BY_BATTERY, *span)
    if time_s.size >= 10:
        return _smooth((time_s, values), grid, _HALF_S["thrust"]), BATTERY
    time_s, values = finite(signals, "rpm", *span)
    if time_s.size >= 10 and propulsion.by_rpm:
        return thrust_in_air(_smooth((time_s, values), grid, _HALF_S["thrust"]), airspeed, rho, vehicle), "rpm"
    if propulsion.by_throttle and throttle.size >= 2:
        return np.full(grid.size, np.nan), "throttle"
    return np.zeros(grid.size), ""


def _by_blades(signals: FlightSignals, grid: Array, span: tuple[float, float]) -> Array:
    return _smooth(finite(signals, BY_BLADES, *span), grid, _HALF_S["thrust"])


def _flow(
    read: Mapping[str, tuple[Array, Array]],
    reconstructed: Mapping[str, tuple[Array, Array]],
    motion: Mapping[str, Array],
    speed: Array,
    grid: Array,
    vehicle: Vehicle,
) -> dict[str, Array]:
    """alpha and beta at the centre of gravity, from the vanes; else alpha from kinematics, and no sideslip: without a
    vane those may mistake wind for it, and the lateral motion is simulated. As kinematics have it, it is good for
    values to start from (`start_beta`), where it is one that an aircraft flies with.
    """
    sensors, found = vehicle.sensors, {}
    for name in ("alpha", "beta"):
        if name in read:
            found[name] = expected(*read[name], grid)
        elif name == "beta":
            found[name] = np.zeros(grid.size)
            slip = _usual_sideslip(reconstructed, grid)
            if slip is not None:
                found["start_beta"] = slip
        elif name in reconstructed:
            found[name] = np.interp(grid, *reconstructed[name])
        else:
            raise SignalError("no angle of attack: neither a vane nor what kinematics could take it from")
    for name in read.keys() & found.keys():
        found[name] = _at_centre(name, found[name], found["alpha"], motion, speed, sensors)
    return found


def _usual_sideslip(reconstructed: Mapping[str, tuple[Array, Array]], grid: Array) -> Array | None:
    """(N,) the sideslip by kinematics, without its mean, rad; None where it is no aircraft's."""
    if "beta" not in reconstructed:
        return None
    slip = np.interp(grid, *reconstructed["beta"])
    slip -= float(np.mean(slip))
    return slip if float(np.std(slip)) < _USUAL_SIDESLIP else None


def _at_centre(
    name: str, flow: Array, alpha: Array, motion: Mapping[str, Array], speed: Array, sensors: Sensors
) -> Array:
    """A flow angle at the centre of gravity from what its vane sees."""
    p, q, r = motion["p"], motion["q"], motion["r"]
    if name == "alpha":
        x, y, _ = sensors.alpha_vane.position
        return flow + x * q / speed - y * p / speed
    x, _, z = sensors.beta_vane.position
    if sensors.beta_vane.kind == "flank":
        flow = np.asarray(np.arctan(np.tan(flow) * np.cos(alpha)))
    return flow - x * r / speed + z * p / speed


@dataclass(frozen=True)
class VaneReading:
    """A flow angle as its vane measured it, smoothed onto the grid of a part: (N,) rad, rad/s, rad/s^2."""

    part: FlightPart
    name: str
    values: Array
    rate: Array
    curvature: Array

    def at_centre(self, sensors: Sensors, values: Mapping[str, float]) -> Array:
        """(N,) the angle at the centre of gravity before the vane swung, scaled and was stamped.

        values: the nuisances of that vane.
        """
        part, grid = self.part, self.part.grid
        later = grid + values["vane_clock"]
        read = np.interp(later, grid, self.values)
        speed = part.airspeed.values
        time = values["vane_period"] / (2.0 * np.pi) * float(np.median(speed)) / speed
        read = read + 2.0 * math.exp(values["vane_log_damping"]) * time * np.interp(later, grid, self.rate)
        read += time**2 * np.interp(later, grid, self.curvature)
        read = read / values[f"{self.name}_scale"]
        return _at_centre(self.name, read, part.motion["alpha"], part.motion, part.airspeed.values, sensors)


def vane_reading(part: FlightPart, name: str) -> VaneReading:
    """What the vane of alpha or beta measured through a part."""
    channel, dt = part.channels[name], float(part.grid[1] - part.grid[0])
    read = expected(channel.time_s, channel.values, part.grid)
    rate = np.gradient(read, dt)
    return VaneReading(part, name, read, rate, np.gradient(rate, dt))


def with_vane(part: FlightPart, name: str, sensors: Sensors, values: Mapping[str, float]) -> FlightPart:
    """The part with a flow angle, alpha or beta, as it was before its vane: `values` are that vane's nuisances.

    What is imposed on one group of axes is read by the vane of the other: 60 ms of lag in it, times the rates, are as
    large as what is to be estimated.
    """
    return replace(part, motion={**part.motion, name: vane_reading(part, name).at_centre(sensors, values)})


def with_flow(part: FlightPart, name: str, sensors: Sensors, read: Array) -> FlightPart:
    """The part with a flow angle, alpha or beta, that an ideal vane would have read: (N,) rad on its grid."""
    motion = part.motion
    centre = _at_centre(name, read, motion["alpha"], motion, part.airspeed.values, sensors)
    return replace(part, motion={**motion, name: centre})


def _rate(time: Array) -> float:
    """Samples per second."""
    return 1.0 / float(np.median(np.diff(time)))


def _along_path(motion: Mapping[str, Array], gravity: float) -> Array:
    """(N,) m/s^2, rate of airspeed in still air by what the accelerometers feel."""
    ca, sa, cb, sb = (f(motion[n]) for n in ("alpha", "beta") for f in (np.cos, np.sin))
    ct, st, cp, sp = (f(motion[n]) for n in ("theta", "phi") for f in (np.cos, np.sin))
    return np.asarray(
        (motion["ax"] - gravity * st) * ca * cb
        + (motion["ay"] + gravity * ct * sp) * sb
        + (motion["az"] + gravity * ct * cp) * sa * cb
    )


def _normal_acceleration(motion: Mapping[str, Array], speed: Array, gravity: float) -> Array:
    """(N,) m/s^2, what an accelerometer along the body's z axis would feel, by how the angle of attack changes."""
    ca, sa = np.cos(motion["alpha"]), np.sin(motion["alpha"])
    ct, st, cp = np.cos(motion["theta"]), np.sin(motion["theta"]), np.cos(motion["phi"])
    sideways = np.tan(motion["beta"]) * (motion["p"] * ca + motion["r"] * sa)
    turned = speed * np.cos(motion["beta"]) * (np.gradient(motion["alpha"], STEP_S) - motion["q"] + sideways)
    return np.asarray((turned - gravity * (ct * cp * ca + st * sa) + motion["ax"] * sa) / ca)


def outputs_of(group: str, parts: Sequence[FlightPart]) -> tuple[str, ...]:
    """Outputs of a group of axes that every part measured, and that the simulation can give."""
    wanted: tuple[str, ...] = ("q", "az", "ax", "alpha") if group == "longitudinal" else ("p", "r", "ay", "beta")
    if not all(part.thrust_from for part in parts):
        # Without thrust a simulated ax is drag alone, and the difference would pass for the accelerometer's zero.
        wanted = tuple(name for name in wanted if name != "ax")
    return tuple(name for name in wanted if all(name in part.channels for part in parts))

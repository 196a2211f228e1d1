"""Stretches of flight as the estimators use them: inputs, measured outputs, and where they came from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import START_TIME, THRUST_AIRSPEED, THRUST_BEND, THRUST_SLOPE, slot
from sim_vehicle.physics.kernel_records import NOT_SEEN
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS, MOTOR_MOMENTS, Control, control_of
from sim_vehicle.vehicle.packed_model import PackedModel
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.numerics.fractional_delay import held_back
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightData
from sysid.signals.height import height_above_ground, height_in_flight
from sysid.signals.thrust.denoising import NO_NOISE, AirspeedLaw, Denoised, Passed, denoised_thrust, way_of
from sysid.signals.thrust.electric import BY_BATTERY
from sysid.signals.thrust.source import (
    BATTERY,
    MEASURED,
    MOTORS,
    THRUST_BY_SQUARE,
    ThrustSource,
    filled,
    rotor_speed,
    thrust_of_speed,
    thrust_source,
    with_rotor_speed,
)

OUTPUTS = (*CHANNELS[:12], "vn", "ve", "vd")
# Where they stand among what the simulation gives.
OUTPUT_PLACES = np.array([CHANNELS.index(name) for name in OUTPUTS])
ANGLES = ("phi", "theta", "psi")
LONGITUDINAL = ("airspeed", "alpha", "q", "theta", "ax", "az")
LATERAL = ("beta", "p", "r", "phi", "psi", "ay")
GROUND = ("vn", "ve", "vd")
SURFACES = ("de", "da", "dr")
_INPUTS = (*SURFACES, "throttle")
# Commands before a stretch that may still be under way in the actuators when it starts, s.
PRE_ROLL_S = 0.6
# Actuators forget what was commanded longer ago, s.
MEMORY_S = 1.5
# But what a dead band holds may be as old as this, s.
_HELD_S = 30.0
# Density follows height, and no small aircraft climbs faster than this band.
_DENSITY_BAND_HZ = 1.0

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")


def angle_wrap(residual: Array) -> Array:
    """Residuals with those of phi and psi brought to [-pi, pi].

    Parameters
    ----------
    residual : Array, shape (N, 15)
        Residuals of OUTPUTS, each in its output's unit (angles in rad); written over.

    Returns
    -------
    Array, shape (N, 15)
        The same array, each column in its output's unit.
    """
    for name in ("phi", "psi"):
        j = OUTPUTS.index(name)
        residual[:, j] = (residual[:, j] + np.pi) % (2.0 * np.pi) - np.pi
    return residual


@dataclass(frozen=True)
class Record:
    """One stretch of one flight for a free-running simulation.

    commands: (M, 4 + named) de, da, dr [rad], throttle and the vehicle's controls of other names (`named`), held from
    each sample on, from `first` of the flight's samples on.
    thrust: (M,) N, NaN where it follows from the throttle. rho: (M,) kg/m3. z: (N, 15) measured OUTPUTS of the samples
    `start` ... `start + N - 1` of the commands; NaN where missing. time_s: (N,) s. interval_s: s. imposed_states: (M,
    9) states imposed instead of integrated, or (0, 9). moving_mass: kg; `thrust` holds moving_mass times the measured
    ax, and so an accelerometer's bias too. thrust_doubt: (K, M) independent errors that the sensor's noise leaves in
    `thrust`, each of one standard deviation; records of one flight with one `stretch` share them. rotor_doubt: (L, M)
    the same that a counter's noise leaves in the throttle, where that stands for the propeller's measured speed; where
    thrust follows from that speed, rows of the same number are one error. thrust_source: where thrust comes from.
    thrust_read: (M,) N, as the sensor read it, where the airspeed explains a part of it; else (0,). law: how thrust
    follows the airspeed that is simulated, and airspeed: (M,) m/s, the one that it has in `thrust`; None and (0,) where
    it does not. heights: (M,) m above the ground, and relative_height: (M,) m above the middle of the flight, each (0,)
    where it is not known. hysteresis_direction: (M,) the way in which the thrust sensor's reading moves
    (`sysid.signals.thrust.denoising`); (0,) without one. command_history: (L, 3) commands of the surfaces before those
    above, which a servo with a dead band may still hold. thrust_noise: what noise is left in `thrust`.
    joined: whether the log holds positions of the surfaces: `commands` are then means from each sample to the next,
    and positions: (M, 3) rad, where they were at the samples; (0, 3) where that is not known.
    surface_doubt: (M, 3) rad, one standard deviation of what is not known of those means; (0, 3) without positions.
    seen: (M, 4 + named) what sensors see of the surfaces at the samples, where that is known by itself; else (0, 4).
    """

    flight: str
    interval_s: float
    time_s: Array
    start: int
    commands: Array
    thrust: Array
    rho: Array
    z: Array
    imposed_states: Array
    moving_mass: float = 0.0
    thrust_doubt: Array = field(default_factory=lambda: np.zeros((0, 0)))
    rotor_doubt: Array = field(default_factory=lambda: np.zeros((0, 0)))
    stretch: int = 0
    thrust_source: ThrustSource = MEASURED
    thrust_read: Array = field(default_factory=lambda: np.zeros(0))
    law: AirspeedLaw | None = None
    airspeed: Array = field(default_factory=lambda: np.zeros(0))
    heights: Array = field(default_factory=lambda: np.zeros(0))
    relative_height: Array = field(default_factory=lambda: np.zeros(0))
    hysteresis_direction: Array = field(default_factory=lambda: np.zeros(0))
    command_history: Array = field(default_factory=lambda: np.zeros((0, 3)))
    thrust_noise: Passed = NO_NOISE
    joined: bool = False
    positions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    surface_doubt: Array = field(default_factory=lambda: np.zeros((0, 3)))
    named: tuple[str, ...] = ()
    seen: Array = field(default_factory=lambda: NOT_SEEN)

    @property
    def length(self) -> int:
        """Number of output samples N."""
        return int(self.z.shape[0])

    def window(self, begin: int, end: int) -> Record:
        """The output samples begin ... end - 1 as a record of its own, actuators running from MEMORY_S before."""
        cut = max(0, self.start + begin - round(MEMORY_S / self.interval_s))
        kept = slice(cut, self.start + end)
        before = np.concatenate((self.command_history, self.commands[:cut, :3]))[-round(_HELD_S / self.interval_s) :]
        return replace(
            self, time_s=self.time_s[begin:end], start=self.start + begin - cut, commands=self.commands[kept],
            thrust=self.thrust[kept], rho=self.rho[kept], z=self.z[begin:end],
            imposed_states=self.imposed_states[kept] if self.imposed_states.size else self.imposed_states,
            thrust_doubt=self.thrust_doubt[:, kept], rotor_doubt=self.rotor_doubt[:, kept],
            thrust_read=self.thrust_read[kept], airspeed=self.airspeed[kept], heights=self.heights[kept],
            relative_height=self.relative_height[kept], hysteresis_direction=self.hysteresis_direction[kept],
            command_history=before, surface_doubt=self.surface_doubt[kept],
            positions=self.positions[kept], seen=self.seen[kept],
        )  # fmt: skip

    def with_surfaces(self, change: Callable[[Array], Array]) -> Record:
        """The record with its surfaces changed. change: of (n, 3) de, da, dr, rad, evenly spaced in time."""
        commands = self.commands.copy()
        commands[:, : len(SURFACES)] = change(commands[:, : len(SURFACES)])
        positions = change(self.positions) if self.positions.size else self.positions
        return replace(self, commands=commands, positions=positions)


def thrust_without_airspeed(record: Record) -> Array:
    """Thrust of a record without what the simulated airspeed adds to it.

    Parameters
    ----------
    record : Record
        Stretch of a flight, whose commands have M samples.

    Returns
    -------
    Array, shape (M,)
        Thrust, N; NaN where it follows from the throttle. The record's own array where it has no airspeed law.
    """
    return record.thrust if record.law is None else record.thrust - record.law.along(record.airspeed)


def simulated_effects(flat: PackedModel, record: Record) -> Array:
    """The effect vector for a record whose thrust follows the airspeed of the simulation.

    Parameters
    ----------
    flat : PackedModel
        Flat model, of whose effect vector a copy is taken.
    record : Record
        Stretch of a flight; its airspeed law, where it has one, enters the effect vector.

    Returns
    -------
    Array, shape (E,)
        Effect vector, one value per slot of `sim_vehicle.effects`, each in that parameter's unit.
    """
    effects = effects_at(flat, record)
    if record.law is not None:
        effects[[THRUST_AIRSPEED, THRUST_SLOPE, THRUST_BEND]] = record.law.about, record.law.slope, record.law.bend
    return effects


def effects_at(flat: PackedModel, record: Record) -> Array:
    """The effect vector for a record: at its own time, and without what its source of thrust holds already.

    Parameters
    ----------
    flat : PackedModel
        Flat model, of whose effect vector a copy is taken.
    record : Record
        Stretch of a flight; where its thrust comes from the propeller's speed, battery sag is left out.

    Returns
    -------
    Array, shape (E,)
        Effect vector, one value per slot of `sim_vehicle.effects`, each in that parameter's unit.
    """
    effects = flat.E.copy()
    effects[START_TIME] = record.time_s[0]
    if record.thrust_source.signal == "rpm":
        effects[slot("battery_sag")] = 0.0
    return effects


def held_by_dead_band(commands: Array, record: Record, effects: Array) -> Array:
    """Commands of a record, their first row what servos with a dead band had accepted until then.

    The actuators are at rest there; what lags behind them has forgotten that row when the record's samples begin.

    Parameters
    ----------
    commands : Array, shape (M, 4)
        Commands de, da, dr, rad, and throttle, dimensionless.
    record : Record
        Stretch of a flight, whose `command_history` holds the surfaces' earlier commands, rad.
    effects : Array, shape (E,)
        Effect vector, each value in its parameter's unit.

    Returns
    -------
    Array, shape (M, 4)
        Commands, rad, and throttle, dimensionless; the array given where no servo has a dead band or no earlier command
        is known.
    """
    half = 0.5 * float(effects[slot("servo_deadband", "width")])
    if effects[slot("servo_deadband")] == 0.0 or half == 0.0 or not record.command_history.size:
        return commands
    commands = commands.copy()
    for channel in range(3):
        accepted, *rest = record.command_history[:, channel].tolist()
        for command in (*rest, float(commands[0, channel])):
            accepted = command if abs(command - accepted) > half else accepted
        commands[0, channel] = accepted
    return commands


def height_for(record: Record, effects: Array) -> Array:
    """Height of a record that an effect depends on.

    It is the height above the ground where ground effect acts, else above the middle of the flight, so that the wind's
    shear there is no steady wind.

    Parameters
    ----------
    record : Record
        Stretch of a flight, whose commands have M samples.
    effects : Array, shape (E,)
        Effect vector, each value in its parameter's unit.

    Returns
    -------
    Array, shape (M,) or (0,)
        Height, m; (0,) where no effect depends on it.

    Raises
    ------
    SignalError
        Where an effect depends on the height and it is not known.
    """
    if effects[slot("ground_effect")] != 0.0:
        if not record.heights.size:
            raise SignalError(
                f"{record.flight}: the model has ground_effect, but the height above the ground is not known: record "
                "a rangefinder's height (DISTANCE_SENSOR), or altitude from before take-off on"
            )
        return record.heights
    if effects[slot("wind_shear")] == 0.0:
        return np.zeros(0)
    if not record.relative_height.size:
        raise SignalError(
            f"{record.flight}: the model has wind_shear, but the height is not known: record altitude (HIGHRES_IMU, "
            "VFR_HUD) or the vertical velocity (GLOBAL_POSITION_INT, LOCAL_POSITION_NED)"
        )
    return record.relative_height


def with_other_inputs(commands: Array, record: Record, effects: Array) -> Array:
    """Commands of a record with its height and its thrust's way behind them, if an effect needs one of these, and what
    surfaces rise by from sample to sample, if they do.

    Parameters
    ----------
    commands : Array, shape (M, 4 + named)
        Commands de, da, dr, rad, throttle, dimensionless, and controls of other names.
    record : Record
        Stretch of a flight, whose commands have M samples.
    effects : Array, shape (E,)
        Effect vector, each value in its parameter's unit.

    Returns
    -------
    Array, shape (M, 4), (M, 6), (M, 9) or (M, 9 + named)
        The commands as given where nothing needs more; else followed by the height, m, NaN where no effect depends on
        it, by the way in which the thrust sensor's reading moves, -1 to 1, dimensionless, 0 where it is not known, and
        by the rises, rad, NaN where surfaces are held.

    Raises
    ------
    SignalError
        Where the height that an effect needs is not known.
    """
    heights = height_for(record, effects)
    positions, named = record.positions, commands[:, 4:]
    alone = not positions.size and not named.size
    if not heights.size and effects[slot("thrust_sensor_hysteresis")] == 0.0 and alone:
        return commands
    heights = heights if heights.size else np.full(commands.shape[0], np.nan)
    way = record.hysteresis_direction if record.hysteresis_direction.size else np.zeros(commands.shape[0])
    rises = [np.diff(positions, axis=0, append=positions[-1:])] if positions.size else []
    if named.size and not rises:
        rises = [np.full((commands.shape[0], len(SURFACES)), np.nan)]
    return np.ascontiguousarray(np.column_stack((commands[:, :4], heights, way, *rises, named)))


def _smooth(values: Array, interval_s: float, cutoff_hz: float) -> Array:
    if values.size < 16 or not np.isfinite(values).all() or np.ptp(values) == 0.0:
        return np.ascontiguousarray(values)
    return np.ascontiguousarray(fourier_smooth(values, interval_s, cutoff_hz).values)


def make_records(data: FlightData, vehicle: Vehicle, spans: Sequence[tuple[int, int]]) -> list[Record]:
    """Records of the samples start ... stop - 1 of each span; SignalError where an input is missing."""
    if not any(name in data for name in (*SURFACES, *vehicle.named_controls)):
        raise SignalError(
            f"{data.name}: no control surface is known: name its servo under [controls] of the vehicle file"
        )
    n = data.time_s.size
    inputs = (*_INPUTS, *vehicle.named_inputs)
    given = {name: filled(data[name]) if name in data else np.zeros(n) for name in inputs}
    commands = np.stack([_as_acted(name, given[name], vehicle, data.interval_s) for name in inputs], axis=1)
    heights = (height_above_ground(data), height_in_flight(data))
    doubt = positions = np.zeros((0, 3))
    if has_positions(vehicle):
        doubt = np.stack([position_doubt(given[name], vehicle.controls.get(control_of(name))) for name in SURFACES], 1)
        positions = np.stack([given[name] for name in SURFACES], 1)
    return [_make_record(data, vehicle, start, stop, commands, heights, doubt, positions) for start, stop in spans]


def position_doubt(values: Array, control: Control | None) -> Array:
    """(n,) rad, one standard deviation of what positions (n,) leave open of the mean from each sample to the next.

    Where between two samples an edge lies is not known: its mean is anywhere between both, evenly. And a position in
    whole microseconds is anywhere within one, evenly.
    """
    if values.size < 3:
        return np.zeros(values.size)
    # One that is given in other units has steps that are finer than a pulse's.
    step = float(np.median(np.diff(np.unique(values)))) if np.ptp(values) > 0.0 else 0.0
    if control is not None:
        step = min(step, control.microsecond)
    bend = np.abs(np.diff(values, 2, prepend=values[0], append=values[-1]))
    jump = np.append(np.minimum(bend[:-1], bend[1:]), 0.0)
    return np.sqrt((np.maximum(jump - 2.0 * step, 0.0) ** 2 + step**2) / 12.0)


def positions_of(vehicle: Vehicle) -> dict[str, Control | None]:
    """Signals of the surfaces with what the vehicle file says of each, where the log holds their positions."""
    named = {name: vehicle.controls[name] for name in vehicle.named_controls}
    found: dict[str, Control | None] = {name: one for name, one in named.items() if one.signal == "position"}
    if has_positions(vehicle):
        found |= {name: vehicle.controls.get(control_of(name)) for name in SURFACES}
    return found


def has_positions(vehicle: Vehicle) -> bool:
    """Whether the log holds positions of the surfaces, between which they move, instead of commands that are held."""
    return any(
        one.signal == "position" for name, one in vehicle.controls.items() if DEFLECTION_SIGNALS.get(name) in SURFACES
    )


def _as_acted(name: str, values: Array, vehicle: Vehicle, interval_s: float) -> Array:
    """(n,) what a command does from each sample to the next, later by what the vehicle file says of its servo: delay
    and lag together. A measured position is on a monotone curve through its samples, which counts by its mean.
    """
    if name in MOTOR_MOMENTS or name in vehicle.motors:
        return np.append(0.5 * (values[:-1] + values[1:]), values[-1:])
    if name in positions_of(vehicle) and values.size > 1:
        from scipy.interpolate import PchipInterpolator  # slow to import, and seldom wanted

        along = PchipInterpolator(np.arange(values.size), values).antiderivative()(np.arange(values.size))
        return np.append(np.diff(along), values[-1])
    control = vehicle.controls.get(control_of(name))
    late = 0.0 if control is None else (control.delay.value or 0.0) + (control.lag.value or 0.0)
    return held_back(values, late, interval_s) if late > 0.0 else values


def _make_record(
    data: FlightData,
    vehicle: Vehicle,
    start: int,
    stop: int,
    all_commands: Array,
    heights: tuple[Array, Array],
    doubt: Array,
    positions: Array,
) -> Record:
    """all_commands: (n, 4 + named) of the whole flight. heights: (n,) or (0,) above the ground and in flight, doubt,
    positions: (n, 3) or (0, 3), of the same.
    """
    n = data.time_s.size
    first = max(0, start - round(PRE_ROLL_S / data.interval_s))
    commands = all_commands[first:stop].copy()
    earlier = all_commands[max(0, first - round(_HELD_S / data.interval_s)) : first, :3]
    # Inputs enter as they are: noise on them would act on the aircraft as if the air were rough.
    moving_mass, way = 0.0, np.zeros(0)
    source = thrust_source(data, vehicle)
    speed = rotor_speed(data, first, stop)
    commands, rotor_doubt = with_rotor_speed(commands, speed, vehicle, data.interval_s)
    airspeed = filled(data["airspeed"])[first:stop] if "airspeed" in data else None
    thrust = np.full(stop - first, np.nan)
    if source.signal == BATTERY:
        thrust = filled(data[BY_BATTERY])[first:stop]
    if source.signal == "thrust":
        thrust = filled(data["thrust"])[first:stop]
        way = way_of(thrust, data.interval_s)
        if vehicle.propulsion is not None and vehicle.propulsion.moving_mass > 0.0 and "ax" in data:
            # The motor hangs on the cell: add what accelerates it, so that thrust is the propeller's. The noise of ax
            # is in the output ax as well. It meets itself there by the motor's share of the mass times the share of
            # terms that the smoothing passes: with 0.08 kg in 1 kg and 70 terms of 1150 by 0.5 %, and by less than
            # 0.03 % where the throttle explains the thrust. That is left out.
            moving_mass = vehicle.propulsion.moving_mass
            thrust = thrust + moving_mass * filled(data["ax"])[first:stop]
    if source.signal == MOTORS:
        thrust = filled(data["motor_thrust"])[first:stop]
        denoised = Denoised(thrust, np.zeros((0, thrust.size)))
    elif speed is not None and source.law == THRUST_BY_SQUARE:
        denoised = thrust_of_speed(speed, vehicle)
    else:
        denoised = denoised_thrust(thrust, commands[:, 3], data.interval_s, airspeed)
    if vehicle.environment.air_density is not None:
        rho = np.full(n, vehicle.environment.air_density)
    elif "air_density" in data:
        rho = filled(data["air_density"])
    else:
        rho = np.full(n, SEA_LEVEL_DENSITY)
    z = np.full((stop - start, len(OUTPUTS)), np.nan)
    for j, name in enumerate(OUTPUTS):
        if name in data:
            z[:, j] = data[name][start:stop]
    above, climbed = (height[first:stop] for height in heights)
    return Record(
        data.name, data.interval_s, data.time_s[start:stop], start - first, commands,
        denoised.values, _smooth(rho[first:stop], data.interval_s, _DENSITY_BAND_HZ), z, np.zeros((0, 9)), moving_mass,
        denoised.doubt, rotor_doubt, start, source, thrust if denoised.by_airspeed else np.zeros(0), heights=above,
        relative_height=climbed, hysteresis_direction=way, command_history=earlier, thrust_noise=denoised.noise,
        joined=has_positions(vehicle), surface_doubt=doubt[first:stop],
        positions=positions[first:stop], named=vehicle.named_inputs,
    )  # fmt: skip

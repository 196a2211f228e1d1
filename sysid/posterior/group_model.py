"""A group of axes simulated by what its surfaces did, all else imposed: outputs and their slopes by every unknown.

Longitudinal: w and q are free, with the elevator as input. Lateral: v, p and r, with aileron and rudder. Airspeed,
attitude and the other group's motion are imposed as measured and smoothed, so that neither gusts nor the slow modes
carry a simulation of minutes away. The equations are the compiled ones of sim_vehicle, effects included.

Where an autopilot answers gusts, what it commands goes with what they do to the aircraft. Then the flow angle of the
group is imposed too, as its vane measured it: gusts are in it, and what is left has little of them that a command could
answer. The vane's own errors then drive the simulation.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse

from sim_vehicle.effects.environment import DENSITY_ERROR
from sim_vehicle.effects.sensor import AIRSPEED_ERROR, PITOT_LAG
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.layout import Par
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.packed_model import PackedModel, flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.posterior.flight_part import FlightPart, VaneReading, vane_reading
from sysid.posterior.inputs import InputSignal, surface_motion, swing
from sysid.posterior.nuisance_priors import FLOW_OF, MOVING_MASS, PRODUCT_INERTIA, SURFACES_OF, THRUST_ARM, Unknowns
from sysid.posterior.observations import joined_at, read_at
from sysid.problem.free_parameters import coefficient, effect_parameter
from sysid.problem.predictor import Predictor
from sysid.signals.record import OUTPUTS, STATES, SURFACES, Record

_FREE = {"longitudinal": ("w", "q"), "lateral": ("v", "p", "r")}
_FLOW_STATES = ("v", "w")
# What initial states are known to before they are estimated: m/s and rad/s.
_START_STD = {"v": 1.5, "w": 1.5, "p": 0.5, "q": 0.5, "r": 0.5}
_VANES = ("alpha", "beta")
SERVO = ("servo_delay", "servo_lag", "servo_backlash")
# What changes the surfaces alone.
OF_SURFACES = (*SERVO, "command_rounding")
# Nuisances that change what drives the simulation; the others act on what it reads.
_DRIVING = frozenset(
    (
        *(*OF_SURFACES, "airspeed_error", "airspeed_alpha", "airspeed_lag"),
        *("theta_offset", "phi_offset", "alpha_offset", "thrust_error"),
    )
)


# Nuisances that change the motion's own equations, and the constant of the vehicle that they add to.
_SHAPING = {PRODUCT_INERTIA: Par.Ixz, THRUST_ARM: Par.propeller_z}

# Parameters of effects that change what airspeed drives the simulation, and steps of their differences.
_OF_AIRSPEED = {
    f"{effect.name}.{key}": 1e-3
    for effect, key in (
        (AIRSPEED_ERROR, "scale"),
        (AIRSPEED_ERROR, "bias"),
        (PITOT_LAG, "tau"),
        (DENSITY_ERROR, "scale"),
    )
}
_OF_VANE = frozenset(("alpha_scale", "beta_scale", "vane_clock", "vane_period", "vane_log_damping"))
# All that records of the same part differ by.
_CHANGES_INPUT = sorted({*_DRIVING, *_OF_VANE, *_OF_AIRSPEED})
# So many of them are kept.
_MOST_RECORDS = 16


@dataclass(frozen=True)
class _Prepared:
    """What of a part never changes: its record, and the matrices from the grid to the common one."""

    part: FlightPart
    record: Record
    start: Array
    fixed: Mapping[str, sparse.csr_array]
    joined: Mapping[str, sparse.csr_array]
    measured: Array
    vane: VaneReading | None


@dataclass(frozen=True)
class PerturbedInputs:
    """What a model is given instead: vehicle; factors of density, flow, commands, readings; zeros of flow and of
    commands, rad; blades: standard deviations of what a propeller's blades take.
    """

    vehicle: Vehicle
    density: float = 1.0
    flow: float = 1.0
    flow_zero: float = 0.0
    blades: float = 0.0
    gains: Mapping[str, float] = field(default_factory=dict)
    biases: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)


class GroupModel:
    """Outputs of parts of flights by coefficients, parameters of effects, nuisances and initial states, in that order.

    parts: (K,) of one or more flights. model: structure, values ignored; its effects fly. names: coefficients that are
    free; effects: (effect, parameter) that are. outputs: what is compared, m of them.
    """

    def __init__(
        self,
        parts: Sequence[FlightPart],
        vehicle: Vehicle,
        model: Model,
        names: Sequence[str],
        effects: Sequence[tuple[str, str]],
        group: str,
        outputs: Sequence[str],
        unknowns: Unknowns,
        flow_imposed: bool = False,
    ) -> None:
        self.group, self.outputs, self.unknowns = group, tuple(outputs), unknowns
        self.parameters = (*(coefficient(name) for name in names), *(effect_parameter(*one) for one in effects))
        self._model, self._given = model, PerturbedInputs(vehicle)
        self.flat = flatten(vehicle, model)
        own = SURFACES_OF[group]
        self._surfaces = {*own, *(factor for name in names for factor in parse_term(name).factors)}
        self.flow_imposed = flow_imposed
        self._free = tuple(name for name in _FREE[group] if not (flow_imposed and name in _FLOW_STATES))
        self._driving = _DRIVING | _OF_VANE if flow_imposed else _DRIVING
        self.free_states = [STATES.index(name) for name in self._free]
        self._columns = [OUTPUTS.index(name) for name in self.outputs]
        # Of each part where they were wanted last: evidence, covariance and result of a maximum want the same.
        self._slopes: dict[int, tuple[bytes, Array]] = {}
        self._take(parts)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns but the initial states."""
        return (*(one.name for one in self.parameters), *self.unknowns.names)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.names) + len(self.parts) * len(self.free_states)

    @property
    def vehicle(self) -> Vehicle:
        """What the model was given of the aircraft."""
        return self._given.vehicle

    def flying(self, model: Model, names: Sequence[str], effects: Sequence[tuple[str, str]]) -> GroupModel:
        """The same parts under another structure, with other coefficients and parameters of effects free."""
        other = self._copied()
        other.parameters = (*(coefficient(name) for name in names), *(effect_parameter(*one) for one in effects))
        other._model, other.flat = model, flatten(self.vehicle, model)
        used = (*names, *model.coefficients)
        other._surfaces = {*SURFACES_OF[self.group], *(factor for name in used for factor in parse_term(name).factors)}
        return other

    def of(self, parts: Sequence[FlightPart]) -> GroupModel:
        """The same model of other parts, as many of the same flights."""
        other = self._copied()
        other._take(parts)
        return other

    def rough(self) -> GroupModel:
        """The same model with twice the step, for a search that is far from its end."""
        other = self._copied()
        other._prepared = self._coarse
        return other

    def altered(self, by: PerturbedInputs) -> GroupModel:
        """The same model of the same parts, with other values given."""
        other = self._copied()
        other._given, other.flat = by, flatten(by.vehicle, self._model)
        other._records = {}
        gain = np.array([by.readings.get(name, 1.0) for name in self.outputs])[:, None]

        def changed(one: _Prepared) -> _Prepared:
            thrust = one.record.thrust + by.blades * one.part.thrust_by_blades
            record = replace(one.record, rho=by.density * one.record.rho, thrust=thrust)
            return replace(one, record=record, measured=gain * one.measured)

        other._prepared = [changed(one) for one in self._prepared]
        other._coarse = [changed(one) for one in self._coarse]
        return other

    def steps_at_stamps(self, index: int) -> bool:
        """Whether the surfaces of a part are known to step at the stamps of their commands, with no servo between."""
        return _stepping(self._prepared[index].part, self.unknowns)

    def start_states(self) -> tuple[Array, Array]:
        """Initial states as measured, of all parts, and their prior standard deviations."""
        states = np.concatenate([one.start[self.free_states] for one in self._prepared])
        return states, np.tile([_START_STD[name] for name in self._free], len(self.parts))

    def measured(self, index: int) -> Array:
        """(m, K) measured outputs of a part on its common grid."""
        return self._prepared[index].measured

    def simulated(self, index: int, theta: Array) -> Array:
        """(m, K) simulated outputs of a part on its common grid."""
        one, values = self._prepared[index], self._values(index, theta)
        y = self._ideal(one, values, theta, self._states(index, theta))[0]
        return self._read(one, values, y[:, :, None])[:, :, 0]

    def flow(self, index: int, theta: Array) -> Array:
        """(N,) flow angle of the group as an ideal vane would read it, simulated, on the grid of a part; rad."""
        one, values = self._prepared[index], self._values(index, theta)
        predictor, flat = self._predictor(one, values, theta, self._driven(one, values))
        y = predictor.outputs(0, flat, {}, self._states(index, theta))
        return np.interp(self.parts[index].grid, one.part.grid, y[:, OUTPUTS.index(FLOW_OF[self.group])])

    def slopes(self, index: int, theta: Array) -> Array:
        """(m, K, P) slopes of a part's outputs by all unknowns, simulated at every second step of the grid."""
        place = theta.tobytes()
        if self._slopes.get(index, (b"",))[0] != place:
            self._slopes[index] = (place, self._sloped(index, theta))
        return self._slopes[index][1]

    def _sloped(self, index: int, theta: Array) -> Array:
        one, values, count = self._coarse[index], self._values(index, theta), len(self.parameters)
        states = self._states(index, theta)
        y, predictor = self._ideal(one, values, theta, states)
        acting = [(i, n) for i, n in enumerate(self.unknowns) if n.acts_on(one.part.flight)]
        driven = [
            (count + i, n.name, n.step if values[n.name] + n.step <= n.high else -n.step)
            for i, n in acting
            if n.name in self._driving
        ]
        driven += [(i, p.name, _OF_AIRSPEED[p.name]) for i, p in enumerate(self.parameters) if p.name in _OF_AIRSPEED]
        records = [
            (self._driven(one, {**values, name: values[name] + step}, predictor.records[0], name in OF_SURFACES), step)
            for _, name, step in driven
        ]
        local = np.concatenate((theta[:count], states[self.free_states]))
        S = predictor.derivatives(0, local, states, self._all(y), driven=records, outputs=self.outputs)
        read = self._read(one, values, np.concatenate((S, y[:, :, None]), axis=2))
        result = np.zeros((len(self.outputs), one.measured.shape[1], self.size))
        result[:, :, :count] = read[:, :, :count]
        width = len(self.free_states)
        begin = len(self.names) + index * width
        result[:, :, begin : begin + width] = read[:, :, count : count + width]
        base = read[:, :, -1]
        for place, (i, _, _) in enumerate(driven, count + width):
            result[:, :, i] += read[:, :, place]
        for i, nuisance in acting:
            if nuisance.name not in self._driving:
                other, moved = {**values, nuisance.name: values[nuisance.name] + nuisance.step}, y
                if nuisance.name in _SHAPING:
                    moved = self._ideal(one, other, theta, states, predictor.records[0])[0]
                result[:, :, count + i] = (self._read(one, other, moved[:, :, None])[:, :, 0] - base) / nuisance.step
        return result

    def _copied(self) -> GroupModel:
        other = copy.copy(self)
        other._slopes = {}
        return other

    def _shaped(self, values: Mapping[str, float]) -> PackedModel:
        """The flat model with what the nuisances add to the vehicle's constants."""
        added = {place: values[name] for name, place in _SHAPING.items() if values.get(name)}
        if not added:
            return self.flat
        flat = self.flat.copy()
        for place, value in added.items():
            flat.P[place] += value
        return flat

    def _values(self, index: int, theta: Array) -> dict[str, float]:
        count = len(self.parameters)
        found = self.unknowns.values(theta[count : count + len(self.unknowns.names)], self.parts[index].flight)
        for effect in self._model.effects:
            known = {key: entry.value for key, entry in effect.parameters.items() if entry.value is not None}
            found |= {f"{effect.name}.{key}": value for key, value in known.items()}
        return found | {one.name: value for one, value in zip(self.parameters, theta[:count].tolist(), strict=True)}

    def _states(self, index: int, theta: Array) -> Array:
        states, width = self._prepared[index].start.copy(), len(self.free_states)
        begin = len(self.names) + index * width
        states[self.free_states] = theta[begin : begin + width]
        return states

    def _all(self, y: Array) -> Array:
        full = np.zeros((y.shape[0], len(OUTPUTS)))
        full[:, self._columns] = y
        return full

    def _take(self, parts: Sequence[FlightPart]) -> None:
        """Go by these parts, on their own grid and, for slopes and searches that are far from their end, on half."""
        self.parts = tuple(parts)
        # What drove the last simulations: candidates are compared at one place.
        self._records: dict[tuple[object, ...], Record] = {}
        self._prepared = [self._prepare(part, *self._compared(part)) for part in parts]
        self._coarse = [self._prepare(one.part.thinned(), one.joined, one.measured) for one in self._prepared]

    def _compared(self, part: FlightPart) -> tuple[dict[str, sparse.csr_array], Array]:
        """Matrices from the stamps of each output to the common grid, and what was measured there, (m, K)."""
        common = part.common
        channels = {name: part.channels[name] for name in self.outputs}
        joined = {name: common.bridged(joined_at(one.time_s, common.points)) for name, one in channels.items()}
        return joined, np.array([joined[name] @ one.values for name, one in channels.items()])

    def _prepare(self, part: FlightPart, joined: Mapping[str, sparse.csr_array], measured: Array) -> _Prepared:
        n = part.grid.size
        record = Record(
            part.flight, float(part.grid[1] - part.grid[0]), part.grid, 0, np.zeros((n, 4)), part.thrust, part.rho,
            np.full((n, len(OUTPUTS)), np.nan), np.full((n, 9), np.nan),
        )  # fmt: skip
        fixed = {
            name: sparse.csr_array(between @ read_at(part.grid, part.channels[name].time_s))
            for name, between in joined.items()
        }
        vane = vane_reading(part, FLOW_OF[self.group]) if self.flow_imposed else None
        states = self._imposed(part, self.unknowns.values(self.unknowns.mean, part.flight), vane)
        start = states[: max(1, round(0.1 / record.interval_s))].mean(axis=0)
        return _Prepared(part, record, start, fixed, joined, measured, vane)

    def _imposed(self, part: FlightPart, values: Mapping[str, float], vane: VaneReading | None) -> Array:
        """(N, 9) u v w p q r phi theta psi of a part, air data corrected by the nuisances."""
        motion = dict(part.motion)
        if vane is not None:
            read = vane.at_centre(self.vehicle.sensors, values)
            motion[vane.name] = self._given.flow * read + self._given.flow_zero
        alpha = motion["alpha"] - values.get("alpha_offset", 0.0)
        speed = _airspeed(part, values)
        slow = motion["slow_alpha"]
        speed = speed * (1.0 - values.get("airspeed_alpha", 0.0) * (slow - float(np.mean(slow))))
        beta = motion["beta"]
        flow = (np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta))
        phi = motion["phi"] - values.get("phi_offset", 0.0)
        theta = motion["theta"] - values.get("theta_offset", 0.0)
        rows = (*(speed * one for one in flow), motion["p"], motion["q"], motion["r"], phi, theta, np.zeros_like(phi))
        return np.ascontiguousarray(np.stack(rows, axis=1))

    def _driven(
        self,
        one: _Prepared,
        values: Mapping[str, float],
        before: Record | None = None,
        by_servo: bool = True,
    ) -> Record:
        """The record with commands behind their servos, and the motion that is imposed.

        before: a record of which only the commands change (by_servo), or only what is imposed.
        """
        if before is None:
            key = (id(one), frozenset(self._surfaces), *(values.get(name) for name in _CHANGES_INPUT))
            if key not in self._records:
                while len(self._records) >= _MOST_RECORDS:
                    self._records.pop(next(iter(self._records)))
                self._records[key] = self._moved(one, values, self._commands(one, values))
            return self._records[key]
        if by_servo:
            commands, seen = self._commands(one, values)
            return replace(before, commands=commands, seen=seen)
        return self._moved(one, values, (before.commands, before.seen))

    def _moved(self, one: _Prepared, values: Mapping[str, float], surfaces: tuple[Array, Array]) -> Record:
        imposed = self._imposed(one.part, values, one.vane)
        imposed[:, self.free_states] = np.nan
        thrust = one.record.thrust * (1.0 - values.get("thrust_error", 0.0))
        commands, seen = surfaces
        return replace(one.record, commands=commands, seen=seen, imposed_states=imposed, thrust=thrust)

    def _commands(self, one: _Prepared, values: Mapping[str, float]) -> tuple[Array, Array]:
        """(N, 4 + named) means of what the surfaces did over each step, the throttle, and controls of other names; and
        what sensors see of them at its begin.
        """
        part, named = one.part, self.vehicle.named_inputs
        n, step = part.grid.size, one.record.interval_s
        commands = np.zeros((n, 4 + len(named)))
        seen = commands.copy()
        for j, name in enumerate((*SURFACES, "", *named)):
            if name in part.inputs and name in (*self._surfaces, *MOTOR_MOMENTS):
                servos = servo_of(self.vehicle, name, [values[key] for key in OF_SURFACES], part.inputs)
                moved = surface_motion(part.inputs[name], part.grid[0], step, n, servos)
                gain, bias = self._given.gains.get(name, 1.0), self._given.biases.get(name, 0.0)
                commands[:, j], seen[:, j] = gain * moved.means + bias, gain * moved.seen + bias
        if "throttle" in part.inputs:
            commands[:, 3] = seen[:, 3] = part.inputs["throttle"].at(part.grid)
        return commands, seen

    def _ideal(
        self,
        one: _Prepared,
        values: Mapping[str, float],
        theta: Array,
        states: Array,
        record: Record | None = None,
    ) -> tuple[Array, Predictor]:
        """(N, m) what ideal sensors read on the grid, and what it was predicted by. record: what drives it."""
        record = self._driven(one, values) if record is None else record
        predictor, flat = self._predictor(one, values, theta, record)
        return predictor.outputs(0, flat, {}, states)[:, self._columns], predictor

    def _predictor(
        self, one: _Prepared, values: Mapping[str, float], theta: Array, record: Record
    ) -> tuple[Predictor, PackedModel]:
        predictor = Predictor(self._shaped(values), self.parameters, [record], sub_steps=1, tangent_steps=1)
        return predictor, predictor.apply(theta[: len(self.parameters)])[0]

    def _read(self, one: _Prepared, values: Mapping[str, float], y: Array) -> Array:
        """(m, K, C) on the common grid of ideal readings (N, m, C), vanes swinging: a linear map of every column."""
        moving = values.get(MOVING_MASS, 0.0) if one.part.thrust_from == "thrust" else 0.0
        if moving != 0.0 and "ax" in self.outputs:
            # A force sensor reads the thrust less moving * ax: m ax = force + moving ax, ax the simulated one.
            y = y.copy()
            y[:, self.outputs.index("ax"), :] *= self.vehicle.mass.mass / (self.vehicle.mass.mass - moving)
        for nuisance, read, by in (("accelerometer_tilt", "ax", "az"), ("gyro_tilt", "r", "p")):
            tilt = values.get(nuisance, 0.0)
            if tilt != 0.0 and {read, by} <= set(self.outputs):
                y = y.copy()
                with np.errstate(invalid="ignore"):  # a motion that has diverged is no number, and is judged so
                    y[:, self.outputs.index(read), :] += tilt * y[:, self.outputs.index(by), :]
        result = np.empty((y.shape[1], one.measured.shape[1], y.shape[2]))
        for j, name in enumerate(self.outputs):
            column = np.ascontiguousarray(y[:, j, :])
            if name not in _VANES:
                result[j] = one.fixed[name] @ column
                continue
            column = column * values[f"{name}_scale"]
            if values["vane_period"] != 0.0:
                speed = one.part.airspeed.values
                period = values["vane_period"] * float(np.median(speed)) / speed
                swing(column, period, one.record.interval_s, float(np.exp(values["vane_log_damping"])))
            clock = values["vane_clock"]
            if clock == 0.0:
                result[j] = one.fixed[name] @ column
            else:
                stamps = one.part.channels[name].time_s - clock
                result[j] = one.joined[name] @ (read_at(one.part.grid, stamps) @ column)
        return result


def servo_of(
    vehicle: Vehicle, name: str, common: Sequence[float], inputs: Mapping[str, InputSignal]
) -> Sequence[float]:
    """Delay [s], lag [s], backlash [rad] and share of the rounding of the servo of one control: of one of another name
    as the vehicle file states it; the servos of all surfaces in `common` where it says nothing. Of several motors the
    throttles are behind their lags already.
    """
    if name in MOTOR_MOMENTS or name in vehicle.motors:
        return (0.0, 0.0, 0.0, 0.0)
    control = vehicle.controls.get(name) if name in vehicle.named_controls else None
    if control is None:
        return common
    if control.signal == "position":
        return (0.0, 0.0, 0.0, 0.0)
    stated = (control.delay.value, control.lag.value, control.backlash.value)
    if all(value is None for value in stated):
        # Surfaces whose commands are held and yet smooth are taken as a curve, whose delay is half a sample longer.
        curved = any(inputs[one].kind == "splined" for one in SURFACES if one in inputs)
        half = 0.5 * float(np.median(np.diff(inputs[name].time_s))) if curved and inputs[name].kind == "held" else 0.0
        return (common[0] - half, *common[1:])
    return (*(value or 0.0 for value in stated), common[3])


def _airspeed(part: FlightPart, values: Mapping[str, float]) -> Array:
    """(N,) true airspeed of a part, m/s, by what nuisances and effects make of the reading."""
    scale, bias, tau, density = (values.get(name, 0.0) for name in _OF_AIRSPEED)
    late = values.get("airspeed_lag", part.airspeed.lag) + tau - part.airspeed.lag
    speed = part.airspeed.values + late * part.airspeed.by_lag
    speed = speed * (1.0 - values.get("airspeed_error", 0.0)) - bias
    return np.asarray(speed / ((1.0 + scale) * np.sqrt(1.0 + density)))


def _stepping(part: FlightPart, unknowns: Unknowns) -> bool:
    at_once = all(unknowns.fixed.get(name) == 0.0 for name in SERVO)
    return at_once and any(part.inputs[name].kind == "held" for name in SURFACES if name in part.inputs)

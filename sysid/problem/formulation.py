"""The estimation problem of prepared flights: runs, start values, what is known before."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, correct
from sysid.compatibility.selection import LIMITS
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.command_order import command_shows_at_once
from sysid.equation_error.dead_surfaces import part_of
from sysid.equation_error.time_domain import equation_error
from sysid.errors import EstimationError, SysidError
from sysid.numerics.gaussian import Gaussian, known_from
from sysid.problem.coefficient_residuals import known_propulsion
from sysid.problem.estimation_problem import (
    MAX_RUN_S,
    Motion,
    Problem,
    excited_motion,
    free_coefficients,
    relevant_sensors,
    split_runs,
)
from sysid.problem.free_run import Fixed
from sysid.problem.model_structure import usual_size
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared
from sysid.signals.record import SURFACES

# The air data scale is determined by GPS in the compatibility check, which the output-error step does not see again.
_FROM_COMPATIBILITY = ("airspeed_scale", "airspeed_bias")


def make_problem(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    sensors: Sequence[str] | None = None,
    run_s: float = MAX_RUN_S,
    ground: bool = False,
    dead: Mapping[str, str] | None = None,
) -> Problem:
    """Estimation problem of all stretches: runs, start states from the reconstruction, sensor errors to estimate.

    sensors: names to estimate; None takes those that the compatibility check can identify. run_s: longest free run, s.
    ground: whether velocity over ground, where measured, counts in a motion that is free in all axes though no vane is
    missing; else it counts for the air data alone, by what the compatibility check made of it. dead: surfaces that
    were not recorded and what was reported of them; their part of the motion is taken from the measurement.
    Raises EstimationError where that leaves nothing to be simulated.
    """
    stretches = [stretch for flight in prepared for stretch in flight.stretches]
    motion = excited_motion([stretch.record for stretch in stretches], {part_of(name) for name in dead or {}})
    if dead and not (motion.longitudinal or motion.lateral):
        raise EstimationError("; ".join(dead.values()))
    if ground and motion.longitudinal and motion.lateral and "wind_north" in compatible.parameters:
        motion = replace(motion, ground=True)
    runs, paths = [], []
    for stretch, found in zip(stretches, compatible.states, strict=True):
        states = dict(found)
        psi = stretch.data.columns.get("psi")
        states.setdefault("psi", np.zeros(stretch.record.length) if psi is None else psi)
        part_runs, part_paths = split_runs(stretch.record, states, motion, run_s)
        runs += part_runs
        paths += part_paths
    known = compatible.parameters
    names = relevant_sensors(list(known) if sensors is None else sensors, motion)
    # The same readings must not count twice.
    with_prior = () if motion.ground else _FROM_COMPATIBILITY
    priors = {n: (known[n].value, known[n].std) for n in names if n in known and n in with_prior}
    start = {name: known[name].value if name in known else 0.0 for name in names}
    at_once = command_shows_at_once(corrected_parts(prepared, vehicle, compatible), body_of(vehicle))
    first = timing_of(prepared, at_once)
    guesses = tuple(path[0].copy() for path in paths)
    return Problem(vehicle, tuple(runs), guesses, motion, start, priors, first, paths=tuple(paths))


def timing_of(prepared: Sequence[Prepared], at_once: bool) -> float:
    """Share of the command of a sample, beside that of the one before, in what is read at it (`command_first` of
    sim_vehicle.physics.simulation.simulate). at_once: where commands are held.
    """
    joined = any(stretch.record.joined for flight in prepared for stretch in flight.stretches)
    return 0.5 if joined else float(at_once)


def with_unclear_sensors(problem: Problem, refused: Sequence[str]) -> Problem:
    """The problem with those sensor errors as unknowns that kinematics could not identify (`refused`), each as far as
    it is known of such sensors.

    A pitch offset and an accelerometer's bias look alike to kinematics; the aircraft's own motion distinguishes them,
    and one that is held at zero though it is identifiable would go into the coefficients.
    """
    more = [
        name for name in relevant_sensors(refused, problem.motion) if name in LIMITS and name not in problem.sensors
    ]
    priors = {name: (0.0, LIMITS[name].std) for name in more}
    sensors = {**problem.sensors, **dict.fromkeys(more, 0.0)}
    return replace(problem, sensors=sensors, priors={**problem.priors, **priors}) if more else problem


def corrected_parts(
    prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult
) -> list[FlightData]:
    """Stretches with sensor errors taken off and thrust known, for equation error."""
    parts = []
    flat = flatten(vehicle, Model(vehicle.name, {}))
    errors = {name: error.value for name, error in compatible.parameters.items()}
    index = 0
    for flight in prepared:
        for stretch in flight.stretches:
            record = stretch.record
            data = correct(stretch.data, compatible, index)
            here = slice(record.start, record.start + record.length)
            thrust, torque = known_propulsion(record, Fixed(flat, errors), data["V"])
            columns = {**data.columns, "thrust": thrust, "torque": torque, "air_density": record.rho[here]}
            columns |= {
                name: (record.positions if record.positions.size and name in SURFACES else record.commands)[here, j]
                for j, name in enumerate((*SURFACES, "throttle", *record.named))
                if name not in MOTOR_MOMENTS
            }
            columns.setdefault("beta", np.zeros(record.length))
            parts.append(replace(data, columns=columns))
            index += 1
    return parts


def start_model(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    structure: Model,
    motion: Motion,
    prior: Model | None,
) -> Model:
    """Start values: equation error, a prior model where that fails, the usual size of nothing elsewhere."""
    values = dict.fromkeys(structure.coefficients, 0.0)
    stds: dict[str, float] = dict.fromkeys(structure.coefficients, math.inf)
    if prior is not None:
        values |= {name: value for name, value in prior.values().items() if name in values}
    names = free_coefficients(list(structure.coefficients), motion)
    try:
        for axis in equation_error(corrected_parts(prepared, vehicle, compatible), body_of(vehicle), names).values():
            for name, value, std in zip(axis.names, axis.values, axis.std, strict=True):
                # An estimate worse than knowing nothing is a bad start.
                if std < 2.0 * usual_size(name):
                    values[name], stds[name] = float(value), float(std)
    except SysidError:
        if prior is None:
            raise
    entries = {
        name: Coefficient(value, stds[name] if math.isfinite(stds[name]) else None) for name, value in values.items()
    }
    return replace(structure, coefficients=entries, correlation=None)


def known_before(prior: Model | None, structure: Model, warnings: list[str]) -> Gaussian | None:
    """What a prior model says of the coefficients and effects of the structure."""
    if prior is None:
        return None
    known, warning = known_from(prior)
    if warning:
        warnings.append(warning)
    if known is None:
        return None
    effects = [f"{effect.name}.{key}" for effect in structure.effects for key in effect.parameters]
    names = [*structure.coefficients, *effects]
    strange = [name for name in known.names if name not in names]
    if strange:
        warnings.append(f"the prior's {', '.join(strange)} is no part of the structure and is left out")
    return known.of(names)

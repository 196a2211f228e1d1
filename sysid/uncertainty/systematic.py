"""What errors of the vehicle file would do to the coefficients: the column beside the statistical error.

Each perturbation changes what the estimator was given, not what was measured. Where the changed model fits as well as
the first one did (mass, inertia, density, linkage), one Gauss-Newton step for a thousandth of the change gives where
the estimate would move, to first order: the change moves the residuals, and hardly the sensitivities. Late commands do
not fit, which moves the weights of the outputs as well: there the estimation is repeated, on runs from all over a long
flight, since how far it moves hardly depends on how long one flew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle, stronger
from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.fractional_delay import held_back
from sysid.numerics.normal_equations import damped_step, gram
from sysid.output_error.from_problem import build, fit, warmed
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.problem.estimation_problem import Problem
from sysid.problem.vehicle_errors import DENSITY, DENSITY_SHARE, doubts_of_mass, heavier
from sysid.signals.record import Record, angle_wrap
from sysid.signals.thrust.source import BATTERY, THRUST_BY_SQUARE

DELAY_S = 0.010  # s by which commands may be late without anybody's knowing
SHARE = 1e-3  # of each perturbation, over which the estimate moves linearly


@dataclass(frozen=True)
class Perturbation:
    """A change of what the estimator is given: SHARE of what its name in results says."""

    name: str
    vehicle: Callable[[Vehicle], Vehicle] = lambda vehicle: vehicle
    record: Callable[[Record], Record] = lambda record: record


def _denser(record: Record) -> Record:
    return replace(record, rho=(1.0 + DENSITY_SHARE * SHARE) * record.rho)


def _more_travel(record: Record) -> Record:
    more = 1.0 + 0.05 * SHARE
    record = record.with_surfaces(lambda surfaces: more * surfaces)
    commands = record.commands.copy()
    commands[:, 4:] *= more
    return replace(record, commands=commands)


def _stronger(vehicle: Vehicle) -> Vehicle:
    return stronger(vehicle, 1.05)


def _stronger_known(record: Record) -> Record:
    """Thrust that followed from the propeller's speed or the battery's power before the simulation."""
    source = record.thrust_source
    if source.law != THRUST_BY_SQUARE and source.signal != BATTERY:
        return record
    return replace(record, thrust=(1.0 + source.std) * record.thrust)


def _later_commands(record: Record) -> Record:
    """Commands that come later: a held one changes between samples, so each sample gets the mean of what it holds."""
    commands, positions = (held_back(one, DELAY_S, record.interval_s) for one in (record.commands, record.positions))
    return replace(record, commands=commands, positions=positions)


_DENSITY = Perturbation(DENSITY, record=_denser)
# Where the vehicle file does not say how well linkages are known: the bars hold what it says.
LINKAGE = Perturbation("linkage_5pct", record=_more_travel)
# Where thrust is not measured: a propeller's published coefficients hold to about this for the next one of its kind. It
# is the whole of it.
THRUST = Perturbation("thrust_5pct", vehicle=_stronger, record=_stronger_known)
BATTERY_THRUST = Perturbation("battery_efficiency", record=_stronger_known)
LATE = Perturbation("timing_10ms", record=_later_commands)  # the whole of it
_REPEATED_STEPS = 12  # of Gauss-Newton, from the estimate
# Seconds of flight on which an estimation is repeated.
_REPEATED_S = 60.0
# Least information of these runs on each parameter, over what an equal share of the whole flight holds on average.
_LEAST_INFORMATION = 0.3


def linear(vehicle: Vehicle) -> tuple[Perturbation, ...]:
    """Those that move the estimate linearly, whatever the thrust came from."""
    controls = [one for name, one in vehicle.controls.items() if name != "throttle"]
    of_mass = [
        Perturbation(name, vehicle=partial(heavier, by=change, share=SHARE))
        for name, change in doubts_of_mass(vehicle).items()
    ]
    unstated = not any(one.gain_std or one.bias_std for one in controls)
    return (*of_mass, _DENSITY, *((LINKAGE,) if unstated else ()))


def repeated(records: Sequence[Record]) -> tuple[Perturbation, ...]:
    """Those that do not fit, with which an estimation is made again: the thrust's only where it was not measured."""
    unmeasured = {record.thrust_source.doubt for record in records if not record.thrust_source.measured}
    return (LATE, *(one for one in (THRUST, BATTERY_THRUST) if one.name in unmeasured))


def systematic_errors(here: OutputErrorLinearisation) -> dict[str, dict[str, float]]:
    """Change of every estimated parameter under each perturbation: parameter -> perturbation -> change.

    At the estimate before the noise of thrust and propeller speed is taken out, which hardly moves the slopes. Of what
    is repeated NaN for late commands, and nothing for thrust, where the estimation, or the one beside it on the same
    runs, came to no end.
    """
    result, theta = here.result, here.result.theta
    values = {parameter.name: float(v) for parameter, v in zip(result.parameters, theta, strict=False)}
    start = warmed(here.problem, result)
    moved: dict[str, dict[str, float]] = {name: {} for name in values}
    information, _ = here.normal
    changes = linear(start.vehicle)
    shifts = []
    for change in changes:
        changed = replace(
            start, vehicle=change.vehicle(start.vehicle), records=tuple(map(change.record, start.records))
        )
        after = build(changed, here.model, here.coefficients, here.effects, result.sigma).predict(theta)
        shifts.append(_shifts(start, here.predicted, after))
    for change, downhill in zip(changes, here.gradient_changes(shifts).T, strict=True):
        step = damped_step(information, downhill, 0.0, start.records[0].flight)
        for i, name in enumerate(values):
            moved[name][change.name] = float(step[i]) / SHARE
    again = _moved_by_repeated(_some_runs(here, start), start, here.model, here.coefficients, here.effects, values)
    for name in values:
        moved[name] |= {change: shifts[name] for change, shifts in again.items()}
        moved[name].setdefault(LATE.name, math.nan)
    return moved


def _moved_by_repeated(
    some: Problem,
    whole: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    values: dict[str, float],
) -> dict[str, dict[str, float]]:
    """Change of every parameter under each of `repeated`, estimated on `some` runs of the `whole`; without those that
    do not come to an end.
    """
    found: dict[str, dict[str, float]] = {}
    if some is not whole:
        with suppress(EstimationError):
            unchanged = fit(some, model, coefficients, effects, values, max_iterations=_REPEATED_STEPS)
            if unchanged.converged:
                values, whole = {name: unchanged.value(name) for name in values}, some
        if whole is not some:
            return found
    for change in repeated(some.records):
        changed = replace(some, vehicle=change.vehicle(some.vehicle), records=tuple(map(change.record, some.records)))
        with suppress(EstimationError):
            again = fit(changed, model, coefficients, effects, values, max_iterations=_REPEATED_STEPS)
            if again.converged:
                found[change.name] = {name: again.value(name) - value for name, value in values.items()}
    return found


def _some_runs(here: OutputErrorLinearisation, problem: Problem) -> Problem:
    """The problem with runs of some _REPEATED_S, evenly spread over its flights.

    The problem itself comes back where it is no longer, or where those runs do not hold the information on every
    parameter that they should: one axis may have been flown in the others.
    """
    total_s = sum(record.length * record.interval_s for record in problem.records)
    if total_s <= _REPEATED_S:
        return problem
    count, share = len(problem.records), _REPEATED_S / total_s
    kept = np.unique(np.linspace(0.0, count - 1.0, max(1, round(count * share))).round().astype(int))
    columns, sigma, p = here.estimation.columns, here.result.sigma, len(here.result.parameters)
    information = sum(np.diag(gram(here.S[k], problem.records[k].z, columns, sigma)[0])[:p] for k in kept)
    whole_information = np.diag(here.normal[0])[:p] - np.diag(here.estimation.prior_information)
    if np.any(information < _LEAST_INFORMATION * share * whole_information):
        return problem
    return replace(
        problem,
        records=tuple(problem.records[k] for k in kept),
        guesses=tuple(problem.guesses[k] for k in kept),
        paths=tuple(problem.paths[k] for k in kept) if problem.paths else (),
    )


def _shifts(problem: Problem, before: Sequence[Array], after: Sequence[Array]) -> list[Array]:
    """What a change of the predictions adds to the residuals of each record; NaN where nothing was measured."""
    return [
        np.where(np.isfinite(record.z), angle_wrap(old - new), np.nan)
        for record, old, new in zip(problem.records, before, after, strict=True)
    ]


def systematic_in_turbulence(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: FilterErrorResult,
) -> dict[str, dict[str, float]]:
    """Change of every estimated parameter under each error of the vehicle file (sysid.uncertainty.systematic), to first
    order.
    """
    names = [parameter.name for parameter in result.parameters]
    # What the estimate itself would still move by, its iteration having stopped, is no effect of a change.
    unfinished = build_filter(problem, model, coefficients, effects).step_at(result)
    moved: dict[str, dict[str, float]] = {name: {} for name in names}
    changes = [*((one, SHARE) for one in linear(problem.vehicle)), *((one, 1.0) for one in repeated(problem.records))]
    for change, share in changes:
        changed = replace(
            problem, vehicle=change.vehicle(problem.vehicle), records=tuple(map(change.record, problem.records))
        )
        step = build_filter(changed, model, coefficients, effects).step_at(result) - unfinished
        for name, value in zip(names, step, strict=True):
            moved[name][change.name] = float(value) / share
    return moved

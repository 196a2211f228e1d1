"""How flights are posed to filter error: sensor errors beside every model, and the timing of the commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.innovations.candidate_fits import FittedModel
from sysid.discrepancy.innovations.lack_of_fit import lack_of_fit
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.filter_error.thrust_noise import with_thrust_errors
from sysid.problem.estimation_problem import MAX_RUN_S, Problem, model_of
from sysid.problem.formulation import make_problem
from sysid.signals.preparation import Prepared

# Sensor errors estimated beside every model: those that change with every power-up, and the vanes', which no effect can
# be distinguished from. Then what a bench calibration leaves of the airspeed, with its usual size.
NUISANCE = (
    "accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r", "alpha_scale",
    "alpha_bias", "beta_scale", "beta_bias",
)  # fmt: skip
# Standard errors of a calibrated airspeed's bias, m/s, and scale.
BENCH = {"airspeed_bias": 0.02, "airspeed_scale": 0.002}
WIND = ("wind_north", "wind_east", "wind_down")
# Beyond so many times that size it is an effect of its own and must compete with the others.
BENCH_LIMIT = 5.0
# Integration steps per sample: with servos that lag, fewer are off by several standard errors of a calm flight.
SUB_STEPS = 5
# Log likelihood by which the other timing of the commands must be better.
_TIMING = 5.0


def timed(
    problem: Problem, model: Model, names: Sequence[str], effects: Sequence[tuple[str, str]], before: FilterErrorResult
) -> tuple[Problem, FilterErrorResult]:
    """The likelier timing of the commands with the estimate, if it explains the flight: else a delay may be what is
    missing.
    """
    if 0.0 < problem.command_first < 1.0:
        return problem, before
    other = replace(problem, command_first=1.0 - problem.command_first)
    try:
        again = build_filter(other, model, names, effects).solve(before.values(), before.turbulence, known=before)
        if again.cost > before.cost - _TIMING:
            return problem, before
        again = build_filter(other, model, names, effects).solve(again.values(), before.turbulence, brief=True)
    except EstimationError:
        return problem, before
    refitted = model_of(model, model.name, again, names, effects, (), model.validity)
    return (problem, before) if lack_of_fit(other, FittedModel(refitted, names, effects, again)) else (other, again)


def sensors_alone(problem: Problem, model: Model, before: FilterErrorResult) -> FilterErrorResult:
    """Sensor errors with the model as given, noise and turbulence as known; those of `before` where that diverges."""
    try:
        start = {name: before.value(name) for name in problem.sensors}
        return build_filter(problem, model, ()).solve(start, before.turbulence, known=before)
    except EstimationError:
        return before


def posed(prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult) -> Problem:
    """The flights with the sensor errors that are estimated beside every model."""
    problem = make_problem(prepared, vehicle, compatible, [*NUISANCE, *BENCH, *WIND], MAX_RUN_S, ground=True)
    start = {name: 0.0 if name in BENCH else value for name, value in problem.sensors.items()}
    priors = {name: (0.0, std) for name, std in BENCH.items() if name in start}
    return with_thrust_errors(replace(problem, sensors=start, priors=priors, sub_steps=SUB_STEPS), prepared)


def without_bench(problem: Problem) -> Problem:
    """The problem with the airspeed taken as it reads."""
    sensors = {name: value for name, value in problem.sensors.items() if name not in BENCH}
    return replace(problem, sensors=sensors, priors={})


def is_beyond_bench(result: FilterErrorResult, problem: Problem) -> bool:
    """Whether the airspeed is further off than a bench calibration leaves it."""
    return any(abs(result.value(name)) > BENCH_LIMIT * std for name, std in BENCH.items() if name in problem.sensors)

"""Which maximum-likelihood method a flight gets: output error in calm air, filter error in turbulence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim_vehicle.model.model_file import Model
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.compatibility.selection import Refusal
from sysid.errors import EstimationError
from sysid.filter_error.delay_scan import estimate_with_delay
from sysid.filter_error.estimation import estimate_in_turbulence, is_turbulent
from sysid.filter_error.estimator import FilterErrorResult
from sysid.output_error.command_order import likelier_timing
from sysid.output_error.delay_selection import LagOrDelay, lag_or_delay, with_told_delays
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.linearisation import Linearised
from sysid.output_error.sensor_selection import with_told_sensors
from sysid.output_error.single_sensor_faults import told_by_motion
from sysid.output_error.structure_error import Widened, widened
from sysid.problem.delay_parameters import COMMAND_DELAY, SENSOR_DELAYS
from sysid.problem.problem import Likeliest, Problem, Progress
from sysid.signal_check.fault import Mistake
from sysid.signals.delay import COMMANDS, Delay
from sysid.uncertainty.bench_errors import BenchError, carry, carry_filtered, late_commands, misled
from sysid.uncertainty.nuisances import Disturbed
from sysid.uncertainty.systematic import systematic_errors, systematic_in_turbulence
from sysid.uncertainty.thrust_noise import with_input_noise, with_thrust_by_airspeed

# Gusts up to this level, m/s, may be what a mistake of a single sensor leaves.
_FEIGNED = 0.1


@dataclass(frozen=True)
class MaximumLikelihood:
    """An estimate, the problem it solves, and how.

    method: "oe" or "fe". refused: sensor errors that the flight cannot tell beside the coefficients. warnings: in
    words. wider: what was solved in place of `problem` where the flight shows aerodynamics outside the structure.
    delays: what the estimate adds to those that the data were corrected for. mistakes: of single sensors, which the
    estimate does not know of. linearised: of output error without mistakes, where the last step started, the noise of
    the inputs not yet taken out.
    """

    problem: Problem
    result: OutputErrorResult | FilterErrorResult
    method: str
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...]
    from_bench: Mapping[str, Mapping[str, float]]
    wider: Widened | None = None
    delays: tuple[Delay, ...] = ()
    mistakes: tuple[Mistake, ...] = ()
    linearised: Linearised | None = field(default=None, repr=False)

    @property
    def estimate(self) -> Likeliest:
        """The result, whichever method gave it."""
        return self.result


def maximum_likelihood(
    problem: Problem,
    turbulent: Callable[[], Problem],
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    bench: Sequence[BenchError] = (),
    *,
    held: Sequence[BenchError] = (),
    delays: Sequence[Delay] | None = None,
    singles: bool = False,
    late_model: Model | None = None,
    method: str = "auto",
    sensors: Sequence[str] | None = None,
    progress: Progress = lambda share, text: None,
) -> MaximumLikelihood:
    """Estimate coefficients, effect parameters and sensor errors together.

    problem: of the flight, cut into runs that a free simulation follows. turbulent: gives the same in longer runs, for
    filter error. method: "oe", "fe", or "auto", which takes filter error where kinematics saw turbulence and the
    innovations confirm it. sensors: sensor errors asked for; None lets the flight decide. bench: errors of
    calibrations. held: of a motion that output error takes from the measurement
    (sysid.uncertainty.reconstruction_errors). delays: those that the data are corrected for, to which the motion may
    add; None leaves time as it is. singles: whether to ask for mistakes of single sensors; where there are any the
    estimate ends there. late_model: start values with the delay of the commands that `problem` starts from, where they
    differ. Raises EstimationError where the method asked for fails.
    """
    warnings: list[str] = []
    wanted = method == "fe" or (method == "auto" and compatible.gust_sigma > 0.0)
    # A late sensor leaves what looks like faint gusts, which then would stand in the way of finding it.
    singles = singles and compatible.gust_sigma < _FEIGNED
    if wanted and singles and method == "auto":
        mistaken = _mistaken(problem, late_model or model, coefficients, effects, bench)
        if mistaken is not None:
            return mistaken
    if wanted:
        suspected = problem.delays.get(COMMAND_DELAY)
        models, longer = (model, late_model or model), turbulent()
        try:
            found = _filtered(
                longer, models, coefficients, effects, compatible, bench, sensors, suspected, method, progress
            )
        except EstimationError as error:
            if method == "fe":
                raise
            warnings.append(f"{_rough(compatible)}; {error}")
        else:
            if found is not None:
                return found
    elif method == "oe" and compatible.gust_sigma > 0.0:
        warnings.append(_rough(compatible) + "; use --method fe, or auto")
    unclear = [refusal.name for refusal in compatible.refused]
    told = sensors is None and compatible.gust_sigma == 0.0
    here = _in_still_air(problem, late_model or model, coefficients, effects, unclear if told else None, progress)
    return _finished(
        here, [*bench, *held], held, delays, singles, exact=not bench, warnings=warnings, progress=progress
    )


def _in_still_air(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    unclear: Sequence[str] | None,
    progress: Progress,
) -> Linearised:
    """The estimate by output error. unclear: sensor errors that kinematics refused; None takes those of the problem."""
    here = Linearised.fitted(problem, model, coefficients, effects, lambda s, t: progress(0.85 * s, t))
    if COMMAND_DELAY not in problem.delays:
        progress(0.9, "timing of the commands")
        here = likelier_timing(here)
    problem, result = here.problem, here.result
    problem, result = with_thrust_by_airspeed(problem, model, coefficients, effects, result)
    if unclear is not None:
        problem, result = with_told_sensors(problem, model, coefficients, effects, result, unclear)
    return here if result is here.result else replace(here, problem=problem, result=result)


def _finished(
    here: Linearised,
    errors: Sequence[BenchError],
    held: Sequence[BenchError],
    delays: Sequence[Delay] | None,
    singles: bool,
    *,
    exact: bool,
    warnings: list[str],
    progress: Progress,
) -> MaximumLikelihood:
    """The estimate with the delays that it tells, unless single sensors are mistaken, and with bars that count all.

    errors: of benches and of held motion. exact: whether no bench's error passes for aerodynamics.
    """
    late, alone = LagOrDelay(), tuple[Mistake, ...]()
    if delays is not None:
        progress(0.95, "delays")
        here = with_told_delays(here, _corrected(delays))
        late = lag_or_delay(here, sum(one.value for one in delays if one.of_commands))
        warnings += late.warnings
    disturbed = Disturbed(here, errors)
    problem, result = here.problem, here.result
    if delays is not None and singles:
        progress(0.96, "single sensors")
        alone = told_by_motion(here, disturbed.others)
    if alone:
        # Whatever comes next would take them for aerodynamics; the flight is estimated anew without them.
        left = _left(problem, result)
        return MaximumLikelihood(problem, result, "oe", late.refused, tuple(warnings), {}, None, left, alone)
    if not result.converged:
        warnings.append("output error did not converge; the standard errors may be too small")
    # What a bench's error or a law of the thrust does to the motion passes for aerodynamics, and has bars of its own.
    exact = exact and all(record.thrust_source.measured for record in problem.records)
    wider = None
    try:
        wider = widened(problem, here.model, here.coefficients, here.effects, result) if exact else None
    except EstimationError as error:
        text = "the flight shows what the structure does not hold, and the standard errors do not count it"
        warnings.append(f"{text}: {error}")
    if wider is not None:
        return _with_misfit(problem, wider, here.effects, late.refused, (*warnings, wider.warning()), held)
    problem, result = with_input_noise(here, disturbed.doubts)
    result, shares = carry(disturbed.misled, here, result)
    left = _left(problem, result)
    return MaximumLikelihood(problem, result, "oe", late.refused, tuple(warnings), shares, None, left, linearised=here)


def _mistaken(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    bench: Sequence[BenchError],
) -> MaximumLikelihood | None:
    """The estimate in still air, if it tells mistakes of single sensors that leave no gusts to be explained."""
    try:
        here = Linearised.fitted(problem, model, coefficients, effects)
        if COMMAND_DELAY not in problem.delays:
            here = likelier_timing(here)
    except EstimationError:
        return None
    alone = told_by_motion(here, Disturbed(here, bench).others)
    if not alone:
        return None
    return MaximumLikelihood(here.problem, here.result, "oe", (), (), {}, None, _left(here.problem, here.result), alone)


def _filtered(
    problem: Problem,
    models: tuple[Model, Model],
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    bench: Sequence[BenchError],
    sensors: Sequence[str] | None,
    suspected_s: float | None,
    method: str,
    progress: Progress,
) -> MaximumLikelihood | None:
    """The estimate by filter error; None where the air is calm after all and nothing else was asked for."""
    left: tuple[Delay, ...] = ()
    if suspected_s is not None:
        (solved, filtered, refused), left = estimate_with_delay(
            problem, models, coefficients, effects, compatible, sensors, suspected_s, progress
        )
    else:
        solved, filtered, refused = estimate_in_turbulence(
            problem, models[0], coefficients, effects, compatible, sensors, progress
        )
    if method != "fe" and not is_turbulent(filtered):
        return None
    warnings = () if filtered.converged else ("filter error did not settle; the standard errors may be too small",)
    errors = [*bench, *(late_commands(one.std) for one in left)]
    filtered, shares = carry_filtered(errors, solved, models[0], coefficients, effects, filtered)
    return MaximumLikelihood(solved, filtered, "fe", tuple(refused), warnings, shares, None, left)


def _left(problem: Problem, result: OutputErrorResult) -> tuple[Delay, ...]:
    """The delays among the unknowns, as estimated."""
    signals = {COMMAND_DELAY: COMMANDS, **SENSOR_DELAYS}
    return tuple(Delay(signals[name], result.value(name), result.std(name)) for name in problem.delays)


def _corrected(delays: Sequence[Delay]) -> list[str]:
    """Parameters that stand for what is left of delays that the data were corrected for."""
    late = [COMMAND_DELAY] if any(one.of_commands for one in delays) else []
    sensors = {name for one in delays for name in one.signals}
    return late + [name for name, outputs in SENSOR_DELAYS.items() if sensors >= set(outputs)]


def _with_misfit(
    problem: Problem,
    wider: Widened,
    effects: Sequence[tuple[str, str]],
    refused: tuple[Refusal, ...],
    warnings: tuple[str, ...],
    held: Sequence[BenchError],
) -> MaximumLikelihood:
    """The rest of output error where the flight shows aerodynamics that the structure of `problem` does not hold."""
    here = Linearised(wider.problem, wider.model, wider.coefficients, effects, wider.result)
    corrected, result = with_input_noise(here)
    result, _ = carry(misled(held, here), here, result)
    solved = replace(wider, problem=corrected, result=result)
    nearest = solved.projected(result)
    told = replace(corrected, known=problem.known)
    nothing: dict[str, dict[str, float]] = {parameter.name: {} for parameter in nearest.parameters}
    left = _left(corrected, result)
    return MaximumLikelihood(told, nearest, "oe", refused, warnings, nothing, solved, left, linearised=here)


def _rough(compatible: CompatibilityResult) -> str:
    return (
        f"turbulence of {compatible.gust_sigma:.2f} m/s: standard errors of output error may be half of what they are"
    )


def systematic(
    found: MaximumLikelihood, model: Model, coefficients: Sequence[str], effects: Sequence[tuple[str, str]]
) -> dict[str, dict[str, float]]:
    """What errors of the vehicle file would do to each estimate: parameter -> perturbation -> change."""
    if isinstance(found.result, FilterErrorResult):
        return systematic_in_turbulence(found.problem, model, coefficients, effects, found.result)
    assert found.linearised is not None  # output error leaves it
    changes = systematic_errors(found.linearised)
    return changes if found.wider is None else found.wider.projected_changes(changes)

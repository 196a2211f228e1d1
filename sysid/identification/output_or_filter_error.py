"""The maximum-likelihood methods of the books: output error in calm air, filter error in turbulence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.compatibility.selection import Refusal
from sysid.errors import EstimationError
from sysid.filter_error.estimation import estimate_in_turbulence
from sysid.filter_error.estimator import FilterErrorResult
from sysid.identification.result_model import with_extra, with_sources
from sysid.numerics.statistics import spectral_span
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.from_problem import fit, warmed
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.output_error.structure_error import WithExtraTerms, widened
from sysid.problem.estimation_problem import Likeliest, Problem, Progress
from sysid.problem.formulation import with_unclear_sensors
from sysid.signals.record import GROUND, OUTPUTS
from sysid.uncertainty.bench_errors import BenchError, carry, carry_filtered, is_of_linkage, is_of_surfaces, misled
from sysid.uncertainty.systematic import systematic_errors, systematic_in_turbulence
from sysid.uncertainty.thrust_noise import with_input_noise, with_thrust_by_airspeed

# Logarithm of the largest over the smallest density of what is left of an output, that white noise stays below: 0.5 to
# 1.1 in flights of the textbooks of 10 s and more, 3.5 and more on any other.
_COLOURED = 1.8


@dataclass(frozen=True)
class MaximumLikelihood:
    """An estimate, the problem it solves, and how.

    method: "oe" or "fe". refused: sensor errors that the flight cannot identify beside the coefficients. warnings: in
    words. from_bench: parameter -> source -> its share of the standard error. wider: what was solved in place of
    `problem` where the flight shows aerodynamics outside the structure. left_over: what output error has not explained,
    in words; its bars are too small then. whole_bars: whether it has come to its end, and bars count all that it sees.
    linearised: of output error, where the last step started, the noise of the
    inputs not yet taken out.
    """

    problem: Problem
    result: OutputErrorResult | FilterErrorResult
    method: str
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...]
    from_bench: Mapping[str, Mapping[str, float]]
    wider: WithExtraTerms | None = None
    left_over: str = ""
    whole_bars: bool = True
    linearised: OutputErrorLinearisation | None = field(default=None, repr=False)

    def bench_shares(self) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
        """What the bars hold of the bench, by parameter: of calibration curves, and of linkages, each by its source."""
        curves: dict[str, dict[str, float]] = {}
        linkages: dict[str, dict[str, float]] = {}
        for name, shares in self.from_bench.items():
            curves[name] = {source: abs(share) for source, share in shares.items() if not is_of_linkage(source)}
            linkages[name] = {source: share for source, share in shares.items() if is_of_linkage(source)}
        return curves, linkages

    @property
    def estimate(self) -> Likeliest:
        """The result, whichever method gave it."""
        return self.result


def maximum_likelihood(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    bench: Sequence[BenchError] = (),
    held: Sequence[BenchError] = (),
    method: str = "oe",
    sensors: Sequence[str] | None = None,
    progress: Progress = lambda share, text: None,
) -> MaximumLikelihood:
    """Estimate coefficients, effect parameters and sensor errors together.

    problem: of the flight, cut into runs that a free simulation follows, for filter error into longer ones. method:
    "oe" or "fe". sensors: sensor errors asked for; None lets the flight decide. bench: errors of calibrations. held: of
    a motion that output error takes from the measurement (sysid.uncertainty.reconstruction_errors). Raises
    EstimationError where the method fails.
    """
    if method == "fe":
        return _in_turbulence(problem, model, coefficients, effects, compatible, bench, sensors, progress)
    here = OutputErrorLinearisation.fitted(problem, model, coefficients, effects, lambda s, t: progress(0.85 * s, t))
    problem, result = with_thrust_by_airspeed(problem, model, coefficients, effects, here.result)
    warnings = []
    if compatible.gust_sigma > 0.0:
        warnings.append(
            f"turbulence of {compatible.gust_sigma:.2f} m/s: standard errors of output error may be half of what they"
            " are; use --method map, or fe"
        )
    elif sensors is None:
        richer = with_unclear_sensors(warmed(problem, result), [refusal.name for refusal in compatible.refused])
        if set(richer.sensors) != set(problem.sensors):
            values = {parameter.name: float(v) for parameter, v in zip(result.parameters, result.theta, strict=False)}
            fuller = fit(richer, model, coefficients, effects, values)
            problem, result = (richer, fuller) if fuller.converged else (problem, result)
    if result is not here.result:
        here = replace(here, problem=problem, result=result)
    found = _in_calm_air(here, bench, held, warnings)
    left = _left_over(found.problem, found.result)
    return replace(found, left_over=left, warnings=(*found.warnings, *([left] if left else [])))


def _in_calm_air(
    here: OutputErrorLinearisation, bench: Sequence[BenchError], held: Sequence[BenchError], warnings: list[str]
) -> MaximumLikelihood:
    """The estimate by output error, with bars that count all."""
    problem, result = here.problem, here.result
    whole = result.converged
    if not whole:
        warnings.append("output error did not converge; the standard errors may be too small")
    # What a curve's error or a law of the thrust does to the motion looks like aerodynamics, and has bars of its own;
    # where surfaces were, and when, does not.
    wider = None
    if all(is_of_surfaces(one.source) for one in bench) and all(
        record.thrust_source.measured for record in problem.records
    ):
        try:
            wider = widened(problem, here.model, here.coefficients, here.effects, result)
        except EstimationError as error:
            text = "the flight shows what the structure does not hold, and the standard errors do not count it"
            warnings.append(f"{text}: {error}; use --method map")
            whole = False
    if wider is not None:
        found = _with_misfit(problem, wider, here.effects, (*warnings, wider.warning()), bench, held)
        return replace(found, whole_bars=whole)
    problem, result = with_input_noise(here)
    result, shares = carry(misled([*bench, *held], here), here, result)
    return MaximumLikelihood(problem, result, "oe", (), tuple(warnings), shares, whole_bars=whole, linearised=here)


def _left_over(problem: Problem, result: OutputErrorResult | FilterErrorResult) -> str:
    """What is left of the outputs that is no noise of a sensor, in words; empty where all of it is white."""
    interval_s = problem.records[0].interval_s
    spans = {
        name: spectral_span([one[:, OUTPUTS.index(name)] for one in result.residuals], interval_s)
        for name in problem.motion.outputs
        if name not in GROUND
    }
    most = max(spans, key=spans.__getitem__)
    if spans[most] < _COLOURED:
        return ""
    return (
        f"what output error leaves of {most} is no noise of a sensor, its spectrum spans a factor of"
        f" {np.exp(spans[most]):.0f}: delayed surfaces, gusts, vibration or a missing effect; the standard"
        " errors do not count it; use --method map"
    )


def _in_turbulence(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    bench: Sequence[BenchError],
    sensors: Sequence[str] | None,
    progress: Progress,
) -> MaximumLikelihood:
    """The estimate by filter error."""
    solved, result, refused = estimate_in_turbulence(
        problem, model, coefficients, effects, compatible, sensors, progress
    )
    warnings = () if result.converged else ("filter error did not settle; the standard errors may be too small",)
    result, shares = carry_filtered(bench, solved, model, coefficients, effects, result)
    return MaximumLikelihood(solved, result, "fe", tuple(refused), warnings, shares)


def _with_misfit(
    problem: Problem,
    wider: WithExtraTerms,
    effects: Sequence[tuple[str, str]],
    warnings: tuple[str, ...],
    linkages: Sequence[BenchError],
    held: Sequence[BenchError],
) -> MaximumLikelihood:
    """The rest of output error where the flight shows aerodynamics that the structure of `problem` does not hold."""
    here = OutputErrorLinearisation(wider.problem, wider.model, wider.coefficients, effects, wider.result)
    corrected, result = with_input_noise(here)
    result, _ = carry(misled(held, here), here, result)
    result, shares = carry(misled(linkages, here), here, result)
    solved = replace(wider, problem=corrected, result=result)
    nearest = solved.projected(result)
    completed = replace(corrected, known=problem.known)
    moved = wider.projected_changes(shares)
    return MaximumLikelihood(completed, nearest, "oe", (), warnings, moved, solved, linearised=here)


def with_error_sources(
    found: MaximumLikelihood,
    model: Model,
    start: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    systematic: bool = True,
) -> Model:
    """The model of an estimate with what its errors come from beside each entry: `bench`, `systematic` and `late`.

    start: the model that was estimated, with these coefficients and effect parameters free. systematic: whether to ask
    what errors of the vehicle file would do.
    """
    curves, linkages = found.bench_shares()
    moved = _systematic(found, start, coefficients, effects) if systematic else {}
    moved = {name: {**moved.get(name, {}), **stated} for name, stated in linkages.items()}
    return with_sources(with_extra(model, "bench", curves), moved)


def _systematic(
    found: MaximumLikelihood, model: Model, coefficients: Sequence[str], effects: Sequence[tuple[str, str]]
) -> dict[str, dict[str, float]]:
    """What errors of the vehicle file would do to each estimate: parameter -> perturbation -> change."""
    if isinstance(found.result, FilterErrorResult):
        return systematic_in_turbulence(found.problem, model, coefficients, effects, found.result)
    assert found.linearised is not None  # output error leaves it
    changes = systematic_errors(found.linearised)
    return changes if found.wider is None else found.wider.projected_changes(changes)

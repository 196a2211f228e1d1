"""Which maximum-likelihood method a flight gets: output error in calm air, filter error in turbulence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sim_vehicle.model import Model
from sysid.bench import BenchError, carry
from sysid.compatibility import CompatibilityResult
from sysid.estimate import Likeliest, Problem, fit, likelier_timing
from sysid.filter_error import FilterErrorResult
from sysid.identifiability import Refusal
from sysid.inputnoise import with_thrust_by_airspeed, with_thrust_noise
from sysid.output_error import OutputErrorResult
from sysid.sensorchoice import with_told_sensors
from sysid.systematic import systematic_errors
from sysid.turbulent import (
    can_filter,
    carry_filtered,
    estimate_in_turbulence,
    is_turbulent,
    systematic_in_turbulence,
)

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class MaximumLikelihood:
    """An estimate, the problem it solves, and how.

    method: "oe" or "fe". refused: sensor errors that the flight cannot tell beside the coefficients. warnings: in
    words.
    """

    problem: Problem
    result: OutputErrorResult | FilterErrorResult
    method: str
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...]
    from_bench: Mapping[str, Mapping[str, float]]

    @property
    def estimate(self) -> Likeliest:
        """The result, whichever method gave it."""
        return self.result


def maximum_likelihood(
    problem: Problem,
    turbulent: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    bench: Sequence[BenchError] = (),
    *,
    method: str = "auto",
    sensors: Sequence[str] | None = None,
    progress: Progress = lambda share, text: None,
) -> MaximumLikelihood:
    """Estimate coefficients, effect parameters and sensor errors together.

    problem: of the flight, cut into runs that a free simulation follows. turbulent: the same in longer runs, for filter
    error. method: "oe", "fe", or "auto", which takes filter error where kinematics saw turbulence and the innovations
    confirm it. sensors: sensor errors asked for; None lets the flight decide. bench: errors of calibrations.
    Raises EstimationError for "fe" with a model that it has no states for.
    """
    warnings: list[str] = []
    wanted = method == "fe" or (method == "auto" and compatible.gust_sigma > 0.0)
    if wanted and method == "auto" and not can_filter(problem, model):
        warnings.append(_rough(compatible) + "; filter error has no state for this model's lagging lift or sensors")
        wanted = False
    if wanted:
        solved, filtered, refused = estimate_in_turbulence(
            turbulent, model, coefficients, effects, compatible, sensors, progress
        )
        if method == "fe" or is_turbulent(filtered):
            if not filtered.converged:
                warnings.append("filter error did not settle; the standard errors may be too small")
            filtered, shares = carry_filtered(bench, solved, model, coefficients, effects, filtered)
            return MaximumLikelihood(solved, filtered, "fe", tuple(refused), tuple(warnings), shares)
    elif method == "oe" and compatible.gust_sigma > 0.0:
        warnings.append(_rough(compatible) + "; use --method fe, or auto")
    result = fit(problem, model, coefficients, effects, progress=lambda s, t: progress(0.85 * s, t))
    progress(0.9, "timing of the commands")
    problem, result = likelier_timing(problem, model, coefficients, effects, result)
    problem, result = with_thrust_by_airspeed(problem, model, coefficients, effects, result)
    if sensors is None and compatible.gust_sigma == 0.0:
        unclear = [refusal.name for refusal in compatible.refused]
        problem, result = with_told_sensors(problem, model, coefficients, effects, result, unclear)
    if not result.converged:
        warnings.append("output error did not converge; the standard errors may be too small")
    problem, result = with_thrust_noise(problem, model, coefficients, effects, result)
    result, shares = carry(bench, problem, model, coefficients, effects, result)
    return MaximumLikelihood(problem, result, "oe", (), tuple(warnings), shares)


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
    return systematic_errors(found.problem, model, coefficients, effects, found.result)

"""What the search for missing effects asks of a fitted model, whatever the noise in its likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.naming_rule import LeftOver
from sysid.discrepancy.significance import Significance
from sysid.problem.estimation_problem import Problem, Progress


class CandidateFit(Protocol):
    """A model fitted to flights under one noise model, with what was named so far."""

    @property
    def problem(self) -> Problem:
        """The flights."""

    @property
    def model(self) -> Model:
        """It, with its estimates."""

    @property
    def cost(self) -> float:
        """Negative log likelihood, noise estimated at this fit."""

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence, of use beside other fits of the same flights."""

    def choices(self) -> list[Candidate]:
        """Every effect of the catalogue that the flights could show under this noise model."""

    def trials(self, choices: Sequence[Candidate], progress: Progress) -> list[Trial[Self]]:
        """The promising ones of these, fitted."""

    def confirmed(self, trial: Trial[Self], significance: Significance) -> Significance:
        """What a gain comes to where standard errors count all that this noise model leaves out."""

    def with_named(self, trial: Trial[Self]) -> Self:
        """The fit with a trial that was the likeliest, and what was chosen while it was missing chosen anew."""

    def without(self, candidate: Candidate) -> Self | None:
        """The fit without a candidate that it has; None where it is lost."""

    def values_of(self, candidate: Candidate) -> dict[str, tuple[float, float]]:
        """Value and standard error of a candidate's parameters, by name."""

    def sharpened(self) -> Self:
        """The fit with standard errors that hold where the noise is estimated too."""

    def doubtful(self, named: Sequence[Named]) -> Named | None:
        """Of these the one whose size is most within such a standard error; None where all are beyond theirs."""

    def left(self, least: float) -> Mapping[str, LeftOver]:
        """By axis or output what nothing explains. least: gain (twice a log likelihood) that is no matter."""


Fit = TypeVar("Fit", bound=CandidateFit)


@dataclass(frozen=True)
class Trial(Generic[Fit]):
    """A candidate fitted beside what a model has already.

    fit: with it. values: value and standard error of its parameters. gain: twice the log likelihood, as far as its
    sizes bear it out. evidence: logarithm of the evidence that it gains.
    """

    candidate: Candidate
    fit: Fit
    values: Mapping[str, tuple[float, float]]
    gain: float
    evidence: float

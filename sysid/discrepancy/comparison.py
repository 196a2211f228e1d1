"""What a comparison is asked, what it asks of the noise model that it is made with, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.candidate_fit import Fit
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.naming_rule import Judgement
from sysid.numerics.dryden import Turbulence
from sysid.problem.estimation_problem import Motion
from sysid.problem.free_run import Fixed
from sysid.quality.flight_quality import Quality
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared

MAX_EFFECTS = 3  # named together at most

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Asked:
    """A model to compare with flights: see `sysid.discrepancy.discrepancy`."""

    flights: Sequence[FlightSignals]
    vehicle: Vehicle
    model: Model
    validate_on: Sequence[FlightSignals]
    start_s: float | None
    stop_s: float | None
    ruled_out: Sequence[str]
    as_recorded: Sequence[str]
    progress: Progress


@dataclass(frozen=True)
class Compared:
    """Flights beside the stages of a comparison: the model as "given", fitted again ("before"), with what was named
    ("after", the same object as "before" where nothing was). air: turbulence.
    """

    flights: tuple[Prepared, ...]
    motion: Motion
    stages: Mapping[str, Fixed]
    compatible: CompatibilityResult
    air: Turbulence


class Comparison(Protocol[Fit]):
    """Flights and a model under one noise model: what is asked of it before a search and after it."""

    @property
    def method(self) -> str:
        """Of schema discrepancy/1."""

    @property
    def base(self) -> Fit:
        """The model fitted again."""

    @property
    def quality(self) -> Quality:
        """What the flights are worth."""

    @property
    def warnings(self) -> Sequence[str]:
        """What the result says beside it."""

    @property
    def outputs(self) -> Collection[str] | None:
        """Names of outputs that the gap is judged by, None for all."""

    def lost(self, fit: Fit) -> str:
        """In words, that noise stands for the motion, so that what gains explains that noise; empty where none does."""

    def used(self, fit: Fit) -> Compared:
        """The flights that were fitted, with a fit for the last stage."""

    def judged(self, fit: Fit) -> Compared | None:
        """The flights held out; None without any."""

    def whole_model(self, fit: Fit) -> tuple[Model, Sequence[str]]:
        """A fit's model with whole errors, and warnings where they cannot be had."""

    def turbulence(self, fit: Fit) -> float:
        """Of schema discrepancy/1, m/s."""

    def remarks(self, fit: Fit) -> list[str]:
        """What noise, servos and sensors were found to do beside the model, in words."""

    def moved(self) -> tuple[Array, Array]:
        """(P,) how far the model's own parameters are from those given, and (P, P) their covariance."""


@dataclass(frozen=True)
class Outcome:
    """What was found. method: "fe" or "map". turbulence: of schema discrepancy/1. model: with what
    was named. used: the flights that were fitted; judged: those held out.
    """

    method: str
    verdict: Judgement
    named: tuple[Named, ...]
    model: Model
    ruled_out: frozenset[str]
    used: Compared
    judged: Compared | None
    turbulence: float
    quality: Quality
    warnings: tuple[str, ...]

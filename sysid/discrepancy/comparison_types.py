"""What a comparison is asked, and what it finds, whichever estimator it is made by."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult
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

"""What an identification was asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.problem.estimation_problem import Progress
from sysid.signals.flight import FlightSignals


@dataclass(frozen=True)
class Request:
    """The flights and all that was stated of them. The fields are the parameters of `sysid.identify.identify`."""

    flights: Sequence[FlightSignals]
    vehicle: Vehicle
    validate_on: Sequence[FlightSignals]
    structure: Model | None
    prior: Model | None
    start_s: float | None
    stop_s: float | None
    sensors: Sequence[str] | None
    systematic: bool
    as_recorded: Sequence[str]
    progress: Progress

    def within(self, begin: float, end: float) -> Request:
        """The same as one part of a job, from one share of it to another."""
        outer = self.progress

        def progress(share: float, text: str) -> None:
            outer(begin + (end - begin) * share, text)

        return replace(self, progress=progress)

"""Planned flights, and what came of them."""

from __future__ import annotations

from pydantic import BaseModel, Field


class PlanUpload(BaseModel):
    """A plan's script on a vehicle's card."""

    system: int
    path: str
    bytes: int


class PlannedCoefficient(BaseModel):
    """One coefficient: the standard error that the plan promised, and the one that the flight gave."""

    name: str
    expected_std: float | None
    reached_std: float | None = Field(description="null where the flight could not identify it")


class Planned(BaseModel):
    """The plan that was there when a flight began, beside what came of it."""

    flight: str = Field(description="The flight behind which it was planned")
    made: str = Field(description="When, UTC")
    gusts: float = Field(description="Turbulence that the plan counted on, m/s")
    coefficients: list[PlannedCoefficient]

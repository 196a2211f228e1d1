"""A model beside flights: those it is judged by, or where there are none those that it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.problem.coefficient_residuals import residual_noise
from sysid.problem.free_run import Fixed
from sysid.signals.preparation import Prepared
from sysid.signals.record import SURFACES
from sysid.validation.largest_residual import ResidualHistory, largest_residual
from sysid.validation.residual_series import ModelComparison
from sysid.validation.statistics import Validation, validate


def comparison(
    flights: Sequence[Prepared],
    vehicle: Vehicle,
    model: Model,
    errors: Mapping[str, tuple[float, float, str]],
    command_first: float,
) -> ModelComparison:
    """Flights beside the model as it flies: coefficients that are refused by the mean of their estimate, those without
    one as zero, effects with refused parameters as absent.
    """
    estimated = {name: entry for name, entry in model.coefficients.items() if entry.flown is not None}
    known = replace(model, coefficients=estimated, effects=tuple(e for e in model.effects if not e.refused()))
    axes = sorted({name.partition("_")[0] for name in known.coefficients})
    values = {name: value for name, (value, _, _) in errors.items()}
    return ModelComparison(tuple(flights), vehicle, Fixed(flatten(vehicle, known), values, command_first), tuple(axes))


def validation_of(compared: ModelComparison) -> Validation:
    """Coefficients measured on other flights against the model's."""
    paths = [path for flight in compared.paths for path in flight]
    z = {axis: np.concatenate([path.measured[axis] for path in paths]) for axis in compared.axes}
    y = {axis: np.concatenate([path.predicted[axis] for path in paths]) for axis in compared.axes}
    every = [
        residual_noise(stretch.record, flight.layout, compared.vehicle, compared.model)
        for flight in compared.flights
        for stretch in flight.stretches
    ]
    noise = {axis: float(np.median([one[axis] for one in every])) for axis in z}
    found = {axis: largest_residual(axis, noise[axis], _stretches(compared)) for axis in z if axis in noise}
    return replace(validate(z, y, noise), largest={axis: one for axis, one in found.items() if one is not None})


def _stretches(compared: ModelComparison) -> list[ResidualHistory]:
    """Residuals of every stretch beside the surfaces' commands."""
    return [
        ResidualHistory(
            flight.data.name,
            path.time_s,
            np.column_stack([path.variables[name] for name in SURFACES]),
            {axis: path.measured[axis] - path.predicted[axis] for axis in compared.axes},
        )
        for flight, paths in zip(compared.flights, compared.paths, strict=True)
        for path in paths
    ]

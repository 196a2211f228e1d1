"""Models drawn from what is known of one, for Monte Carlo elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from gcs.errors import ExportError
from gcs.exports.exported import Exported
from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Coefficient, Model, ModelEffect
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.problem.vehicle_errors import doubts_of_mass, heavier
from sysid.uncertainty.total import error_parts


def drawn(
    model: Exported, count: int, seed: int = 0, without: Callable[[str], bool] = lambda source: False
) -> list[Exported]:
    """Models whose estimates are drawn together, with the correlations of the model file; what has no error stays.

    Each has a mass and moments of inertia of its own, those that its coefficients were found with: a flight shows Cm
    over Iyy. Parameters of effects stay within the catalogue's ranges. Raises ExportError for a model without
    correlations.

    without: whether an error that was taken as known counts for nothing, by its name.
    """
    errors = error_parts(model.model)
    if errors is None:
        raise ExportError(
            f"{model.model.name}: no models can be drawn from it: its file has no correlations of estimates, without"
            " which standard errors claim too much; give a model or result of gcs identify"
        )
    random = np.random.default_rng(seed)
    known = errors.known
    rows = random.multivariate_normal(known.mean, known.covariance, count, method="eigh")
    of_mass = doubts_of_mass(model.vehicle)
    samples = []
    for number, row in enumerate(rows, 1):
        vehicle, values = model.vehicle, row.copy()
        for source, shift in errors.shifts.items():
            if without(source):
                continue
            change = of_mass.get(source, {})
            size = _of_one_sign(vehicle, change, float(random.standard_normal()))
            values += size * shift
            vehicle = heavier(vehicle, change, size)
        samples.append(
            replace(_with(model, dict(zip(known.names, values.tolist(), strict=True)), number), vehicle=vehicle)
        )
    return samples


def _of_one_sign(vehicle: Vehicle, change: Mapping[str, float], size: float) -> float:
    """So many standard deviations of an error of mass or inertia that leave it above zero: its logarithm is normal."""
    for key in ("mass", "Ixx", "Iyy", "Izz"):
        if change.get(key):
            share = float(change[key] / getattr(vehicle.mass, key))
            return math.expm1(share * size) / share
    return size


def _with(model: Exported, values: dict[str, float], number: int) -> Exported:
    """A model drawn is one that may be the true one, so that its values have no errors."""
    coefficients = {
        name: replace(
            entry,
            value=None if entry.value is None else values.get(name, entry.value),
            std=None,
            mean=None if entry.mean is None else values.get(name, entry.mean),
            mean_std=None,
            extra={},
        )
        for name, entry in model.model.coefficients.items()
    }
    effects = []
    for effect in model.model.effects:
        parameters = {}
        for name, entry in effect.parameters.items():
            limits, value = EFFECTS[effect.name].parameter(name), entry.value
            if value is not None and f"{effect.name}.{name}" in values:
                low, high = min(limits.low, value), max(limits.high, value)
                value = min(max(values[f"{effect.name}.{name}"], low), high)
            parameters[name] = Coefficient(value, refused=entry.refused)
        effects.append(ModelEffect(effect.name, parameters))
    name = f"{model.model.name}, drawn {number}"
    return replace(model, model=Model(name, coefficients, tuple(effects), model.model.validity))

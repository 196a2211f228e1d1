"""Models drawn from what is known of one, for Monte Carlo elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.errors import ExportError
from gcs.exports.exported import Exported
from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Coefficient, Model, ModelEffect
from sysid.numerics.gaussian import known_from


def drawn(model: Exported, count: int, seed: int = 0) -> list[Exported]:
    """Models whose estimates are drawn together, with the correlations of the model file; what has no error stays.

    Parameters of effects stay within the catalogue's ranges. Raises ExportError for a model without correlations.
    """
    known, _ = known_from(model.model, flown=True)
    if known is None:
        raise ExportError(
            f"{model.model.name}: no models can be drawn from it: its file has no correlations of estimates, without"
            " which standard errors claim too much; give a model or result of gcs identify"
        )
    drawings = np.random.default_rng(seed).multivariate_normal(known.mean, known.covariance, count, method="eigh")
    return [_with(model, dict(zip(known.names, row.tolist(), strict=True)), i) for i, row in enumerate(drawings, 1)]


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

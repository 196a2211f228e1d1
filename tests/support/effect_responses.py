"""What an effect changes in the outputs of a simulated flight, without noise: the truth's own sensitivities.

The flight is simulated again by the bundled simulator under the same commands and the same measured thrust, with the
effect's parameters moved; nothing of the estimators is used. The outputs' change is linear in parameters that can have
either sign, so a central difference tells it at any size. Lags, delays, free play and their like are none of it: their
change is that from nothing to a size, at several sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from effect_sizes import RANGES, Value, effect_text, values_at
from flight_bounds import Array, Experiment, simulated, true_states

from sim_vehicle.effects import EFFECTS, Effect, Stage, parse_effect
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.packed_model import flatten

# Share of the greatest usual size by which a parameter moves to either side.
_STEP = 0.002
# Sizes from which the change to an impostor that is not linear is taken, as shares of the way to the greatest.
_SIZES = (0.0, 0.5, 1.0)
# When one that comes at a moment may have come, s after the first stamp.
_MOMENTS = tuple(np.arange(3.0, 21.0, 2.0))
# Effects on the air and on what the sensor of the thrust tells: their answers are those of other inputs.
OUTER = ("wind_shear", "thrust_sensor_hysteresis")
_GROUPS = ("vanes", "air_data", "imu", "attitude")


def read_inputs(flown: FlownFlight, model: Model, *, thrust: bool) -> FlownFlight:
    """The flight with thrust and density as an estimator is told them, before effects. thrust: is it measured?"""
    scale = (model.effect("thrust_scale") or {}).get("scale", 0.0)
    density = (model.effect("density_error") or {}).get("scale", 0.0)
    force = flown.truth["thrust"] / (1.0 + scale) if thrust else np.full(flown.time_s.size, np.nan)
    return replace(flown, truth={**flown.truth, "thrust": force, "rho": flown.truth["rho"] / (1.0 + density)})


def outputs_of(experiment: Experiment, model: Model) -> Array:
    """The outputs (N, outputs) of the experiment's flight with another model."""
    flat = flatten(experiment.vehicle, model)
    path = true_states(experiment.flown)
    return simulated(
        experiment, flat, path, flat.C, path[0], experiment.flown.truth["thrust"], experiment.flown.command
    )


def is_linear(effect: Effect) -> bool:
    """Whether the outputs' change is linear in all the parameters that are estimated."""
    return all(p.low < 0.0 for p in effect.parameters if p.fitted)


def changed(model: Model, effect: str, values: Mapping[str, Value]) -> Model:
    """The model with these parameters of an effect; a coefficient that is not given stays as it is."""
    return model.with_effect(*parse_effect(effect_text(effect, values)))


def _in_shear(experiment: Experiment, gradient: float) -> Array:
    """The outputs (N, outputs) where the north wind grows by `gradient` [1/s] with height, along the path flown."""
    flown, vehicle = experiment.flown, experiment.vehicle
    phi, theta, psi = (flown.truth[name] for name in ("phi", "theta", "psi"))
    north = gradient * (-flown.truth["down"] - vehicle.flight.altitude)
    # First column of the rotation from earth to body axes.
    to_body = np.stack(
        [
            np.cos(theta) * np.cos(psi),
            np.sin(phi) * np.sin(theta) * np.cos(psi) - np.cos(phi) * np.sin(psi),
            np.cos(phi) * np.sin(theta) * np.cos(psi) + np.sin(phi) * np.sin(psi),
        ],
        axis=1,
    )
    moved = replace(flown, gust_body=flown.gust_body + north[:, None] * to_body)
    return outputs_of(replace(experiment, flown=moved), experiment.model)


def _behind_play(experiment: Experiment, width: float) -> Array:
    """Change of the outputs (N, outputs) by the part of the thrust that a sensor with free play [N] does not tell."""
    truth = experiment.flown.truth
    told = truth["thrust"].copy()
    for k in range(1, told.size):
        told[k] = min(max(told[k - 1], truth["thrust"][k] - 0.5 * width), truth["thrust"][k] + 0.5 * width)
    flown = replace(experiment.flown, truth={**truth, "thrust": told})
    there, here = outputs_of(experiment, experiment.model), replace(experiment, flown=flown)
    return there - outputs_of(here, here.model)


def parameter_slopes(experiment: Experiment, effect: str, values: Mapping[str, Value]) -> dict[str, Array]:
    """Change of the outputs by each estimated parameter of an effect at `values`, per unit (N, outputs)."""
    if effect == "wind_shear":
        step = _STEP * greatest(effect, "gradient")
        return {"gradient": (_in_shear(experiment, step) - _in_shear(experiment, -step)) / (2.0 * step)}
    if effect == "thrust_sensor_hysteresis":
        width = float(values["width"])
        step = 0.05 * width
        return {
            "width": (_behind_play(experiment, width + step) - _behind_play(experiment, width - step)) / (2.0 * step)
        }
    found = {}
    for parameter in EFFECTS[effect].parameters:
        if not parameter.fitted or parameter.name not in values:
            continue
        here = values[parameter.name]
        assert isinstance(here, float)
        step = max(_STEP * max(abs(here), greatest(effect, parameter.name)), parameter.step)
        ends = [
            outputs_of(experiment, changed(experiment.model, effect, {**values, parameter.name: here + sign * step}))
            for sign in (1.0, -1.0)
        ]
        found[parameter.name] = (ends[0] - ends[1]) / (2.0 * step)
    return found


def greatest(effect: str, parameter: str) -> float:
    """The greatest usual size of a parameter, 1 where none is listed."""
    ends = RANGES[effect].get(parameter)
    return abs(ends[1]) if isinstance(ends, tuple) else 1.0


def neutral(effect: str, model: Model) -> dict[str, Value]:
    """All estimated parameters of a linear effect at nothing; of coefficients only those that the model lacks."""
    kind = EFFECTS[effect]
    names = [p.name for p in kind.parameters if p.fitted and not (kind.is_coefficient and p.name in model.coefficients)]
    return dict.fromkeys(names, 0.0)


def whole_response(experiment: Experiment, effect: str, values: Mapping[str, Value]) -> Array:
    """Change of the outputs by the effect at this size (N, outputs), in the experiment's model with or without it."""
    if effect == "thrust_sensor_hysteresis":
        return _behind_play(experiment, float(values["width"]))
    if is_linear(EFFECTS[effect]):
        nothing = {**neutral(effect, experiment.model), **dict.fromkeys(values, 0.0)}
        here = {name: value for name, value in experiment.model.values().items() if name in values}
        slopes = parameter_slopes(experiment, effect, {**nothing, **here})
        return np.sum([slopes[name] * float(value) for name, value in values.items()], axis=0)
    with_it = changed(experiment.model, effect, values)
    return outputs_of(experiment, with_it) - outputs_of(experiment, experiment.model)


def impostors(model: Model) -> list[str]:
    """Effects that might be blamed instead: all that the model lacks, but for wind and turbulence.

    Aliases of coefficients imitate nothing that those do not; one that multiplies what is hidden does not without it.
    """
    return [
        name
        for name, effect in EFFECTS.items()
        if name in RANGES
        and model.effect(name) is None
        and (effect.stage is not Stage.ENVIRONMENT or name == "wind_shear")
        and not effect.alias
        and not (effect.is_coefficient and all(p.name in model.coefficients for p in effect.parameters))
    ]


def impostor_columns(experiment: Experiment, effect: str) -> Iterator[Array]:
    """What an impostor can make of the outputs, (N, outputs, parameters) for each size from which it may start."""
    base = outputs_of(experiment, experiment.model)
    if is_linear(EFFECTS[effect]):
        slopes = parameter_slopes(experiment, effect, neutral(effect, experiment.model))
        if slopes:
            yield np.stack(list(slopes.values()), axis=2)
        return
    for values in _starts(effect):
        if effect == "thrust_sensor_hysteresis":
            yield _behind_play(experiment, float(values["width"]))[:, :, None]
            continue
        moved = [name for name in values if isinstance(RANGES[effect].get(name), tuple)]
        if "time" not in values:
            yield (outputs_of(experiment, changed(experiment.model, effect, values)) - base)[:, :, None]
            continue
        # Linear in its sizes, each alone, but not in its moment.
        nothing = {name: 0.0 if name in moved else value for name, value in values.items()}
        alone = [changed(experiment.model, effect, {**nothing, name: values[name]}) for name in moved]
        yield np.stack([outputs_of(experiment, model) - base for model in alone], axis=2)


def _starts(effect: str) -> Iterator[dict[str, Value]]:
    for share in _SIZES:
        values = values_at(effect, share)
        if "time" in values:
            if share == _SIZES[-1]:
                yield from ({**values, "time": float(moment)} for moment in _MOMENTS)
        elif "group" in values:
            yield from ({**values, "group": group} for group in _GROUPS)
        else:
            yield values

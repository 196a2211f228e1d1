"""A model for MATLAB and Simulink: a .mat file, and a function of the six coefficients beside it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import ExportError
from gcs.exports.exported import AXES_AND_SIGNS, Exported, require_new
from gcs.exports.state_space import state_space
from gcs.text.files import write_whole
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.aerodynamic_terms import AXES, parse_term
from sysid.numerics.gaussian import known_from

# The function's arguments, and what stands for a regressor in it.
_ARGUMENTS = ("alpha", "beta", "phat", "qhat", "rhat", "de", "da", "dr", "alphadothat", "throttle")
_RATES = {"p": "phat", "q": "qhat", "r": "rhat", "alphadot": "alphadothat"}


def write(model: Exported, path: Path) -> list[str]:
    """Write PATH and the function beside it. Returns what the form does not hold, a line each."""
    from scipy.io import savemat  # slow to import

    require_new(path)
    model.effects_flown("a function of MATLAB", ())
    function = path.with_name(f"{_identifier(path.stem)}_coefficients.m")
    require_new(function)
    notes = model.left_out
    vehicle, mass, geometry = model.vehicle, model.vehicle.mass, model.vehicle.geometry
    names = list(model.estimates)
    estimates = {_identifier(name): entry for name, entry in model.estimates.items()}
    content: dict[str, Any] = {
        "title": model.title,
        "conventions": AXES_AND_SIGNS,
        "coefficients": {key: float(entry.value or 0.0) for key, entry in estimates.items()},
        "std": {key: np.nan if entry.std is None else entry.std for key, entry in estimates.items()},
        "names": np.array(names, dtype=object),
        "not_identified": {_identifier(name): model.model.flown()[name] for name in model.model.not_identified()},
        "mass": {key: getattr(mass, key) for key in ("mass", "Ixx", "Iyy", "Izz", "Ixz")},
        "geometry": {key: getattr(geometry, key) for key in ("S", "b", "c")},
        "airspeed": vehicle.flight.airspeed,
    }
    if (known := known_from(model.model, flown=True)[0]) is not None:
        content |= {"covariance": known.covariance, "covariance_names": np.array(known.names, dtype=object)}
    try:
        linear = state_space(model)
    except SimVehicleError as error:
        notes = [*notes, f"no state space: {error}"]
    else:
        content |= {"linear": _plain(linear)}
    try:
        savemat(path, content, long_field_names=True)
    except OSError as error:
        raise ExportError(
            f"{path} could not be written: {error.strerror or 'no such folder'}; give another place for it"
        ) from None
    write_whole(function, _function(model, function.stem))
    return notes


def _plain(value: Any) -> Any:
    """Lists of names and of records as cells, of numbers as matrices; what is not known as an empty matrix."""
    if isinstance(value, list):
        cells = bool(value) and isinstance(value[0], str | dict)
        return np.array([_plain(one) for one in value], dtype=object) if cells else np.array(value, dtype=float)
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return np.empty((0, 0)) if value is None else value


def _identifier(text: str) -> str:
    """A name that MATLAB takes."""
    word = re.sub(r"\W+", "_", text)
    return word if word[:1].isalpha() else f"model_{word}"


def _function(model: Exported, name: str) -> str:
    """A function of arrays of any shape, element by element."""
    terms = [(parse_term(key), value) for key, value in model.model.flown().items()]
    arguments = (*_ARGUMENTS, *dict.fromkeys(term.control for term, _ in terms if term.control))
    lines = [
        f"function [{', '.join(AXES)}] = {name}({', '.join(arguments)})",
        f"% {model.title}.",
        f"% {AXES_AND_SIGNS}",
        "% Call it with arrays of one shape; a block of Simulink takes it as it is.",
    ]
    for axis in AXES:
        # Drag by lift follows lift.
        sums = [
            " .* ".join([f"({value!r})", *(_RATES.get(factor, factor) for factor in term.factors)])
            for term, value in terms
            if term.axis == axis
        ]
        lines.append(f"{axis} = {' + '.join([*sums, '0.0 .* alpha'])};")
    return "\n".join([*lines, "end"]) + "\n"

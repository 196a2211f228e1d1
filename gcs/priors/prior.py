"""A prior model of what a source gives, as `identify --prior` reads it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from gcs.errors import SettingsError
from gcs.priors import aerosandbox, avl, handbook, xflr5
from gcs.priors.estimate import Estimates, symmetric
from gcs.priors.signs import require_signs, reversed_controls, sign_words
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Correlation, Model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

_READERS = {"avl": avl.read, "xflr5": xflr5.read, "aerosandbox": aerosandbox.read}
#: What a prior can be made of.
SOURCES = (*_READERS, "geometry")
# A doubt below says more than any of these methods knows, one above no more than nothing.
_DOUBTS = (0.01, 2.0)


def prior_model(file: str, source: str, doubt: float | None, turned: Collection[str]) -> tuple[Model, list[str]]:
    """The model, and remarks on it: doubts about the file, what was left out, what its deflections mean.

    doubt: share of each value, 1 sigma, instead of the usual ones. turned: controls that the vehicle file counts the
    other way. Raises SettingsError, PriorError or VehicleFileError in one line.
    """
    if doubt is not None and not _DOUBTS[0] <= doubt <= _DOUBTS[1]:
        raise SettingsError(f"--doubt {doubt:g}: give a share from {_DOUBTS[0]:g} to {_DOUBTS[1]:g}, as 0.3 for 30 %")
    name, given, remarks = _given(file, source)
    found = reversed_controls({**symmetric(), **given.of}, turned)
    ordered = sorted(found, key=_place)
    coefficients = {one: Coefficient(found[one].value, found[one].std(doubt)) for one in ordered}
    # A prior counts with its correlations alone; judgements of single derivatives have none.
    identity = tuple(tuple(float(row == column) for column in ordered) for row in ordered)
    model = Model(name, coefficients, correlation=Correlation(tuple(ordered), identity))
    return model, [*remarks, *(f"left out: {one}" for one in given.left_out), *sign_words(found, turned)]


def _given(file: str, source: str) -> tuple[str, Estimates, list[str]]:
    """Name of the aircraft, what the file gives, and doubts about the file."""
    if source == "geometry":
        vehicle = load_vehicle(file)
        return vehicle.name, handbook.estimate(vehicle), [f"warning: {one}" for one in vehicle.warnings]
    path = Path(file)
    given = _READERS[source](path.read_text(encoding="utf-8", errors="replace"), file)
    require_signs(given.of, file)
    return path.stem, given, []


def _place(name: str) -> tuple[int, str]:
    return ("CL", "CD", "Cm", "CY", "Cl", "Cn").index(parse_term(name).axis), name


def prior_text(model: Model) -> str:
    """The model as a table for a terminal."""
    rows = [f"  {name:<10} {one.value:>10.4g} ± {one.std:.3g}" for name, one in model.coefficients.items()]
    return "\n".join([f"prior {model.name} (per rad, 1 sigma):", *rows])

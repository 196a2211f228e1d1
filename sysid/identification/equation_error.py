"""Coefficients by equation error alone, with error bars for the whole chain.

The regression takes the reconstructed motion as known. What the sensor errors' own uncertainty adds is found by
regressing again with each of them moved by its standard error: with J the changes and C the covariance of the
compatibility step, the coefficients' covariance grows by J C J'. What bands of frequency differ by comes on top
(sysid.equation_error.band_consistency), and how well the vehicle file knows its linkages. The prior enters last, on
all axes at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_vehicle.vehicle.controls import Control
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult, moved_by
from sysid.compatibility.selection import Refusal
from sysid.equation_error.band_consistency import BandEstimates, band_estimates, refusal, warning, widened
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.equations import CUTOFF_HZ
from sysid.equation_error.least_squares import RegressionResult
from sysid.equation_error.report import regression_report
from sysid.equation_error.time_domain import equation_error, equation_values, settled_equations
from sysid.numerics.gaussian import Gaussian
from sysid.problem.model_structure import PRIOR_WIDTH, helpful_manoeuvre, not_believed, not_identified, usual_size
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared, in_even_air
from sysid.signals.record import Record
from sysid.uncertainty.bench_errors import SURFACE_CLOCK, late, linkage_errors
from sysid.uncertainty.systematic import SHARE, Perturbation, linear, repeated
from sysid.uncertainty.travel import travel_shares

# Sensor errors enter nearly linearly; half a standard error keeps what is not linear small.
_STEP = 0.5

MakeParts = Callable[[Sequence[Prepared], Vehicle, CompatibilityResult], list[FlightData]]


@dataclass(frozen=True)
class EquationEstimate:
    """Result of equation error.

    joint: all coefficients that were regressed, and those a prior ties to them. regressions: by axis.
    refused: coefficients of `joint` whose standard error says nothing. systematic: coefficient -> perturbation of the
    vehicle file (sysid.uncertainty.systematic) -> change. report: block "regression" of the result. warnings: one line
    each.
    """

    joint: Gaussian
    regressions: Mapping[str, RegressionResult]
    refused: tuple[Refusal, ...]
    systematic: Mapping[str, Mapping[str, float]]
    report: Mapping[str, Any]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Regression:
    """One way from parts to values, to be repeated with something changed."""

    names: tuple[str, ...]
    command_first: bool

    def axes(self, parts: Sequence[FlightData], vehicle: Vehicle) -> dict[str, RegressionResult]:
        return equation_error(
            parts, body_of(vehicle), self.names, command_first=self.command_first, prior=diffuse(self.names)
        )

    def values(self, parts: Sequence[FlightData], vehicle: Vehicle) -> Array:
        """(P,) in the order of `names`."""
        found = equation_values(parts, body_of(vehicle), self.names, self.command_first, diffuse(self.names))
        return np.array([found[name] for name in self.names])


def diffuse(names: Sequence[str]) -> Gaussian:
    """As little as is known of any aircraft: it says nothing where the flight says anything."""
    size = np.array([PRIOR_WIDTH * usual_size(name) for name in names])
    return Gaussian(tuple(names), np.zeros(size.size), np.diag(size**2))


def estimate_by_equations(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    names: Sequence[str],
    command_first: bool,
    known: Gaussian | None,
    make_parts: MakeParts,
    systematic: bool = True,
) -> EquationEstimate:
    """Estimate coefficients by equation error.

    names: P coefficients that the flights excite. command_first: see sysid.equation_error.equations. known: prior, or
    None. make_parts: corrected parts of prepared flights.
    systematic: whether to say what errors of the vehicle file would do.
    """
    step = _Regression(tuple(names), command_first)
    parts = make_parts(prepared, vehicle, compatible)
    axes = step.axes(parts, vehicle)
    place = {name: i for i, name in enumerate(names)}
    values, covariance = np.zeros(len(place)), np.zeros((len(place), len(place)))
    for axis in axes.values():
        where = [place[name] for name in axis.names]
        values[where] = axis.values
        covariance[np.ix_(where, where)] = axis.covariance
    covariance += _from_sensors(step, prepared, vehicle, compatible, values, make_parts)
    statistical = Gaussian(tuple(names), values, covariance)
    equations = settled_equations(parts, body_of(vehicle), names, CUTOFF_HZ, command_first, diffuse(names))
    bands = band_estimates(equations, statistical)
    joint = widened(statistical, equations, bands)
    stated = _from_linkages(step, prepared, vehicle, compatible, make_parts)
    usual = _systematic(step, prepared, vehicle, compatible, make_parts) if systematic else {}
    effects = {name: {**usual.get(name, {}), **shifts} for name, shifts in stated.items()}
    if known is not None:
        flight, joint = joint, joint.combined(known)
        effects = _followed(effects, flight, joint)
    sources = list(dict.fromkeys(source for shifts in stated.values() for source in shifts))
    moved = np.zeros((len(joint.names), len(sources)))
    for i, name in enumerate(joint.names):
        moved[i] = [effects.get(name, {}).get(source, 0.0) for source in sources]
    joint = replace(joint, covariance=joint.covariance + moved @ moved.T)
    report, warnings = regression_report(parts, body_of(vehicle), axes, joint, command_first, diffuse(names))
    for axis in report.values():
        for name, term in axis["terms"].items():
            term["bands"] = _bands_json(bands.get(name))
    refused = tuple(_refusals(joint, names, bands, travel_shares(stated)))
    return EquationEstimate(joint, axes, refused, effects, report, (*warnings, *warning(bands)))


def _followed(
    effects: Mapping[str, Mapping[str, float]], flight: Gaussian, joint: Gaussian
) -> dict[str, dict[str, float]]:
    """The changes as far as the estimate follows the flight, where a prior holds it."""
    place = [joint.names.index(name) for name in flight.names]
    share = joint.covariance[np.ix_(place, place)] @ flight.information()
    found: dict[str, dict[str, float]] = {name: {} for name in flight.names}
    for source in dict.fromkeys(source for shifts in effects.values() for source in shifts):
        moved = share @ np.array([effects.get(name, {}).get(source, 0.0) for name in flight.names])
        for name, shift in zip(flight.names, moved, strict=True):
            found[name][source] = float(shift)
    return found


def _bands_json(found: BandEstimates | None) -> dict[str, Any] | None:
    if found is None:
        return None
    estimates = [
        {"band_hz": [round(float(edge), 3) for edge in edges], "value": float(value), "std": float(std)}
        for edges, value, std in zip(found.bands_hz, found.values, found.std, strict=True)
        if np.isfinite(value)
    ]
    return {"estimates": estimates, "scatter": found.scatter}


def _from_sensors(
    step: _Regression,
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    values: Array,
    make_parts: MakeParts,
) -> Array:
    """(P, P) covariance that the uncertainty of the sensor errors adds."""
    measured = in_even_air(prepared)
    std = np.sqrt(np.maximum(np.diag(compatible.covariance), 1e-300))
    shifts = [{name: _STEP * float(s)} for name, s in zip(compatible.parameters, std, strict=True)]
    # The first of the moved results is not moved at all: differences are taken along one way of computing.
    results = moved_by(measured, compatible, [{}, *shifts])
    base, *others = (step.values(make_parts(prepared, vehicle, result), vehicle) for result in results)
    if not others:
        return np.zeros((values.size, values.size))
    J = np.column_stack([(other - base) / _STEP for other in others])
    return np.asarray(J @ (compatible.covariance / np.outer(std, std)) @ J.T, dtype=np.float64)


def _systematic(
    step: _Regression,
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    make_parts: MakeParts,
) -> dict[str, dict[str, float]]:
    """Change of every coefficient under each perturbation of the vehicle file, as sysid.uncertainty.systematic names
    them.
    """
    records = [stretch.record for flight in prepared for stretch in flight.stretches]
    changes = [*((one, SHARE) for one in linear(vehicle)), *((one, 1.0) for one in repeated(records))]
    return _moved_by(changes, step, prepared, vehicle, compatible, make_parts)


def _from_linkages(
    step: _Regression,
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    make_parts: MakeParts,
) -> dict[str, dict[str, float]]:
    """Change of every coefficient under each error of a linkage that the vehicle file states, and of when surfaces were
    where a log of positions says: of one sigma.
    """
    small = replace(vehicle, controls={name: _surer(one) for name, one in vehicle.controls.items()})
    changes = [(Perturbation(one.source, record=one.record), SHARE) for one in linkage_errors(small)]
    if any(stretch.record.joined for flight in prepared for stretch in flight.stretches):
        changes.append((Perturbation(SURFACE_CLOCK, record=late), 1.0))
    return _moved_by(changes, step, prepared, vehicle, compatible, make_parts)


def _surer(control: Control) -> Control:
    return replace(control, gain_std=SHARE * control.gain_std, bias_std=SHARE * control.bias_std)


def _moved_by(
    changes: Sequence[tuple[Perturbation, float]],
    step: _Regression,
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    make_parts: MakeParts,
) -> dict[str, dict[str, float]]:
    """Change of every coefficient under each of the changes, over the share of it that is made."""
    moved: dict[str, dict[str, float]] = {name: {} for name in step.names}
    if not changes:
        return moved
    base = step.values(make_parts(prepared, vehicle, compatible), vehicle)
    for change, share in changes:
        changed = with_records(prepared, change.record)
        other = change.vehicle(vehicle)
        values = step.values(make_parts(changed, other, compatible), other)
        for name, difference in zip(step.names, (values - base) / share, strict=True):
            moved[name][change.name] = float(difference)
    return moved


def with_records(prepared: Sequence[Prepared], change: Callable[[Record], Record]) -> list[Prepared]:
    """The flights with their records changed, their data left as they are."""
    return [
        replace(flight, stretches=tuple(replace(one, record=change(one.record)) for one in flight.stretches))
        for flight in prepared
    ]


def _refusals(
    joint: Gaussian, names: Sequence[str], bands: Mapping[str, BandEstimates], travel: Mapping[str, float]
) -> list[Refusal]:
    """travel: share of linkages in standard errors, by which a derivative is known as well as its surface."""
    refused = []
    for name, (value, std) in joint.entries().items():
        reason = beyond = not_believed(name, value)
        if reason is None and name in bands:
            reason = refusal(value, bands[name])
        if reason is None:
            reason = not_identified(name, value, std, travel.get(name, 0.0))
        if name in names and reason is not None:
            refused.append(Refusal(name, reason, helpful_manoeuvre(name), flies=beyond is None))
    return refused

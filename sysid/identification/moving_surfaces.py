"""Whether surfaces stay from sample to sample of a log or move between: by what explains the moments better.

A log of every command of its loop holds what acts until the next. One that is slower than the loop, or that holds
positions, shows points of a curve: taken as held it comes half a sample late, which is a tenth of a small aircraft's
control derivatives at 50 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.equation_error.coefficients import Body, body_of
from sysid.equation_error.equations import Equations
from sysid.equation_error.least_squares import regress
from sysid.errors import SysidError
from sysid.identification.repaired_flight import FlightsRead
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.problem.formulation import corrected_parts
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared
from sysid.signals.record import SURFACES, has_positions

# Rich in what moments may follow, so that a missing term is not mistaken for where a surface was.
_MOMENTS = (
    ("Cm_0", "Cm_alpha", "Cm_alpha2", "Cm_q", "Cm_de"),
    ("Cl_0", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr"),
    ("Cn_0", "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr"),
)
# Twice the log likelihood ratio that overrules a log of every command.
_MARGIN = 12.0
_CUTOFF_HZ = 10.0


@dataclass(frozen=True)
class MovingSurfaces:
    """Flights whose surfaces move from sample to sample. vehicle: the aircraft, with a log of positions."""

    prepared: list[Prepared]
    compatible: CompatibilityResult
    vehicle: Vehicle


def with_surfaces_as_they_moved(
    read: FlightsRead,
    vehicle: Vehicle,
    span_s: tuple[float | None, float | None],
    prepared: Sequence[Prepared],
    compatible: CompatibilityResult,
) -> MovingSurfaces | None:
    """The flights with surfaces on curves through their samples, where that explains the moments better.

    prepared, compatible: the flights with surfaces that stay until the next sample. span_s: the part to take.
    """
    positions = _as_positions(vehicle)
    if positions is None:
        return None
    try:
        moving = [one.as_measured(positions, *span_s, anew=True) for one in read.fitted]
    except SysidError:  # as positions they cannot be read
        return None
    again = compatible if list(map(_parts, moving)) == list(map(_parts, prepared)) else check_compatibility(moving)
    held, moved = corrected_parts(prepared, positions, compatible), corrected_parts(moving, positions, again)
    return MovingSurfaces(moving, again, positions) if _between_samples(held, moved, positions) else None


def _parts(flight: Prepared) -> list[tuple[float, int]]:
    """Where each stretch of a flight begins, s, and its samples."""
    return [(float(one.record.time_s[0]), one.record.length) for one in flight.stretches]


def _as_positions(vehicle: Vehicle) -> Vehicle | None:
    """The aircraft with a log of positions of its surfaces; None where its file says that, or how late commands are."""
    surfaces = {name: one for name, one in vehicle.controls.items() if DEFLECTION_SIGNALS.get(name) in SURFACES}
    stated = any(one.delay.value or one.lag.value for one in surfaces.values())
    if stated or not surfaces or has_positions(vehicle):
        return None
    moving = {name: replace(one, signal="position") for name, one in surfaces.items()}
    return replace(vehicle, controls={**vehicle.controls, **moving})


def _between_samples(held: Sequence[FlightData], moving: Sequence[FlightData], vehicle: Vehicle) -> bool:
    """Whether the moments follow surfaces that move between the samples, rather than such as stay until the next.

    held, moving: stretches of the flights with sensor errors taken off, prepared by either. vehicle: of the second.
    """
    bodies = (replace(body_of(vehicle), surfaces_measured=False), body_of(vehicle))
    ways = (held, moving)
    named = vehicle.named_controls
    still = {name for name in (*SURFACES, *named) if all(np.ptp(part[name]) < 1e-4 for part in ways[0])}
    gain = 0.0
    for axis in _MOMENTS:
        every = (*axis, *(f"{axis[0].partition('_')[0]}_{control}" for control in named))
        names = [name for name in every if name.partition("_")[2] not in still]
        if not any(name.partition("_")[2] in SURFACES for name in names):
            continue
        try:
            stay, move = (_residual(parts, body, names) for parts, body in zip(ways, bodies, strict=True))
        except SysidError:
            continue
        independent = move.size / max(float(np.sum(pooled_autocorrelation([move]))), 1.0)
        gain += float(independent * np.log(np.mean(stay**2) / np.mean(move**2)))
    return gain > _MARGIN


def _residual(parts: Sequence[FlightData], body: Body, names: Sequence[str]) -> Array:
    """(N,) residuals of one axis' regression."""
    terms = [parse_term(name) for name in names]
    equations = Equations(parts, body, terms, _CUTOFF_HZ)
    left = equations.regressand(terms[0].axis)
    return regress(left, equations.matrix(terms), names, equations.lengths, equations.bandwidth).residual

"""The largest residual of each output: by how much it exceeds the noise, when, and whether a surface steps there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array

#: Times the noise beyond which a residual is reported: five standard deviations of twice the noise, as a fit may leave.
BEYOND = 10.0
# A surface steps where a sample changes its command by this share of its range in the stretch; a residual belongs to
# the step within that time, about which a derivative taken below 8 Hz rings.
_STEP, _NEAR_S = 0.3, 0.25
_SURFACES = ("elevator", "aileron", "rudder")


@dataclass(frozen=True)
class ResidualHistory:
    """One stretch in time: time_s (N,), commands (N, 3) of elevator, aileron, rudder, residuals output -> (N,)."""

    flight: str
    time_s: Array
    commands: Array
    residuals: Mapping[str, Array]


@dataclass(frozen=True)
class Largest:
    """The largest residual of one output in times of its noise, and when; `step` names the surface that steps there.

    share: of the samples, those beyond BEYOND times the noise.
    """

    flight: str
    time_s: float
    residual: float
    over_noise: float
    step: str | None
    share: float


def largest_residual(output: str, noise: float, stretches: Sequence[ResidualHistory]) -> Largest | None:
    """The largest of all stretches; None where there is no noise to compare with or no residual."""
    best, beyond, count = None, 0, 0
    for one in stretches:
        size = np.abs(one.residuals[output])
        there = np.isfinite(size)
        if not noise > 0.0 or not there.any():
            continue
        count += int(np.count_nonzero(there))
        beyond += int(np.count_nonzero(size[there] > BEYOND * noise))
        at = int(np.nanargmax(size))
        if best is None or size[at] > abs(best[0].residuals[output][best[1]]):
            best = (one, at)
    if best is None:
        return None
    one, at = best
    residual, moment = float(one.residuals[output][at]), float(one.time_s[at])
    return Largest(one.flight, moment, residual, abs(residual) / noise, _step_at(one, moment), beyond / count)


def _step_at(one: ResidualHistory, moment: float) -> str | None:
    """The surface that steps about that time, the one that does so most where there are several."""
    change = np.abs(np.diff(one.commands, axis=0))
    near = np.abs(one.time_s[1:] - moment) <= _NEAR_S
    reach = np.ptp(one.commands, axis=0)
    if not near.any():
        return None
    share = np.where(reach > 0.0, change[near].max(axis=0) / np.where(reach > 0.0, reach, 1.0), 0.0)
    most = int(np.argmax(share))
    return _SURFACES[most] if share[most] >= _STEP else None


def outlier_text(largest: Mapping[str, Largest]) -> str:
    """What exceeds BEYOND times the noise, in a sentence that begins with the worst; empty where nothing does."""
    worse = sorted(((n, one) for n, one in largest.items() if one.over_noise > BEYOND), key=lambda e: -e[1].over_noise)
    if not worse:
        return ""
    flights = list(dict.fromkeys(one.flight for _, one in worse))
    parts = []
    for name, one in worse:
        flight = f" of {one.flight}" if len(flights) > 1 else ""
        where = f", where the {one.step} steps" if one.step else ""
        often = f"({_percent(one.share)} of the samples beyond {BEYOND:g})"
        parts.append(f"{name} {one.over_noise:.0f} at {one.time_s:.1f} s{flight}{where} {often}")
    of = f" of {flights[0]}" if len(flights) == 1 else ""
    return f"The largest residuals{of} in times of the noise: {'; '.join(parts)}"


def _percent(share: float) -> str:
    """A share of the samples."""
    return "less than 0.1 %" if share < 1e-3 else f"{100.0 * share:.2g} %" if share < 0.995 else "100 %"

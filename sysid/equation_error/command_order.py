"""Whether a sensor's sample already shows the command that carries the same time stamp.

A vehicle reads its sensors, then commands: what is measured at a stamp belongs to the command before. Many
simulations evaluate the accelerations with the new command instead. Half a sample between the two biases control
derivatives, so the data decide: lift (or side force) is regressed on the surfaces with either timing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sysid.arrays import Array
from sysid.equation_error.coefficients import Body
from sysid.equation_error.equations import Equations
from sysid.equation_error.least_squares import regress
from sysid.errors import SysidError
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.signals.flight import FlightData

# Rich in what lift may follow, so that a missing term of the model is not mistaken for timing.
_LIFT = ("CL_0", "CL_alpha", "CL_alpha2", "CL_q", "CL_alphadot", "CL_de")
_SIDE = ("CY_0", "CY_beta", "CY_p", "CY_r", "CY_da", "CY_dr")
# Twice the log likelihood ratio that overrules the order of a real vehicle.
_MARGIN = 12.0
_CUTOFF_HZ = 10.0


def command_shows_at_once(parts: Sequence[FlightData], body: Body) -> bool:
    """Decide the timing from corrected stretches, by lift and side force together."""
    surfaces = {"de", "da", "dr", *body.named_controls}
    still = {name for name in surfaces if all(np.ptp(part[name]) < 1e-4 for part in parts)}
    gain = 0.0
    for axis, first in ((_LIFT, "CL"), (_SIDE, "CY")):
        every = (*axis, *(f"{first}_{control}" for control in body.named_controls))
        names = [name for name in every if name.partition("_")[2] not in still]
        if not any(name.partition("_")[2] in surfaces for name in names):
            continue
        try:
            later, now = _residuals(parts, body, names)
        except SysidError:
            continue
        independent = now.size / max(float(np.sum(pooled_autocorrelation([now]))), 1.0)
        gain += float(independent * np.log(np.mean(later**2) / np.mean(now**2)))
    return gain > _MARGIN


def _residuals(parts: Sequence[FlightData], body: Body, names: Sequence[str]) -> list[Array]:
    """(N,) residuals of one axis' regression with the command of the sample before, and with that of the same."""
    terms = [parse_term(name) for name in names]
    equations = Equations(parts, body, terms, _CUTOFF_HZ)
    left, residuals = equations.regressand(terms[0].axis), []
    for command_first in (False, True):
        equations.take_timing(command_first)
        found = regress(left, equations.matrix(terms), names, equations.lengths, equations.bandwidth)
        residuals.append(found.residual)
    return residuals

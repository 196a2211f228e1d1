"""Which sensor errors a flight can identify: by predicted standard error and by collinearity, never by significance.

Leaving out what is not significantly different from zero would make the intervals of what remains too narrow; so the
choice looks at the information alone, not at the values; but a value that no sensor has is no estimate of its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array

# Of two sensor errors, beyond which neither is distinguished from the other.
MAX_CORRELATION = 0.95


@dataclass(frozen=True)
class Refusal:
    """A quantity that the flight cannot identify, why, and the manoeuvre that would.

    flies: whether the mean of its estimate, where there is one, is what simulations fly all the same.
    """

    name: str
    reason: str
    manoeuvre: str
    flies: bool = True

    def to_json(self) -> dict[str, str]:
        """It as an entry of `refused` in a result file (schema identification/1)."""
        return {"name": self.name, "reason": self.reason, "manoeuvre": self.manoeuvre}


@dataclass(frozen=True)
class Limit:
    """Standard error above which an estimate is worth less than what is known of such sensors before the flight.

    std, unit: the limit. rank: of two that cannot be distinguished, the lower rank stays (an IMU's turn-on bias changes
    with every flight; a vane's or a pitot's scale and an attitude's mounting are measured on the bench).
    manoeuvre: what would identify it.
    """

    std: float
    unit: str
    rank: int
    manoeuvre: str


_PULL = "elevator-3211"
_TURN = "aileron-doublet,rudder-doublet"
_ORBIT = "cruise on several headings"
LIMITS = {
    "accel_bias_x": Limit(0.3, "m/s^2", 0, _PULL),
    "accel_bias_y": Limit(0.3, "m/s^2", 0, _TURN),
    "accel_bias_z": Limit(0.3, "m/s^2", 0, _PULL),
    "gyro_bias_p": Limit(0.02, "rad/s", 0, _TURN),
    "gyro_bias_q": Limit(0.02, "rad/s", 0, _PULL),
    "gyro_bias_r": Limit(0.02, "rad/s", 0, _TURN),
    "alpha_scale": Limit(0.15, "1", 1, "elevator-multisine"),
    "beta_scale": Limit(0.15, "1", 1, "rudder-multisine"),
    "theta_scale": Limit(0.05, "1", 2, "roller-coaster"),
    "airspeed_scale": Limit(0.05, "1", 4, "deceleration," + _ORBIT),
    "alpha_bias": Limit(0.03, "rad", 3, "roller-coaster"),
    "beta_bias": Limit(0.03, "rad", 3, _TURN),
    "airspeed_bias": Limit(0.5, "m/s", 5, "deceleration"),
    "phi_bias": Limit(0.02, "rad", 6, _TURN),
    "theta_bias": Limit(0.02, "rad", 6, "roller-coaster"),
    "wind_north": Limit(1.0, "m/s", 2, _ORBIT),
    "wind_east": Limit(1.0, "m/s", 2, _ORBIT),
    "wind_down": Limit(1.0, "m/s", 2, _ORBIT),
}


# Of its limit: a standard error below which one that kinematics refused is identified by the whole motion after all.
CLEAR_SHARE = 0.2
# An error so many times its limit, or a reading so many times the true value (or its inverse), is no sensor's: the
# readings disagree for another reason.
_BEYOND, _LEAST_GAIN, _LARGEST_GAIN = 15.0, 0.25, 4.0


def most_implausible(names: Sequence[str], values: Sequence[float]) -> Refusal | None:
    """The sensor error that no sensor has, the worst first; None where all of them may be so.

    names: of LIMITS. values: what the readings ask for, in the unit of the limit. A wind may be any.
    """
    worst, refused = 1.0, None
    for name, value in zip(names, values, strict=True):
        limit = LIMITS[name]
        if name.startswith("wind_"):
            continue
        if name.endswith("_scale"):
            gain = 1.0 + value
            excess = max(gain / _LARGEST_GAIN, _LEAST_GAIN / gain) if gain > 0.0 else float("inf")
            text = f"the readings ask for {gain:.3g} of true"
        else:
            excess = abs(value) / (_BEYOND * limit.std)
            text = f"the readings ask for {value:.3g} {limit.unit}"
        if excess > worst:
            reason = f"{text}, which no sensor does: rough air or an error of another kind; held at its nominal value"
            worst, refused = excess, Refusal(name, reason, limit.manoeuvre)
    return refused


def select(names: Sequence[str], covariance: Array) -> tuple[list[str], list[Refusal]]:
    """Split sensor errors into those the data identify and those they do not.

    One is refused at a time: taking one out makes the rest better known.

    Parameters
    ----------
    names : Sequence[str], length P
        Names of LIMITS.
    covariance : Array, shape (P, P)
        Predicted covariance, given that all P are estimated, in products of the units of LIMITS.

    Returns
    -------
    kept : list[str]
        Names of the sensor errors that are identified.
    refused : list[Refusal]
        The others, with reason and the manoeuvre that would identify each, in the order of their refusal.
    """
    kept, refused = list(names), []
    covariance = np.array(covariance, dtype=np.float64)
    while kept:
        std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        correlation = covariance / np.outer(std, std)
        np.fill_diagonal(correlation, 0.0)
        weakest, refusal = _weakest(kept, std, correlation)
        if refusal is None:
            break
        refused.append(refusal)
        # Knowing the refused one (at its nominal value) conditions the others.
        column = covariance[:, weakest]
        covariance = covariance - np.outer(column, column) / column[weakest]
        rest = [i for i in range(len(kept)) if i != weakest]
        covariance = covariance[np.ix_(rest, rest)]
        kept = [kept[i] for i in rest]
    return kept, refused


def _weakest(names: list[str], std: Array, correlation: Array) -> tuple[int, Refusal | None]:
    # Collinearity first: of two that cannot be distinguished both have a large error, and one of them may stay.
    first, second = np.unravel_index(int(np.argmax(np.abs(correlation))), correlation.shape)
    if abs(correlation[first, second]) > MAX_CORRELATION:
        pair = sorted((int(first), int(second)), key=lambda i: (LIMITS[names[i]].rank, std[i] / LIMITS[names[i]].std))
        stays, goes = pair
        reason = (
            f"cannot be distinguished from {names[stays]} here (correlation {correlation[first, second]:+.3f});"
            " held at its nominal value"
        )
        return goes, Refusal(names[goes], reason, LIMITS[names[goes]].manoeuvre)
    ratio = np.array([s / LIMITS[name].std for s, name in zip(std, names, strict=True)])
    worst = int(np.argmax(ratio))
    if ratio[worst] > 1.0:
        limit = LIMITS[names[worst]]
        reason = f"predicted standard error {std[worst]:.3g} {limit.unit} exceeds {limit.std:g} {limit.unit}"
        return worst, Refusal(names[worst], reason, limit.manoeuvre)
    return worst, None

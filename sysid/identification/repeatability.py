"""Do the bars hold from flight to flight? Each of several flights by itself, beside the estimate of all.

At the posterior's maximum of all flights one Gauss-Newton step with a flight's own share of information and slopes
leads to its own estimate, theta + (H_f + P)^-1 (g_f + p), with P and p the prior's; other methods estimate each again.

For estimates that scatter as their bars say, the root mean square of (value - mean) / std over n - 1 flights is 1
(Birge, Phys. Rev. 40, 1932): 0.8 to 1.25 is what ten flights show of right bars.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.arrays import Array
from sysid.errors import SysidError
from sysid.numerics.normal_equations import inverse

if TYPE_CHECKING:
    from sysid.posterior.estimates import GroupEstimate, PosteriorEstimate

#: Flights from which on a scatter is one.
FEWEST = 3
# Of its prior's standard deviation, from which on a flight says nothing of a coefficient by itself.
_SAYS_NOTHING = 0.5


@dataclass(frozen=True)
class FlightScatter:
    """A coefficient by each flight. values: flight -> value and standard error, of that flight alone."""

    values: Mapping[str, tuple[float, float]]

    @property
    def ratio(self) -> float:
        """Scatter of the flights over their bars."""
        value, std = np.array(list(self.values.values())).T
        weight = 1.0 / std**2
        off = (value - weight @ value / weight.sum()) / std
        return float(np.sqrt(off @ off / (value.size - 1)))

    def to_json(self) -> dict[str, Any]:
        """As results hold it."""
        flights = {name: {"value": value, "std": std} for name, (value, std) in self.values.items()}
        return {"ratio": self.ratio, "flights": flights}


def scattered(each: Mapping[str, Mapping[str, tuple[float, float]]]) -> dict[str, FlightScatter]:
    """Coefficient -> its scatter, of those that FEWEST flights or more know. each: flight -> what it says alone."""
    names = dict.fromkeys(name for values in each.values() for name in values)
    found = {
        name: {flight: values[name] for flight, values in each.items() if _is_known(*values.get(name, (0.0, 0.0)))}
        for name in names
    }
    return {name: FlightScatter(values) for name, values in found.items() if len(values) >= FEWEST}


def _is_known(value: float, std: float) -> bool:
    return bool(np.isfinite(value) and 0.0 < std < np.inf)


def by_posterior(found: PosteriorEstimate) -> dict[str, FlightScatter]:
    """Coefficient -> what several flights say of it, each by itself; none of fewer flights than FEWEST."""
    each: dict[str, dict[str, tuple[float, float]]] = defaultdict(dict)
    for group in found.groups.values():
        if len({part.flight for part in group.posterior.parts}) < FEWEST:
            continue
        result = group.result
        with suppress(SysidError, np.linalg.LinAlgError):
            equations = group.posterior.equations_by_flight(np.concatenate((result.theta, result.states)))
            for flight, (H, g) in equations.items():
                value, std, known_to = _alone(group, H, g)
                for i, name in enumerate(result.names[: len(group.posterior.model.parameters)]):
                    if known_to[i] < _SAYS_NOTHING * result.prior_std[i]:
                        each[flight][name] = float(value[i]), float(std[i])
    return scattered(each)


def _alone(group: GroupEstimate, H: Array, g: Array) -> tuple[Array, Array, Array]:
    """(P,) by one flight, by how much that scatters with its noise, and how well it is known.

    Noise makes slopes of covariance H less the prior's information; it is more by as much as in the estimate of all.
    What the prior, the structure and what was taken as known are off by moves all flights alike.
    """
    result, count = group.result, group.result.theta.size
    inverted = inverse(H)
    sampled = inverted @ (H - group.posterior.prior.information) @ inverted
    wider = result.noise_std / np.sqrt(np.diag(result.fisher))
    std = np.sqrt(np.maximum(np.diag(sampled)[:count], 0.0)) * wider
    return result.theta + (inverted @ g)[:count], std, np.sqrt(np.diag(inverted)[:count])

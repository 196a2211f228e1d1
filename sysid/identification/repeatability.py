"""Do the bars hold from flight to flight? Each of several flights by itself, beside the estimate of all.

At the posterior's maximum of all flights one Gauss-Newton step with a flight's own share of information and slopes
leads to its own estimate, theta + (H_f + P)^-1 (g_f + p), with P and p the prior's; other methods estimate each again.

For estimates that scatter as their bars say, the root mean square of (value - mean) / std over n - 1 flights is 1
(Birge, Phys. Rev. 40, 1932): 0.8 to 1.25 is what ten flights show of right bars.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.arrays import Array
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
    found = {name: {flight: values[name] for flight, values in each.items() if name in values} for name in names}
    return {name: FlightScatter(values) for name, values in found.items() if len(values) >= FEWEST}


def by_posterior(found: PosteriorEstimate) -> dict[str, FlightScatter]:
    """Coefficient -> what several flights say of it, each by itself; none of fewer flights than FEWEST."""
    each: dict[str, dict[str, tuple[float, float]]] = defaultdict(dict)
    for group in found.groups.values():
        flights = list(dict.fromkeys(part.flight for part in group.posterior.parts))
        if len(flights) < FEWEST:
            continue
        most = _SAYS_NOTHING * group.result.prior_std
        for flight in flights:
            value, std = _alone(group, flight)
            for i, name in enumerate(group.result.names[: len(group.posterior.model.parameters)]):
                if std[i] < most[i]:
                    each[flight][name] = float(value[i]), float(std[i])
    return scattered(each)


def _alone(group: GroupEstimate, flight: str) -> tuple[Array, Array]:
    """(P,) by one flight, and what its noise leaves open, which is more than its information says by as much as in the
    estimate of all. What the structure lacks and what was taken as known moves all flights alike.
    """
    result = group.result
    theta = np.concatenate((result.theta, result.states))
    H, g = group.posterior.equations_of(theta, flight)
    inverted, count = inverse(H), result.theta.size
    wider = result.noise_std**2 / np.diag(result.fisher)
    return result.theta + (inverted @ g)[:count], np.sqrt(np.diag(inverted)[:count] * wider)

"""Where filter error starts: output noise with which its filter follows the flight at all.

The noise is read off the highest frequencies of each output. An output whose errors are slow (an attitude from another
filter, a start model that explains half of a moment) shows hardly any there, and a filter that trusts it so much runs
away from the flight within a second. Then it starts with more noise for all outputs, from which the likeliest noise is
found; the paths it has run away on are not kept.
"""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.filter_error.linearised_flight import FilteredFlight, LinearisedRecord, Pass
from sysid.numerics.dryden import Turbulence

# Factors on the noise variances, tried in turn.
_GROWTH = (1.0, 1e2, 1e4, 1e6, 1e8)
# Mean square of the innovations over their variances up to which the filter follows: 1 where all is as assumed.
_FOLLOWS = 25.0
# Rounds in which that much more noise is brought down to what the innovations show.
_ROUNDS = 3


def settled_path(
    flight: FilteredFlight, theta: Array, noise: Array, turbulence: Turbulence
) -> tuple[list[LinearisedRecord], Pass]:
    """Linearise where this model's own filter runs: a reconstruction is not there.

    Parameters
    ----------
    flight : FilteredFlight
        Records and the paths they are linearised along; the paths are moved to where the filter was.
    theta : Array, shape (P,)
        Parameters, each in its own unit.
    noise : Array, shape (m,)
        Noise variances of the used outputs, squares of the outputs' units.
    turbulence : Turbulence
        Intensities of the gusts [m/s] and their scale length [m].

    Returns
    -------
    linear : list[Linear]
        Every record linearised about its path.
    found : Pass
        The filter pass along these paths, with information and slopes.
    """
    for _ in range(2):
        linear = flight.all_linearised(theta)
        flight.move(flight.filtered(linear, noise, turbulence, wanted=False))
    linear = flight.all_linearised(theta)
    return linear, flight.filtered(linear, noise, turbulence)


def followed(
    flight: FilteredFlight, theta: Array, turbulence: Turbulence
) -> tuple[Array, list[LinearisedRecord], Pass]:
    """Noise variances (m,), linearised records and filter pass with which the filter follows the flight.

    Raises EstimationError where it follows with no noise tried.
    """
    kept, initial = [path.copy() for path in flight.paths], flight.noise
    for growth in _GROWTH:
        flight.paths = [path.copy() for path in kept]
        noise = growth * initial
        with np.errstate(all="ignore"):
            linear, found = settled_path(flight, theta, noise, turbulence)
        if _follows_on_the_whole(found):
            if growth > 1.0:
                # What the highest frequencies showed is disproved: it is no prior knowledge of the noise either.
                flight.noise = noise
                return _with_less_noise(flight, theta, turbulence, noise, linear, found)
            return noise, linear, found
    flight.paths = kept
    raise EstimationError(
        "filter error: from this start the filter does not follow the flight (the model explains too little of the "
        "motion: look at delays, thrust and the equation error's result); use --method ee"
    )


def _with_less_noise(
    flight: FilteredFlight,
    theta: Array,
    turbulence: Turbulence,
    noise: Array,
    linear: list[LinearisedRecord],
    found: Pass,
) -> tuple[Array, list[LinearisedRecord], Pass]:
    """Noise, linearised records and pass brought towards what the innovations show, as far as the filter follows."""
    for _ in range(_ROUNDS):
        followed_so_far = [path.copy() for path in flight.paths]
        shown = noise * _misfits(found)
        with np.errstate(all="ignore"):
            closer, there = settled_path(flight, theta, shown, turbulence)
        if not _follows_on_the_whole(there):
            flight.paths = followed_so_far
            break
        noise, linear, found = shown, closer, there
    return noise, linear, found


def follows(found: Pass) -> bool:
    """Whether the filter stays with the flight in every output."""
    return _is_number(found) and bool(np.max(_misfits(found)) < _FOLLOWS)


def _follows_on_the_whole(found: Pass) -> bool:
    return _is_number(found) and bool(np.mean(_misfits(found)) < _FOLLOWS)


def _is_number(found: Pass) -> bool:
    return found.is_finite and bool(np.isfinite(_misfits(found)).all())


def _misfits(found: Pass) -> Array:
    """(m,) mean squares of every output's innovations over their variances."""
    with np.errstate(all="ignore"):
        ratios = [nu**2 / variance for nu, variance in zip(found.innovations, found.variances, strict=True)]
        return np.asarray(np.nanmean(np.concatenate(ratios), axis=0))

"""Motion and gusts as one linear system (compiled): what `sysid.filter_error.kalman` filters, sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit, jit_arrays

Array = NDArray[np.float64]


@jit
def _by_all_states(slopes: Array, nf: int, output: Array, found: Array) -> None:
    """Slopes by free states and gusts (nf + na,) as slopes by free states and states of the gusts, put into `found`."""
    for a in range(nf):
        found[a] = slopes[a]
    for g in range(output.shape[1]):
        by_gust = 0.0
        for i in range(output.shape[0]):
            by_gust += slopes[nf + i] * output[i, g]
        found[nf + g] = by_gust


@jit_arrays
def motion_and_gusts(
    step_x: Array, read_x: Array, surface_noise: Array, transition: Array, process: Array, output: Array,
    more: int,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Steps, their covariances and readings of nf free states and ng states of the gusts, x_{k+1} = F x_k + w.

    Over a step acts the mean of the gusts at both its ends: with B the step's slopes by gusts, C `output` and A
    `transition` they move the aircraft by B/2 (C g + C (A g + v)), so what is new in the second, v, acts at once, half.

    Parameters
    ----------
    step_x : Array, shape (N - 1, nf, nf + na)
        Slopes of every step by free states and gusts.
    read_x : Array, shape (N, m, nf + na)
        Slopes of the readings by the same.
    surface_noise : Array, shape (N - 1, nf, k)
        Standard deviations of the steps by what is not known of the surfaces.
    transition, process : Array, shape (ng, ng)
        Of the gusts' states over a step, and the covariance that it adds (`sysid.numerics.dryden.GustSystem`).
    output : Array, shape (na, ng)
        Gusts from their states.
    more : int
        States after these that are left at rest, for whoever fills them in.

    Returns
    -------
    steps, covariances : Array, shape (N - 1, nx, nx)
        nx = nf + ng + more: F and the covariance of w.
    observe : Array, shape (N, m, nx)
        Slopes of the readings by all states.
    """
    count, nf, readings, m = step_x.shape[0], step_x.shape[1], read_x.shape[0], read_x.shape[1]
    ng = output.shape[1]
    nx = nf + ng + more
    steps, covariances = np.zeros((count, nx, nx)), np.zeros((count, nx, nx))
    observe = np.zeros((readings, m, nx))
    felt, spread = np.empty((nf, ng)), np.empty((nf, ng))
    for k in range(count):
        for a in range(nf):
            _by_all_states(step_x[k, a], nf, output, steps[k, a])
            for g in range(ng):
                felt[a, g] = 0.5 * steps[k, a, nf + g]
            for g in range(ng):
                now, fresh = felt[a, g], 0.0
                for h in range(ng):
                    now += felt[a, h] * transition[h, g]
                    fresh += felt[a, h] * process[h, g]
                steps[k, a, nf + g], spread[a, g] = now, fresh
                covariances[k, a, nf + g] = covariances[k, nf + g, a] = fresh
            for b in range(a + 1):
                both = 0.0
                for g in range(ng):
                    both += spread[a, g] * felt[b, g]
                for i in range(surface_noise.shape[2]):
                    both += surface_noise[k, a, i] * surface_noise[k, b, i]
                covariances[k, a, b] = covariances[k, b, a] = both
        for g in range(ng):
            for h in range(ng):
                steps[k, nf + g, nf + h], covariances[k, nf + g, nf + h] = transition[g, h], process[g, h]
    for k in range(readings):
        for j in range(m):
            _by_all_states(read_x[k, j], nf, output, observe[k, j])
    return steps, covariances, observe

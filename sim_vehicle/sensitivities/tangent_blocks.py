"""Many tangent vectors of the motion advanced side by side (compiled).

A tangent is the derivative of the state u v w, p q r, quaternion by one unknown. WIDTH of them form a block, a flat
array in which the same entry of all of them is contiguous, so that the compiler works on them at once.
"""

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_fused
from sim_vehicle.model.aerodynamic_terms import AXES, REGRESSORS
from sim_vehicle.sensitivities.dynamics_jacobian import STATE_COLUMNS, THRUST_COLUMN

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDTH = 16
BLOCK = STATE_COLUMNS * WIDTH
FORCED = 6  # rows that unknowns act on directly: rates of u v w p q r
# Of one stage: the six rows of the rates' Jacobian, then the quaternion and p q r there.
STAGE = FORCED * STATE_COLUMNS + 7
_TURN = FORCED * STATE_COLUMNS
_AXES, _ELEVATOR, _NAMED = len(AXES), REGRESSORS.index("de"), len(REGRESSORS)


@jit_fused
def _stage(A: Array, force: Array, Y: Array, K: Array) -> None:
    """Rates K (BLOCK,) of the tangents Y (BLOCK,) of a stage A (STAGE,) under the direct effects (6 WIDTH,)."""
    for r in range(0, FORCED, 2):
        first, second = STATE_COLUMNS * r, STATE_COLUMNS * (r + 1)
        a0, a1, a2, a3, a4 = A[first], A[first + 1], A[first + 2], A[first + 3], A[first + 4]
        a5, a6, a7, a8, a9 = A[first + 5], A[first + 6], A[first + 7], A[first + 8], A[first + 9]
        b0, b1, b2, b3, b4 = A[second], A[second + 1], A[second + 2], A[second + 3], A[second + 4]
        b5, b6, b7, b8, b9 = A[second + 5], A[second + 6], A[second + 7], A[second + 8], A[second + 9]
        for i in range(WIDTH):
            y0, y1, y2, y3, y4 = Y[i], Y[WIDTH + i], Y[2 * WIDTH + i], Y[3 * WIDTH + i], Y[4 * WIDTH + i]
            y5, y6, y7, y8, y9 = (
                Y[5 * WIDTH + i], Y[6 * WIDTH + i], Y[7 * WIDTH + i], Y[8 * WIDTH + i], Y[9 * WIDTH + i],
            )  # fmt: skip
            K[WIDTH * r + i] = (
                (force[WIDTH * r + i] + a0 * y0 + a1 * y1 + a2 * y2 + a3 * y3 + a4 * y4)
                + (a5 * y5 + a6 * y6 + a7 * y7 + a8 * y8 + a9 * y9)
            )  # fmt: skip
            K[WIDTH * (r + 1) + i] = (
                (force[WIDTH * (r + 1) + i] + b0 * y0 + b1 * y1 + b2 * y2 + b3 * y3 + b4 * y4)
                + (b5 * y5 + b6 * y6 + b7 * y7 + b8 * y8 + b9 * y9)
            )  # fmt: skip
    q0, q1, q2, q3 = 0.5 * A[_TURN], 0.5 * A[_TURN + 1], 0.5 * A[_TURN + 2], 0.5 * A[_TURN + 3]
    p, q, r_ = 0.5 * A[_TURN + 4], 0.5 * A[_TURN + 5], 0.5 * A[_TURN + 6]
    for i in range(WIDTH):
        dp, dq, dr = Y[3 * WIDTH + i], Y[4 * WIDTH + i], Y[5 * WIDTH + i]
        d0, d1, d2, d3 = Y[6 * WIDTH + i], Y[7 * WIDTH + i], Y[8 * WIDTH + i], Y[9 * WIDTH + i]
        K[6 * WIDTH + i] = -q1 * dp - q2 * dq - q3 * dr - p * d1 - q * d2 - r_ * d3
        K[7 * WIDTH + i] = q0 * dp + q2 * dr - q3 * dq + p * d0 + r_ * d2 - q * d3
        K[8 * WIDTH + i] = q0 * dq - q1 * dr + q3 * dp + q * d0 - r_ * d1 + p * d3
        K[9 * WIDTH + i] = q0 * dr + q1 * dq - q2 * dp + r_ * d0 + q * d1 - p * d2


@jit_fused
def _ahead(X: Array, K: Array, step: float, Y: Array) -> None:
    for i in range(BLOCK):
        Y[i] = X[i] + step * K[i]


@jit_fused
def _finish(X: Array, K1: Array, K2: Array, K3: Array, K4: Array, sixth: float) -> None:
    for i in range(BLOCK):
        X[i] += sixth * (K1[i] + 2.0 * (K2[i] + K3[i]) + K4[i])


@jit_fused
def _normalise(X: Array, n0: float, n1: float, n2: float, n3: float, length: float) -> None:
    """Tangents after the quaternion was divided by its `length`; n0 ... n3: the quaternion of length 1."""
    for i in range(WIDTH):
        d0, d1, d2, d3 = X[6 * WIDTH + i], X[7 * WIDTH + i], X[8 * WIDTH + i], X[9 * WIDTH + i]
        along = n0 * d0 + n1 * d1 + n2 * d2 + n3 * d3
        X[6 * WIDTH + i] = (d0 - n0 * along) / length
        X[7 * WIDTH + i] = (d1 - n1 * along) / length
        X[8 * WIDTH + i] = (d2 - n2 * along) / length
        X[9 * WIDTH + i] = (d3 - n3 * along) / length


@jit_fused
def advance_lanes(X: Array, A: Array, force: Array, step: float, x: Array, length: float, work: Array) -> None:
    """One step of classical Runge-Kutta for all blocks X (blocks, BLOCK), in place.

    A: (4, STAGE) stages of the motion's own step. force: (4, blocks, 6 WIDTH) direct effects of the unknowns.
    x: (14,) the motion's state after the step, whose quaternion has been divided by `length`. work: (5, BLOCK).
    """
    Y, K1, K2, K3, K4 = work[0], work[1], work[2], work[3], work[4]
    for block in range(X.shape[0]):
        tangent = X[block]
        _stage(A[0], force[0, block], tangent, K1)
        _ahead(tangent, K1, 0.5 * step, Y)
        _stage(A[1], force[1, block], Y, K2)
        _ahead(tangent, K2, 0.5 * step, Y)
        _stage(A[2], force[2, block], Y, K3)
        _ahead(tangent, K3, step, Y)
        _stage(A[3], force[3, block], Y, K4)
        _finish(tangent, K1, K2, K3, K4, step / 6.0)
        _normalise(tangent, x[6], x[7], x[8], x[9], length)


@jit_fused
def turn_quaternions(X: Array, M: Array) -> None:
    """Multiply the quaternion part of all tangents by M (4, 4)."""
    for block in range(X.shape[0]):
        tangent = X[block]
        for i in range(WIDTH):
            d0, d1, d2, d3 = (
                tangent[6 * WIDTH + i], tangent[7 * WIDTH + i], tangent[8 * WIDTH + i], tangent[9 * WIDTH + i],
            )  # fmt: skip
            for j in range(4):
                tangent[(6 + j) * WIDTH + i] = M[j, 0] * d0 + M[j, 1] * d1 + M[j, 2] * d2 + M[j, 3] * d3


@jit_fused
def direct_effects(R: Array, products: Array, terms: IntArray, columns: IntArray, force: Array) -> None:
    """How the unknowns act on the rates of u v w p q r, into `force` (blocks, 6 WIDTH).

    R: Jacobian of the forces. terms, columns: per unknown the term of the model it is the coefficient of and its column
    of R; a term below 0 for one that acts by itself (thrust), a column below 0 for one that acts on nothing.
    """
    for lane in range(columns.size):
        column = columns[lane]
        if column < 0:
            continue
        product = products[terms[lane]] if terms[lane] >= 0 else 1.0
        target = force[lane // WIDTH]
        i = lane % WIDTH
        for r in range(6):
            target[r * WIDTH + i] = R[r, column] * product


@jit_fused
def coefficient_change(D: Array, axis: int, surfaces: Array) -> float:
    """Change of a coefficient by changes of de da dr and of controls of other names (3 + named,), D: its slopes."""
    change = 0.0
    for j in range(3):
        change += D[axis, _ELEVATOR + j] * surfaces[j]
    for j in range(3, surfaces.size):
        change += D[axis, _NAMED + j - 3] * surfaces[j]
    return change


@jit_fused
def driven_effects(R: Array, D: Array, surfaces: Array, thrust: Array, slopes: Array, first: int, force: Array) -> None:
    """How changes of the inputs act on the rates of u v w p q r, into `force` (blocks, 6 WIDTH) from lane `first` on.

    R, D: as `force_jacobian` left them, rows of rates that are imposed 0. Per lane, surfaces: (L, 3 + named) changes of
    de da dr and controls of other names; thrust: (L,) of the thrust; slopes: (L, 6) of the rates that are imposed, 0
    for the others.
    """
    for lane in range(thrust.size):
        target, i = force[(first + lane) // WIDTH], (first + lane) % WIDTH
        for r in range(FORCED):
            target[r * WIDTH + i] = slopes[lane, r] + R[r, THRUST_COLUMN] * thrust[lane]
        for axis in range(_AXES):
            change = coefficient_change(D, axis, surfaces[lane])
            if change != 0.0:
                for r in range(FORCED):
                    target[r * WIDTH + i] += R[r, STATE_COLUMNS + axis] * change


@jit_fused
def read_driven(
    D: Array, H: Array, rows: IntArray, gain: Array, surfaces: Array, thrust: Array, places: IntArray, out: Array
) -> None:
    """Add what accelerometers feel of changes of the inputs at once to out[i, places[lane]]; see `driven_effects`."""
    for k in range(rows.size):
        if rows[k] < 9 or rows[k] > 11:
            continue
        for lane in range(thrust.size):
            felt = H[rows[k], THRUST_COLUMN] * thrust[lane]
            for axis in range(_AXES):
                felt += H[rows[k], STATE_COLUMNS + axis] * coefficient_change(D, axis, surfaces[lane])
            out[k, places[lane]] += gain[k] * felt


@jit_fused
def _read_row(h: Array, gain: float, tangent: Array, row: int, count: int, out: Array) -> None:
    """Derivatives of one reading by the first `count` unknowns of a block, into `out`.

    row: of READINGS, with Jacobian h (COLUMNS,), of which what always vanishes is passed over.
    """
    if 3 <= row < 6:  # a rate follows from itself alone
        alone = gain * h[row]
        for i in range(count):
            out[i] = alone * tangent[row * WIDTH + i]
        return
    h0, h1, h2, h3, h4, h5 = gain * h[0], gain * h[1], gain * h[2], gain * h[3], gain * h[4], gain * h[5]
    if row < 3 or (9 <= row < 12 and h[6] == 0.0 and h[7] == 0.0 and h[8] == 0.0 and h[9] == 0.0):
        for i in range(count):
            out[i] = (h0 * tangent[i] + h1 * tangent[WIDTH + i] + h2 * tangent[2 * WIDTH + i]) + (
                h3 * tangent[3 * WIDTH + i] + h4 * tangent[4 * WIDTH + i] + h5 * tangent[5 * WIDTH + i]
            )
        return
    h6, h7, h8, h9 = gain * h[6], gain * h[7], gain * h[8], gain * h[9]
    if row < 9:
        for i in range(count):
            out[i] = (h6 * tangent[6 * WIDTH + i] + h7 * tangent[7 * WIDTH + i]) + (
                h8 * tangent[8 * WIDTH + i] + h9 * tangent[9 * WIDTH + i]
            )
        return
    for i in range(count):
        out[i] = (
            (h0 * tangent[i] + h1 * tangent[WIDTH + i] + h2 * tangent[2 * WIDTH + i] + h3 * tangent[3 * WIDTH + i]
             + h4 * tangent[4 * WIDTH + i])
            + (h5 * tangent[5 * WIDTH + i] + h6 * tangent[6 * WIDTH + i] + h7 * tangent[7 * WIDTH + i]
               + h8 * tangent[8 * WIDTH + i] + h9 * tangent[9 * WIDTH + i])
        )  # fmt: skip


@jit_fused
def read_lanes(X: Array, H: Array, rows: IntArray, gain: Array, products: Array, terms: IntArray, columns: IntArray,
               places: IntArray, out: Array, work: Array) -> None:  # fmt: skip
    """Derivatives of readings, gain times H (readings, COLUMNS), for every unknown: out[i, places[lane]].

    rows: of H, one for each row of `out`. gain: likewise. terms, columns: as in `direct_effects`. places: ascending.
    work: (WIDTH,).
    """
    for block in range(X.shape[0]):
        first = block * WIDTH
        count = min(WIDTH, columns.size - first)
        # Unknowns mostly stand side by side, and are then written at once.
        together = places[first + count - 1] - places[first] == count - 1
        for k in range(rows.size):
            if together:
                _read_row(H[rows[k]], gain[k], X[block], rows[k], count, out[k, places[first] :])
            else:
                _read_row(H[rows[k]], gain[k], X[block], rows[k], count, work)
                for i in range(count):
                    out[k, places[first + i]] = work[i]
    for k in range(rows.size):
        if rows[k] < 9 or rows[k] > 11:
            continue  # only accelerometers feel an unknown before it has moved anything
        for lane in range(columns.size):
            if columns[lane] >= 0:
                product = products[terms[lane]] if terms[lane] >= 0 else 1.0
                out[k, places[lane]] += gain[k] * product * H[rows[k], columns[lane]]

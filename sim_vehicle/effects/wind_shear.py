"""Wind shear: a north wind that grows by `gradient` with height h.

    wind_north = wind_north(0) + gradient h

Velocities u v w that are against the air at the aircraft's height change by what that air gains besides:

    d(u v w)/dt = that in uniform air - gradient h' R n     vn = (R^T u v w)_north + gradient h

R turns earth to body axes, n points north (W. Frost, R. L. Bowles, "Wind Shear Terms in the Equations of Aircraft
Motion", J. Aircraft 21(11), 1984, pp. 866-872). Height acts on readings of the velocity over ground alone.
"""

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage
from sim_vehicle.jit import jit

Array = NDArray[np.float64]

WIND_SHEAR = Effect(
    "wind_shear",
    "wind that grows with height",
    Stage.ENVIRONMENT,
    (Parameter("gradient", "1/s", -1.0, 1.0, starts=(0.0,)),),
    "the same run with reversed heading",
    needs=(Need.HEIGHT,),
    phrase="the wind changes by {gradient} m/s for each metre of height",
)


@jit
def sheared_wind(gradient: float, height: float) -> float:
    """North wind [m/s] at `height` [m], and by a rate of climb [m/s] for the height its rate [m/s2]."""
    return gradient * height


@jit
def shear_slopes(x: Array, gradient: float, slopes: Array) -> None:
    """Derivatives of what the shear adds to the rates of u v w, by u v w and the quaternion of the state.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad.
    gradient : float
        Growth of the north wind with height, 1/s.
    slopes : Array, shape (3, 7)
        Result, written over: by u v w [1/s], then by the four parts of the quaternion [m/s^2].

    References
    ----------
    W. Frost, R. L. Bowles, "Wind Shear Terms in the Equations of Aircraft Motion", J. Aircraft 21(11), 1984,
    pp. 866-872.
    """
    u, v, w = x[3], x[4], x[5]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    north = (q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2))
    down = (2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    turned = ((q0, q1, -q2, -q3), (-q3, q2, q1, -q0), (q2, q3, q0, q1))  # half of what `north` changes by
    falling = (-q2 * u + q1 * v + q0 * w, q3 * u + q0 * v - q1 * w, -q0 * u + q3 * v - q2 * w, q1 * u + q2 * v + q3 * w)
    sink = down[0] * u + down[1] * v + down[2] * w
    for i in range(3):
        for j in range(3):
            slopes[i, j] = gradient * north[i] * down[j]
        for c in range(4):
            slopes[i, 3 + c] = 2.0 * gradient * (falling[c] * north[i] + sink * turned[i][c])

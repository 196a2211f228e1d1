"""What compiled functions take together: named records of arrays and numbers, which cost no more than their fields."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


NOT_SEEN: Array = np.zeros((0, 4))


class ModelArrays(NamedTuple):
    """Vehicle and model, of n aerodynamic terms.

    Attributes
    ----------
    P : Array, shape (PAR_SIZE,)
        Vehicle constants (`sim_vehicle.physics.layout`), SI units and rad.
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    C : Array, shape (n,)
        Values of the aerodynamic terms, dimensionless.
    F : IntArray, shape (n, 4)
        Places of their factors in the work array: in REGRESSORS, from WORK_SIZE on for the vehicle's controls of other
        names, -1 for none.
    K : IntArray, shape (n,)
        Their kinds (`sim_vehicle.physics.dynamics`).
    T : IntArray, shape (7,)
        Bounds of the axes among them: axis i has the terms T[i] ... T[i + 1] - 1.
    """

    P: Array
    E: Array
    C: Array
    F: IntArray
    K: IntArray
    T: IntArray


class DrivingInputs(NamedTuple):
    """What drives a simulation, N samples.

    Attributes
    ----------
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        de, da, dr [rad] and throttle (0 to 1), held from each sample on. Two more inputs at each sample: the height
        [m], which counts instead of the integrated one where it is not NaN, and the way, -1 to 1, in which the thrust
        sensor's reading moves. Three more where surfaces go in straight lines from sample to sample: what de, da and dr
        rise by [rad], about means in the first columns; NaN where they are held. Behind these the vehicle's controls of
        other names, held.
    thrust : Array, shape (N,)
        Thrust as the sensor reads it, N; NaN where it follows from the throttle.
    rho : Array, shape (N,)
        Air density, kg/m^3.
    held : Array, shape (N, 9) or (0, 9)
        u v w p q r phi theta psi that are imposed at each sample instead of integrated [m/s, rad/s, rad], NaN where
        free; (0, 9) where all are free. Between samples imposed velocities and rates go in a straight line, so that
        forces which a model lacks do no harm; imposed angles follow the rates.
    gusts : Array, shape (N, 3) or (0, 3)
        Body-axis velocity of the air at the samples, m/s; (0, 3) for still air.
    dt : float
        Interval of the samples, s.
    sub_steps : int
        Runge-Kutta steps in each interval.
    command_first : float
        1 where a sensor at a sample already sees the command of that sample (as many simulations do), 0 where it sees
        that of the sample before (as a vehicle does that reads, then commands); between them where commands are means
        over the intervals, so that at a sample the mean of both acts.
    seen : Array, shape (N, 4 + named) or (0, 4)
        Surfaces that sensors see at the samples [rad], throttle (0 to 1) and controls of other names, where that is
        known by itself; it then counts instead of `command_first`.
    """

    commands: Array
    thrust: Array
    rho: Array
    held: Array
    gusts: Array
    dt: float
    sub_steps: int
    command_first: float
    seen: Array = NOT_SEEN


class TickState(NamedTuple):
    """A vehicle at the beginning of a tick.

    Attributes
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad.
    actuators : Array, shape (ACTUATOR_SIZE,)
        State of the actuators, rad and throttle (0 to 1).
    surfaces : Array, shape (4 + named,)
        Surfaces that a sensor sees, rad, throttle (0 to 1), and controls of other names.
    """

    x: Array
    actuators: Array
    surfaces: Array


class TickInputs(NamedTuple):
    """What drives one tick.

    Attributes
    ----------
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        As of `DrivingInputs`.
    row : int
        Row of `commands` to fly from.
    wind : Array, shape (3,)
        Velocity of the air, north east down, m/s, mean over the tick.
    gust : Array, shape (3,)
        Velocity of the air in body axes on top, m/s, mean over the tick.
    rho : float
        Air density, kg/m^3.
    thrust : float
        Measured thrust, mean over the tick, N, or NaN where it follows from the throttle.
    slopes : Array, shape (6,) or (0,)
        Imposed rates of u v w [m/s^2] and p q r [rad/s^2], NaN where free; (0,) where all are free.
    dt : float
        Interval of the ticks, s.
    sub_steps : int
        Runge-Kutta steps in the tick.
    """

    commands: Array
    row: int
    wind: Array
    gust: Array
    rho: float
    thrust: float
    slopes: Array
    dt: float
    sub_steps: int


class Moment(NamedTuple):
    """A moment within a tick.

    Attributes
    ----------
    share : float
        Part of the tick that is over by then, 0 to 1, dimensionless.
    gust : Array, shape (3,)
        Velocity of the air in body axes on top of the wind, m/s.
    thrust : float
        Measured thrust, N, or NaN where it follows from the throttle.
    """

    share: float
    gust: Array
    thrust: float


class TickWork(NamedTuple):
    """Work arrays of a tick, written over.

    Attributes
    ----------
    W : Array, shape (WORK_SIZE + named,)
        Regressors, by-products (`Aux`) and the time, which alone counts before the tick, SI units.
    scratch : Array, shape (6, 14)
        Stages of a Runge-Kutta step, and surfaces at its begin, SI units and rad.
    mean : Array, shape (4 + named,)
        Mean surfaces over a step, rad, and throttle (0 to 1).
    rate : Array, shape (14,)
        Rate of the state, SI units and rad.
    """

    W: Array
    scratch: Array
    mean: Array
    rate: Array

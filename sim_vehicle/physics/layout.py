"""Places in the flat arrays that the compiled code works on. One name per place, shared by all compiled modules."""

from enum import IntEnum, auto

from sim_vehicle.effects import SENSOR_LAGS
from sim_vehicle.model.aerodynamic_terms import REGRESSORS

# State: position north east down [m], velocity u v w of the aircraft over ground in body axes [m/s], attitude
# quaternion (earth to body, scalar first), body rates p q r [rad/s], angle of attack the lift feels [rad].
STATE_SIZE = 14
NORTH, U, QUATERNION, P_RATE, LIFT_ALPHA = 0, 3, 6, 10, 13

SURFACES = ("de", "da", "dr", "throttle")
# First column of the commands in which controls of other names may stand, and how many of them there may be.
MORE_COLUMN, MOST_CONTROLS = 9, 10


# A curve: how many pieces it has, its end, then each piece's start and powers of the distance from it.
CURVE_SEGMENTS, CURVE_COEFFICIENTS = 24, 6
CURVE_SIZE = 2 + CURVE_SEGMENTS * (1 + CURVE_COEFFICIENTS)


class Par(IntEnum):
    """The vehicle's constants."""

    mass = 0
    Ixx = auto()
    Iyy = auto()
    Izz = auto()
    Ixz = auto()
    S = auto()
    b = auto()
    c = auto()
    gravity = auto()
    reference_speed = auto()
    max_thrust = auto()
    max_rotor_rad_s = auto()
    propeller_x = auto()
    propeller_y = auto()
    propeller_z = auto()
    inclination = auto()
    rotation = auto()
    diameter = auto()
    motor_tau = auto()
    accelerometer_x = auto()
    accelerometer_y = auto()
    accelerometer_z = auto()
    alpha_vane_x = auto()
    alpha_vane_y = auto()
    alpha_vane_z = auto()
    beta_vane_x = auto()
    beta_vane_y = auto()
    beta_vane_z = auto()
    beta_is_flank = auto()
    airspeed_is_calibrated = auto()
    moving_mass = auto()
    has_alphadot = auto()


# Behind the constants: the propeller's curves over advance ratio (sim_vehicle.vehicle.propulsion.pack_curve).
CT_PLACE = len(Par)
CQ_PLACE = CT_PLACE + CURVE_SIZE
PAR_SIZE = CQ_PLACE + CURVE_SIZE


class Aux(IntEnum):
    """By-products of the equations of motion, behind the regressors in the work array."""

    V = len(REGRESSORS)
    alpha = auto()
    beta = auto()
    ax = auto()
    ay = auto()
    az = auto()
    p_dot = auto()
    q_dot = auto()
    r_dot = auto()
    alpha_dot = auto()
    thrust = auto()
    rho = auto()
    CL = auto()
    CD = auto()
    CY = auto()
    Cl = auto()
    Cm = auto()
    Cn = auto()
    v_body = auto()
    u_body = auto()
    # Not a by-product: the time, s from the flight's first stamp. Whoever flies sets it.
    time = auto()


# Behind them in the work array: the controls of other names that the model has terms of.
WORK_SIZE = len(REGRESSORS) + len(Aux)

# What ideal sensors at their mounting places read.
CHANNELS = (
    "airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az",
    "thrust", "altitude", "vn", "ve", "vd", "north", "east",
)  # fmt: skip


# Memory of sensors, two values each (last input, last output): of every lag in the order of SENSOR_LAGS, then of the
# thrust sensor's play.
THRUST_PLAY_PLACE = sum(len(outputs) for outputs in SENSOR_LAGS.values())
SENSOR_SIZE = 2 * (THRUST_PLAY_PLACE + 1)

# Per surface: position of the servo, output behind free play. Then the lagged throttle, and the commands that the
# servos have accepted.
THROTTLE_PLACE, ACCEPTED_PLACE = 6, 7
ACTUATOR_SIZE = 10
# How many ticks a delayed command can reach back: 0.2 s at 300 Hz.
HISTORY = 64

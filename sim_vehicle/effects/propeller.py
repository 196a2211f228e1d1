"""Moments and forces of the propeller besides thrust: torque, P-factor, gyroscopic moment, normal force."""

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage
from sim_vehicle.jit import jit

PROPELLER_TORQUE = Effect(
    "propeller_torque",
    "torque of the propeller",
    Stage.PROPULSION,
    (Parameter("k_Q", "m", -0.2, 0.2, starts=(0.0,)),),
    "throttle steps",
    phrase="the propeller's torque rolls the aircraft ({k_Q:mm} times the thrust)",
)
P_FACTOR = Effect(
    "p_factor",
    "P-factor of the propeller",
    Stage.PROPULSION,
    (Parameter("k_P", "1", -2.0, 2.0, starts=(0.0,)),),
    "throttle steps at two angles of attack",
    needs=(Need.DIAMETER,),
    phrase="the propeller's P-factor turns the aircraft (k_P = {k_P})",
)
PROPELLER_GYROSCOPIC = Effect(
    "propeller_gyroscopic",
    "gyroscopic moment of the propeller",
    Stage.PROPULSION,
    (Parameter("I_P", "kg m2", -2e-3, 2e-3, starts=(0.0,)),),
    "fast pitch multisine at two propeller speeds",
    needs=(Need.ROTOR_SPEED,),
    phrase="the propeller is a gyroscope (I_P = {I_P} kg m2)",
)
PROPELLER_NORMAL_FORCE = Effect(
    "propeller_normal_force",
    "normal force of the propeller",
    Stage.PROPULSION,
    (Parameter("k", "1/rad", -5.0, 5.0, starts=(0.0,)),),
    "throttle steps at several angles of attack",
    phrase="the propeller at an angle makes a normal force (k = {k} per rad)",
)


@jit
def torque_roll(thrust: float, rotation: float, k_Q: float) -> float:
    """Rolling moment [N m]; rotation +1 clockwise seen from behind: the airframe reacts to the left."""
    return -rotation * k_Q * thrust


@jit
def p_factor_moment(thrust: float, diameter: float, angle: float, rotation: float, k_P: float) -> float:
    """Moment [N m] by the blade that goes down; `angle` is alpha for yaw, beta for pitch [rad]."""
    return -rotation * k_P * thrust * diameter * angle


@jit
def gyroscopic_moment(rotor_rad_s: float, rate: float, I_P: float) -> float:
    """Magnitude I_P Omega times body rate [N m]."""
    return I_P * rotor_rad_s * rate


@jit
def normal_force(thrust: float, alpha: float, k: float) -> float:
    """Force along -z [N]."""
    return k * thrust * alpha

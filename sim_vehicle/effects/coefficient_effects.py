"""Effects that are terms of the aerodynamic model; the ranges are for a fixed wing below two metres."""

from sim_vehicle.effects.base import CoefficientEffect, Parameter, Stage


def _term(name: str, low: float, high: float, start: float = 0.0) -> Parameter:
    return Parameter(name, "1", low, high, starts=(start,))


def _effect(name: str, title: str, separated_by: str, *terms: Parameter) -> CoefficientEffect:
    return CoefficientEffect(name, title, Stage.AERODYNAMICS, terms, separated_by)


COEFFICIENT_EFFECTS = (
    _effect(
        "pitch_damping",
        "pitch damping",
        "steady pull-up or turn and a loaded roll",
        _term("Cm_q", -60.0, 20.0),
    ),
    _effect(
        "downwash_lag",
        "downwash lag",
        "elevator multisine that separates q from alpha-dot",
        _term("Cm_alphadot", -20.0, 10.0),
        _term("CL_alphadot", -20.0, 20.0),
    ),
    _effect(
        "pitch_curvature",
        "curvature of the pitching moment",
        "slow deceleration to the stall at two throttle settings",
        _term("Cm_alpha2", -20.0, 20.0),
        _term("Cm_alpha3", -100.0, 100.0),
    ),
    _effect("lift_pitch_rate", "lift due to pitch rate", "steady pull-up or turn", _term("CL_q", -40.0, 40.0)),
    _effect(
        "polar_offset",
        "drag polar with its minimum off zero lift",
        "trims at low and high lift, push-over and pull-up",
        _term("CD_CL", -0.5, 0.5),
    ),
    _effect(
        "control_drag",
        "drag of the elevator",
        "elevator pulses of large amplitude",
        _term("CD_de2", -10.0, 10.0),
    ),
    _effect(
        "lift_alpha_elevator",
        "elevator lift that varies with angle of attack",
        "elevator multisine at two angles of attack",
        _term("CL_alpha_de", -20.0, 20.0),
    ),
    _effect(
        "dihedral",
        "dihedral effect",
        "steady-heading sideslips and a rudder doublet",
        _term("Cl_beta", -1.0, 1.0),
    ),
    _effect("weathercock", "weathercock stability", "rudder doublet", _term("Cn_beta", -1.0, 1.0)),
    _effect("roll_damping", "roll damping", "bank-to-bank rolls at two amplitudes", _term("Cl_p", -3.0, 1.0)),
    _effect("yaw_damping", "yaw damping", "orthogonal rudder and aileron multisines", _term("Cn_r", -3.0, 1.0)),
    _effect(
        "cross_roll_yaw",
        "roll due to yaw rate and yaw due to roll rate",
        "orthogonal rudder and aileron multisines",
        _term("Cl_r", -2.0, 2.0),
        _term("Cn_p", -2.0, 2.0),
    ),
    _effect("adverse_yaw", "yaw due to aileron", "aileron steps alone", _term("Cn_da", -1.0, 1.0)),
    _effect("rudder_roll", "roll due to rudder", "rudder steps alone", _term("Cl_dr", -1.0, 1.0)),
    _effect(
        "asymmetry",
        "asymmetric trim",
        "power-off glide against power-on flight",
        _term("Cl_0", -0.1, 0.1),
        _term("Cn_0", -0.1, 0.1),
    ),
    _effect("side_force", "side force due to sideslip", "steady-heading sideslips", _term("CY_beta", -5.0, 2.0)),
    _effect(
        "sideslip_drag",
        "drag due to sideslip",
        "steady-heading sideslips both ways",
        _term("CD_beta2", -10.0, 10.0),
    ),
)

"""Vehicle and model as the flat arrays the compiled code works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import pack_effects
from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import AXES, MAX_FACTORS, POLAR, REGRESSORS, Term, parse_term
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.dynamics import ELEVATOR_MOMENT, INDUCED_DRAG, PLAIN, ZERO_LIFT_DRAG
from sim_vehicle.physics.kernel_records import ModelArrays
from sim_vehicle.physics.layout import CQ_PLACE, CT_PLACE, PAR_SIZE, WORK_SIZE, Par
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.propulsion import pack_curve, rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class PackedModel:
    """P: vehicle constants; E: effect vector; C, F, K, T: values, factors, kinds and axis bounds of the terms.

    names: coefficient names in the order of C.
    """

    P: Array
    E: Array
    C: Array
    F: IntArray
    K: IntArray
    T: IntArray
    names: tuple[str, ...]

    @property
    def arrays(self) -> ModelArrays:
        """What the compiled functions take of it."""
        return ModelArrays(self.P, self.E, self.C, self.F, self.K, self.T)

    def copy(self) -> PackedModel:
        """The same with P, E and C free to change."""
        return PackedModel(self.P.copy(), self.E.copy(), self.C.copy(), self.F, self.K, self.T, self.names)


def flatten_vehicle(vehicle: Vehicle) -> Array:
    """Constants of a vehicle for the compiled code.

    Parameters
    ----------
    vehicle : Vehicle
        What its file says, SI units and rad.

    Returns
    -------
    Array, shape (PAR_SIZE,)
        Constants in the order of `Par`, SI units and rad; a propeller that is not there gives zeros.
    """
    P = np.zeros(PAR_SIZE)
    mass, geometry = vehicle.mass, vehicle.geometry
    for name in ("mass", "Ixx", "Iyy", "Izz", "Ixz"):
        P[Par[name]] = getattr(mass, name)
    for name in ("S", "b", "c"):
        P[Par[name]] = getattr(geometry, name)
    P[Par.gravity] = vehicle.environment.gravity
    P[Par.reference_speed] = vehicle.flight.airspeed
    propulsion = vehicle.propulsion
    P[Par.rotation] = 1.0
    if propulsion is not None:
        P[Par.max_thrust] = propulsion.max_thrust or 0.0
        P[Par.max_rotor_rad_s] = rotor_scale(propulsion)
        P[Par.propeller_x : Par.propeller_z + 1] = propulsion.line
        P[Par.inclination] = propulsion.inclination
        P[Par.rotation] = 1.0 if propulsion.rotation == "cw" else -1.0
        P[Par.diameter] = propulsion.diameter or 0.0
        P[Par.motor_tau] = propulsion.tau
        P[Par.moving_mass] = propulsion.moving_mass
        P[CT_PLACE:CQ_PLACE] = pack_curve(propulsion.CT)
        P[CQ_PLACE:] = pack_curve(propulsion.CQ)
    sensors = vehicle.sensors
    P[Par.accelerometer_x : Par.accelerometer_z + 1] = sensors.accelerometer.position
    P[Par.alpha_vane_x : Par.alpha_vane_z + 1] = sensors.alpha_vane.position
    P[Par.beta_vane_x : Par.beta_vane_z + 1] = sensors.beta_vane.position
    P[Par.beta_is_flank] = 1.0 if sensors.beta_vane.kind == "flank" else 0.0
    P[Par.airspeed_is_calibrated] = 0.0 if sensors.airspeed.kind == "true" else 1.0
    return P


def _kind(term: Term) -> int:
    if term.axis == "Cm" and "de" in term.factors:
        return ELEVATOR_MOMENT
    return {"CD_0": ZERO_LIFT_DRAG, POLAR: INDUCED_DRAG}.get(term.name, PLAIN)


def require_controls(vehicle: Vehicle, model: Model) -> None:
    """Raise ModelFileError where a coefficient is of a control that the vehicle does not have."""
    for name in model.coefficients:
        control = parse_term(name).control
        if control and control not in vehicle.named_controls:
            raise ModelFileError(
                f"model {model.name}: {name} is of {control}, which is neither a regressor nor a control of"
                f" {vehicle.name}: name it under [controls.{control}] of the vehicle file, or correct the coefficient"
            )


def flatten(vehicle: Vehicle, model: Model) -> PackedModel:
    """Vehicle and model for the compiled code. Raises ModelFileError where a coefficient has no value."""
    unknown = model.unknown()
    if unknown:
        raise ModelFileError(
            f"model {model.name}: {', '.join(unknown)} could not be identified from the flight; "
            f"give one, as --set {unknown[0]}=VALUE"
        )
    for effect in model.effects:
        if effect.refused():
            key = effect.refused()[0]
            raise ModelFileError(
                f"model {model.name}: {key} of effect {effect.name} could not be identified from the flight; "
                f"give one, as --effect {effect.name}:{key}=VALUE"
            )
    require_controls(vehicle, model)
    values = model.flown()
    if vehicle.motors:
        values |= {f"{axis}_{name}": 1.0 for axis, name in zip(("Cl", "Cm", "Cn"), MOTOR_MOMENTS, strict=True)}
    terms = sorted((parse_term(name) for name in values), key=lambda term: AXES.index(term.axis))
    F = np.full((len(terms), MAX_FACTORS), -1, dtype=np.int64)
    named = vehicle.named_inputs
    for i, term in enumerate(terms):
        for j, factor in enumerate(term.factors):
            F[i, j] = REGRESSORS.index(factor) if factor in REGRESSORS else WORK_SIZE + named.index(factor)
    C = np.array([values[term.name] for term in terms], dtype=np.float64)
    K = np.array([_kind(term) for term in terms], dtype=np.int64)
    axes = [AXES.index(term.axis) for term in terms]
    T = np.array([sum(axis < limit for axis in axes) for limit in range(len(AXES) + 1)], dtype=np.int64)
    P = flatten_vehicle(vehicle)
    P[Par.has_alphadot] = float(any("alphadot" in term.factors for term in terms))
    effects = {effect.name: effect.values() for effect in model.effects}
    if "p_factor" in effects and P[Par.diameter] == 0.0:
        raise ModelFileError(
            "effect p_factor needs the propeller's diameter: give [propulsion] diameter in the vehicle file"
        )
    if (
        "propeller_gyroscopic" in effects
        and P[CT_PLACE] == 0.0
        and (P[Par.max_thrust] == 0.0 or P[Par.max_rotor_rad_s] == 0.0)
    ):
        raise ModelFileError(
            "effect propeller_gyroscopic needs the propeller's speed: "
            "give [propulsion] max_thrust and max_rpm in the vehicle file"
        )
    E = np.array(pack_effects(effects), dtype=np.float64)
    return PackedModel(P, E, C, F, K, T, tuple(term.name for term in terms))

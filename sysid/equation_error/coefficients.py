"""Nondimensional force and moment coefficients from corrected flight data.

Lift and drag in stability axes, side force along body y, moments about the centre of gravity, each
less what the propulsion gives (Jolly, Unhelkar, Arya, section III; Klein & Morelli, chapter 5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.kinematics import to_centre_of_gravity
from sysid.errors import SignalError
from sysid.signals.flight import FlightData
from sysid.signals.record import has_positions

AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")


@dataclass(frozen=True)
class Body:
    """What is known of the aircraft before the flight.

    mass: kg. Ixx, Iyy, Izz, Ixz: kg m^2 about the centre of gravity, Ixz = + integral of x z dm.
    S: m^2. b, c: m.
    thrust_point: a point of the thrust line from the centre of gravity, m. thrust_direction: unit vector, body axes.
    torque_sign: of the moment along it by which the airframe answers the propeller's torque: -1 clockwise from behind.
    accelerometer: position from the centre of gravity, m; used only on data not yet moved there.
    air_density: kg/m^3, taken where the flight has no `air_density` column.
    surfaces_measured: whether de, da, dr are where the surfaces were at each sample, and no commands that are held.
    named_controls: those of other names, which may act on any axis.
    """

    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float
    S: float
    b: float
    c: float
    thrust_point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thrust_direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    torque_sign: float = -1.0
    accelerometer: tuple[float, float, float] = (0.0, 0.0, 0.0)
    air_density: float = SEA_LEVEL_DENSITY
    surfaces_measured: bool = False
    named_controls: tuple[str, ...] = ()


def dynamic_pressure(data: FlightData, body: Body) -> Array:
    """Dynamic pressure from true airspeed and density.

    Parameters
    ----------
    data : FlightData
        The flight, N samples: true airspeed `V` [m/s] and, where it has the column, `air_density` [kg/m^3].
    body : Body
        What is known of the aircraft; its air density [kg/m^3] counts where the flight has none.

    Returns
    -------
    Array, shape (N,)
        Dynamic pressure, Pa.
    """
    density = data.columns.get("air_density", body.air_density)
    return np.asarray(0.5 * density * data["V"] ** 2, dtype=np.float64)


def off_centre(data: FlightData, body: Body) -> bool:
    """Whether specific forces are those at an accelerometer away from the centre of gravity."""
    return data.notes.get("reference") != "centre of gravity" and any(body.accelerometer)


def coefficients(data: FlightData, body: Body, rate_derivatives: Array) -> dict[str, Array]:
    """Coefficients of every axis at every sample.

    Parameters
    ----------
    data : FlightData
        The flight, N samples, corrected (`sysid.compatibility.reconstruction.correct`): ax ay az [m/s^2], p q r
        [rad/s], alpha [rad], V [m/s], thrust [N], and torque [N m] where the propeller's is known, and what several
        motors turn by (MOTOR_MOMENTS, dimensionless). Without the note
        that correction leaves, the accelerometer's lever arm is taken off here.
    body : Body
        Mass, inertia, geometry, SI units.
    rate_derivatives : Array, shape (N, 3)
        p' q' r', rad/s^2.

    Returns
    -------
    dict[str, Array], each of shape (N,)
        CL CD CY Cl Cm Cn, dimensionless.

    Raises
    ------
    SignalError
        For a missing signal; a flight without measured thrust needs its estimate in `thrust`.

    References
    ----------
    Jolly, Unhelkar, Arya, section III.
    Klein & Morelli, chapter 5.
    """
    missing = [name for name in ("ax", "ay", "az", "p", "q", "r", "alpha", "V", "thrust") if name not in data]
    if missing:
        raise SignalError(f"{data.name}: coefficients need {', '.join(missing)}, which the flight lacks")
    force = np.column_stack([data[name] for name in ("ax", "ay", "az")])
    rates = np.column_stack([data[name] for name in ("p", "q", "r")])
    if off_centre(data, body):
        force = to_centre_of_gravity(force, rates, rate_derivatives, body.accelerometer)
    direction = np.asarray(body.thrust_direction) / np.linalg.norm(body.thrust_direction)
    push = np.outer(data["thrust"], direction)
    moment = np.cross(np.asarray(body.thrust_point), push)
    if "torque" in data:
        moment = moment + body.torque_sign * np.outer(data["torque"], direction)
    x, y, z = (body.mass * force - push).T
    alpha = data["alpha"]
    qs = dynamic_pressure(data, body) * body.S
    p, q, r = rates.T
    pdot, qdot, rdot = rate_derivatives.T
    roll = body.Ixx * pdot - body.Ixz * (rdot + p * q) + (body.Izz - body.Iyy) * q * r
    pitch = body.Iyy * qdot + (body.Ixx - body.Izz) * p * r + body.Ixz * (p**2 - r**2)
    yaw = body.Izz * rdot - body.Ixz * (pdot - q * r) + (body.Iyy - body.Ixx) * p * q
    turned = {name: data.columns.get(name, 0.0) for name in MOTOR_MOMENTS}
    return {
        "CL": (x * np.sin(alpha) - z * np.cos(alpha)) / qs,
        "CD": -(x * np.cos(alpha) + z * np.sin(alpha)) / qs,
        "CY": y / qs,
        "Cl": (roll - moment[:, 0]) / (qs * body.b) - turned["motor_roll"],
        "Cm": (pitch - moment[:, 1]) / (qs * body.c) - turned["motor_pitch"],
        "Cn": (yaw - moment[:, 2]) / (qs * body.b) - turned["motor_yaw"],
    }


def body_of(vehicle: Vehicle) -> Body:
    """Mass, inertia, geometry and thrust line of the vehicle file."""
    mass, geometry, propulsion = vehicle.mass, vehicle.geometry, vehicle.propulsion
    body = Body(
        mass.mass, mass.Ixx, mass.Iyy, mass.Izz, mass.Ixz, geometry.S, geometry.b, geometry.c,
        accelerometer=vehicle.sensors.accelerometer.position, surfaces_measured=has_positions(vehicle),
        named_controls=vehicle.named_controls,
    )  # fmt: skip
    if propulsion is None:
        return body
    angle = propulsion.inclination
    return Body(
        **{
            **vars(body),
            "thrust_point": propulsion.line,
            "thrust_direction": (float(np.cos(angle)), 0.0, -float(np.sin(angle))),
            "torque_sign": -1.0 if propulsion.rotation == "cw" else 1.0,
        }
    )

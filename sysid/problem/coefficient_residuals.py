"""Force and moment coefficients: as measured along a flight, and as a model gives them for the same motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import slot
from sim_vehicle.effects.thrust_line_offset import THRUST_LINE_OFFSET
from sim_vehicle.physics.layout import Par
from sim_vehicle.physics.propeller import along
from sim_vehicle.physics.simulation import evaluate_path
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import smoothed_states
from sysid.equation_error.coefficients import AXES, Body, body_of, coefficients
from sysid.equation_error.equations import FORCES, MOMENTS
from sysid.numerics.smoothing import fourier_smooth, noise_sigma
from sysid.problem.free_run import Fixed
from sysid.signals.flight import FlightData
from sysid.signals.record import OUTPUTS, STATES, Record, effects_at, held_by_dead_band, with_other_inputs
from sysid.signals.sensor_mounting import SensorMounting
from sysid.signals.thrust.source import lagged_throttle

# Band of the motion: rate derivatives are taken, and forces compared, below it.
CUTOFF_HZ = 8.0
# Where that is weakest: at both ends of a record, s, which are left out.
_EDGE_S = 0.1


@dataclass(frozen=True)
class CoefficientPath:
    """Coefficients along one record but for its ends.

    measured, predicted: axis -> (N,). variables: what a disagreement may depend on, name -> (N,), rates nondimensional.
    """

    time_s: Array
    measured: dict[str, Array]
    predicted: dict[str, Array]
    variables: dict[str, Array]


def known_propulsion(record: Record, model: Fixed, speed: Array) -> tuple[Array, Array]:
    """Thrust, as measured or by the vehicle's law, and the propeller's torque along a record.

    Parameters
    ----------
    record : Record
        Stretch of a flight with N output samples; its thrust is NaN where it follows from the throttle.
    model : Fixed
        Model with nothing left free; gives the vehicle's constants, and the bias of ax, m/s^2, that the moving mass
        brought into the thrust and that is taken off.
    speed : Array, shape (N,)
        Airspeed at the record's samples, m/s.

    Returns
    -------
    thrust : Array, shape (N,)
        Thrust, N.
    torque : Array, shape (N,)
        Torque of the propeller, N m.
    """
    here, P = slice(record.start, record.start + record.length), model.flat.P
    throttle = lagged_throttle(record.commands, record.interval_s, float(P[Par.motor_tau]))[here]
    computed, torque = along(throttle, np.ascontiguousarray(speed), np.ascontiguousarray(record.rho[here]), P)
    thrust = np.where(np.isnan(record.thrust[here]), computed, record.thrust[here])
    return thrust - record.moving_mass * model.errors.get("accel_bias_x", 0.0), torque


def along_path(record: Record, path: Array, model: Fixed) -> Array:
    """Coefficients and accelerations of a model along a motion, as `evaluate_path` gives them.

    Parameters
    ----------
    record : Record
        Stretch of a flight with N output samples: what drives the model.
    path : Array, shape (N, 9)
        STATES, m/s, rad/s and rad.
    model : Fixed
        Model with nothing left free.

    Returns
    -------
    Array, shape (N, 12)
        Six coefficients, dimensionless; ax, ay, az, m/s^2, and p', q', r', rad/s^2, at the centre of gravity.
    """
    predicted = np.empty((record.length, 12))
    flat = model.flat
    thrust = record.thrust
    if record.moving_mass > 0.0:
        thrust = thrust - record.moving_mass * model.errors.get("accel_bias_x", 0.0)
    effects = effects_at(flat, record)
    commands = with_other_inputs(held_by_dead_band(record.commands, record, effects), record, effects)
    evaluate_path(
        np.ascontiguousarray(path), commands, record.start, thrust, record.rho, record.interval_s,
        float(model.command_first), flat.arrays._replace(E=effects), predicted,
    )  # fmt: skip
    return predicted


def _predicted(record: Record, path: Array, model: Fixed) -> dict[str, Array]:
    """Coefficients, axis -> (N,), of a model along states (N, 9), as their measurement sees them.

    Measured moments follow from angular accelerations below CUTOFF_HZ, which about a command that is held see as much
    of what came before it as of what comes after.
    """
    before, after = (along_path(record, path, replace(model, command_first=first)) for first in (0.0, 1.0))
    forces = before + model.command_first * (after - before)
    found = {axis: forces[:, AXES.index(axis)] for axis in FORCES}
    for axis in MOMENTS:
        j = AXES.index(axis)
        found[axis] = fourier_smooth(0.5 * (before[:, j] + after[:, j]), record.interval_s, CUTOFF_HZ).values
    return found


def coefficient_path(record: Record, layout: SensorMounting, vehicle: Vehicle, model: Fixed) -> CoefficientPath:
    """Measured and predicted coefficients along one record, which must have all IMU, airspeed and attitude samples."""
    states = smoothed_states(record, layout, dict(model.errors))
    dt, here = record.interval_s, slice(record.start, record.start + record.length)
    predicted = _predicted(record, np.stack([states[name] for name in STATES], axis=1), model)
    slopes = np.column_stack([fourier_smooth(states[name], dt, CUTOFF_HZ).derivative for name in ("p", "q", "r")])
    speed = np.sqrt(states["u"] ** 2 + states["v"] ** 2 + states["w"] ** 2)
    alpha = np.arctan2(states["w"], states["u"])
    column = {name: record.z[:, OUTPUTS.index(name)] for name in ("ax", "ay", "az")}
    for name in column:
        column[name] = column[name] - model.errors.get(f"accel_bias_{name[1]}", 0.0)
    thrust, torque = known_propulsion(record, model, speed)
    data = FlightData(
        record.flight, dt, record.time_s,
        {
            **column, "p": states["p"], "q": states["q"], "r": states["r"], "alpha": alpha, "V": speed,
            "thrust": thrust, "torque": torque, "air_density": record.rho[here],
        },
    )  # fmt: skip
    measured = coefficients(data, _with_thrust_line(body_of(vehicle), model), slopes)
    variables = _variables(states, alpha, speed, record.commands[here], thrust, dt, vehicle)
    edge = round(_EDGE_S / dt)
    inner = slice(edge, record.length - edge)

    def kept(columns: Mapping[str, Array]) -> dict[str, Array]:
        return {name: values[inner] for name, values in columns.items()}

    return CoefficientPath(record.time_s[inner], kept(measured), kept(predicted), kept(variables))


def _with_thrust_line(body: Body, model: Fixed) -> Body:
    """The body with the thrust line where the model's effect has it: its moment is the propulsion's, not the air's."""
    effects = model.flat.E
    if effects[slot(THRUST_LINE_OFFSET.name)] == 0.0:
        return body
    x, y, z = body.thrust_point
    return replace(body, thrust_point=(x, y, z + float(effects[slot(THRUST_LINE_OFFSET.name, "z_T")])))


def moment_noise(record: Record, vehicle: Vehicle) -> dict[str, float]:
    """Noise of the measured moment coefficients: the gyros' own, passed through the same filter."""
    mass, geometry = vehicle.mass, vehicle.geometry
    airspeed = float(np.nanmean(record.z[:, OUTPUTS.index("airspeed")]))
    # Calibrated airspeed is that which has this dynamic pressure in the density of sea level, by its definition.
    calibrated = vehicle.sensors.airspeed.kind == "calibrated"
    density = SEA_LEVEL_DENSITY if calibrated else float(np.mean(record.rho))
    qS = 0.5 * density * airspeed**2 * geometry.S
    white = np.random.default_rng(0).standard_normal(max(record.length, 16))
    gain = float(np.std(fourier_smooth(white, record.interval_s, CUTOFF_HZ).derivative))
    arms = {"Cl": ("p", mass.Ixx, geometry.b), "Cm": ("q", mass.Iyy, geometry.c), "Cn": ("r", mass.Izz, geometry.b)}
    return {
        axis: noise_sigma(record.z[:, OUTPUTS.index(rate)], record.interval_s) * gain * inertia / (qS * arm)
        for axis, (rate, inertia, arm) in arms.items()
    }


def residual_noise(record: Record, layout: SensorMounting, vehicle: Vehicle, model: Fixed) -> dict[str, float]:
    """Noise of measured minus predicted coefficients, axis -> sigma, by the sensors' own noise added once more.

    Sensors are on both sides: a vane's noise is in what the model predicts as a gyro's is in what is measured.
    """
    generator = np.random.default_rng(0)
    sigma = np.array([_white(values, record.interval_s) for values in record.z.T])
    z = record.z + sigma * generator.standard_normal(record.z.shape)
    thrust = record.thrust + _white(record.thrust, record.interval_s) * generator.standard_normal(record.thrust.size)
    given = coefficient_path(record, layout, vehicle, model)
    noisier = coefficient_path(replace(record, z=z, thrust=thrust), layout, vehicle, model)
    return {
        axis: float(np.std(noisier.measured[axis] - noisier.predicted[axis] - values + given.predicted[axis]))
        for axis, values in given.measured.items()
    }


def _white(values: Array, interval_s: float) -> float:
    """Sigma of the white noise in a signal, 0 where it is not there throughout."""
    return noise_sigma(values, interval_s) if np.isfinite(values).all() else 0.0


def _variables(
    states: Mapping[str, Array], alpha: Array, speed: Array, commands: Array, thrust: Array, dt: float, vehicle: Vehicle
) -> dict[str, Array]:
    b, c = vehicle.geometry.b, vehicle.geometry.c
    return {
        "alpha": alpha,
        "beta": np.arcsin(np.clip(states["v"] / speed, -1.0, 1.0)),
        "V": speed,
        "phat": states["p"] * b / (2.0 * speed),
        "qhat": states["q"] * c / (2.0 * speed),
        "rhat": states["r"] * b / (2.0 * speed),
        "alphadot": np.gradient(alpha, dt) * c / (2.0 * speed),
        "de": commands[:, 0],
        "da": commands[:, 1],
        "dr": commands[:, 2],
        "thrust": thrust,
        **{name: commands[:, 4 + j] for j, name in enumerate(vehicle.named_controls)},
    }

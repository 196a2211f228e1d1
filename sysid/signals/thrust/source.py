"""Where a flight's thrust comes from: a sensor, else the propeller's speed, else the throttle, by [propulsion]."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.propeller import along
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.motors import motor_loads
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.propulsion import rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.numerics.filters import first_order_lag
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightData, repeats
from sysid.signals.thrust.denoising import Denoised, denoised_thrust
from sysid.signals.thrust.electric import BY_BATTERY, BY_BLADES, LAW, gain_doubt

# Source of thrust where several motors have throttles of their own, and where the battery's power gives it.
MOTORS, BATTERY = "motors", "battery power"
# Share by which a thrust that is not measured may be wrong: a propeller's published coefficients hold to about this for
# the next one of its kind.
USUAL_DOUBT = 0.05
THRUST_BY_SQUARE = "max_thrust (rpm / max_rpm)^2"
# Share of the flight through which a signal must be there to be used as an input.
_PRESENT = 0.9
# Travel of the throttle after which thrust must have changed.
_THROTTLE_MOVED = 0.1
# Airspeed follows thrust more slowly than this.
_AIRSPEED_HZ = 1.0


@dataclass(frozen=True)
class ThrustSource:
    """signal: "thrust" (measured), "rpm", "throttle", "motors" or "battery power"; "" where thrust is not known, and
    `missing` says why. law: how thrust follows from it, "" where it is measured. std: share by which all of it may be
    wrong.
    """

    signal: str
    law: str = ""
    missing: str = ""
    std: float = USUAL_DOUBT

    @property
    def doubt(self) -> str:
        """What results call that error."""
        return "battery_efficiency" if self.signal == BATTERY else "thrust_5pct"

    @property
    def measured(self) -> bool:
        return self.signal == "thrust"

    def __str__(self) -> str:
        if not self.signal:
            return "unknown"
        return "measured" if self.measured else f"from {self.signal} by {self.law}"


MEASURED = ThrustSource("thrust")


def _present(data: FlightData, name: str) -> bool:
    return name in data and float(np.isfinite(data[name]).mean()) > _PRESENT


def dead_thrust(thrust: Array, throttle: Array) -> bool:
    """Whether measured thrust repeats one value though the throttle moves: its sensor is dead.

    Parameters
    ----------
    thrust : Array, shape (N,)
        Thrust as measured, N; NaN allowed.
    throttle : Array, shape (K,)
        Throttle, 0 to 1, dimensionless; NaN counts as 0. It may have samples of its own, or none.

    Returns
    -------
    bool
        Whether the sensor is dead.
    """
    return repeats(thrust) and throttle.size > 1 and float(np.ptp(np.nan_to_num(throttle))) > _THROTTLE_MOVED


def thrust_source(data: FlightData, vehicle: Vehicle) -> ThrustSource:
    """Where thrust comes from."""
    propulsion = vehicle.propulsion
    if _present(data, "thrust"):
        return MEASURED
    if propulsion is not None and vehicle.motors and _present(data, "motor_thrust"):
        return ThrustSource(MOTORS, propulsion.by_throttle)
    if propulsion is not None and _present(data, BY_BATTERY):
        by_blades, whole = (float(np.nansum(data[name] ** 2)) for name in (BY_BLADES, BY_BATTERY))
        std = math.hypot(gain_doubt(propulsion), math.sqrt(by_blades / whole) if whole > 0.0 else 1.0)
        return ThrustSource(BATTERY, LAW, std=std)
    if propulsion is not None and propulsion.by_rpm and _present(data, "rpm"):
        return ThrustSource("rpm", propulsion.by_rpm)
    if propulsion is not None and propulsion.by_throttle and _present(data, "throttle"):
        return ThrustSource("throttle", propulsion.by_throttle)
    there = [name for name in ("rpm", "throttle") if _present(data, name)]
    if there:
        needs = (
            "CT with diameter (and max_rpm, if there is no rpm), or max_thrust; or diameter and pitch, where the"
            " battery's voltage and current are logged"
        )
        why = f"the flight has {' and '.join(there)}, the vehicle file no law for it: give [propulsion] {needs}"
        return ThrustSource("", missing=why)
    why = "the flight has neither a thrust signal nor rpm nor a throttle"
    return ThrustSource("", missing=f"{why}; record one, or give [controls.throttle] its servo")


def behind_motor(throttle: Array, interval_s: float, tau: float) -> Array:
    """A throttle, held from each sample on, behind its motor's lag at the samples.

    Parameters
    ----------
    throttle : Array, shape (N,)
        Commands, 0 to 1.
    interval_s : float
        Sample interval, s.
    tau : float
        Time constant of the lag, s; 0 for none.

    Returns
    -------
    Array, shape (N,)
        0 to 1, at rest at the first.
    """
    kept = float(np.exp(-interval_s / tau)) if tau > 0.0 else 0.0
    return first_order_lag(np.append(throttle[:1], throttle[:-1]), kept, float(throttle[0]))


def with_motors(data: FlightData, vehicle: Vehicle) -> FlightData:
    """The flight with what several motors do by their laws: `motor_thrust`, N, the moments of MOTOR_MOMENTS,
    dimensionless, and their throttles behind their lags; itself where the vehicle has one. Raises SignalError where the
    throttle of one is missing.
    """
    if not vehicle.motors:
        return data
    if lost := [name for name in vehicle.motors if not _present(data, name)]:
        raise SignalError(
            f"{data.name}: {', '.join(lost)}: the throttle of a motor is missing or breaks off, and without it what the"
            " motors turn the aircraft by is not known: record its servo, or take by --from and --to what has it"
        )
    rho = np.full(data.time_s.size, vehicle.environment.air_density or SEA_LEVEL_DENSITY)
    if vehicle.environment.air_density is None and "air_density" in data:
        rho = filled(data["air_density"])
    airspeed = filled(data["airspeed"])
    if vehicle.sensors.airspeed.kind != "true":
        airspeed = airspeed * np.sqrt(SEA_LEVEL_DENSITY / rho)
    smooth = np.maximum(fourier_smooth(airspeed, data.interval_s, _AIRSPEED_HZ).values, 0.1)
    throttle = {
        name: behind_motor(filled(data[name]), data.interval_s, motor.tau) for name, motor in vehicle.motors.items()
    }
    loads = motor_loads(vehicle, throttle, smooth, rho)
    columns = {"motor_thrust": loads.thrust, **dict(zip(MOTOR_MOMENTS, loads.moments.T, strict=True))}
    return replace(data, columns={**data.columns, **throttle, **columns})


def filled(values: Array) -> Array:
    """Gaps of an input filled by the last value before them: a held command stays where it was.

    Parameters
    ----------
    values : Array, shape (N,)
        In any unit, NaN in gaps.

    Returns
    -------
    Array, shape (N,)
        In that unit; what comes before the first value is that value, and all is 0 where there is none.
    """
    good = np.isfinite(values)
    if good.all():
        return values
    if not good.any():
        return np.zeros_like(values)
    index = np.where(good, np.arange(values.size), 0)
    np.maximum.accumulate(index, out=index)
    filled: Array = values[index]
    filled[: int(np.argmax(good))] = values[int(np.argmax(good))]
    return filled


def rotor_speed(data: FlightData, first: int, stop: int) -> Denoised | None:
    """Measured speed of the propeller, 1/min, of the samples first ... stop - 1, without the counter's noise; steps of
    the throttle stay sharp. None where the flight has no counter.
    """
    if not _present(data, "rpm"):
        return None
    rpm = filled(data["rpm"])[first:stop]
    throttle = filled(data["throttle"])[first:stop] if "throttle" in data else np.zeros(rpm.size)
    return denoised_thrust(rpm, throttle, data.interval_s)


def thrust_of_speed(speed: Denoised, vehicle: Vehicle) -> Denoised:
    """(N,) N, by max_thrust (rpm / max_rpm)^2: a propeller at one advance ratio."""
    by_square = _square_law(vehicle)
    slope = 2.0 * by_square * np.abs(speed.values)
    # One size for the whole series: where the speed swings by a tenth, so does that of its noise.
    noise = replace(speed.noise, sigma=float(np.sqrt(np.mean(slope**2))) * speed.noise.sigma)
    return Denoised(0.5 * slope * speed.values, np.ascontiguousarray(slope * speed.doubt), noise=noise)


def thrust_in_air(rpm: Array, airspeed: Array, rho: Array, vehicle: Vehicle) -> Array:
    """Thrust of a propeller that turns at a measured speed, in an airspeed and air of a density.

    By CT(J) of [propulsion], else by max_thrust (rpm / max_rpm)^2.

    Parameters
    ----------
    rpm : Array, shape (N,)
        Propeller speed, 1/min.
    airspeed : Array, shape (N,)
        Airspeed, m/s.
    rho : Array, shape (N,)
        Air density, kg/m3.
    vehicle : Vehicle
        Vehicle, whose [propulsion] gives the law.

    Returns
    -------
    Array, shape (N,)
        Thrust, N.

    Raises
    ------
    SignalError
        Where [propulsion] gives neither CT nor max_thrust with max_rpm.
    """
    propulsion = vehicle.propulsion
    if propulsion is None or not propulsion.CT:
        return np.asarray(_square_law(vehicle) * rpm * np.abs(rpm))
    share = rpm * 2.0 * np.pi / 60.0 / rotor_scale(propulsion)
    return np.asarray(along(share, airspeed, rho, flatten(vehicle, Model(vehicle.name, {})).P)[0])


def _square_law(vehicle: Vehicle) -> float:
    """N min^2: thrust over the square of the propeller's speed."""
    propulsion = vehicle.propulsion
    if propulsion is None or propulsion.max_thrust is None or propulsion.max_rpm is None:
        raise SignalError("thrust from rpm needs [propulsion] max_thrust and max_rpm")
    return propulsion.max_thrust / propulsion.max_rpm**2


def lagged_throttle(commands: Array, interval_s: float, tau: float) -> Array:
    """Throttle behind the motor's lag at the samples of held commands, at rest at the first.

    Parameters
    ----------
    commands : Array, shape (M, 4)
        Commands de, da, dr, rad, and throttle, dimensionless, each held from its sample on.
    interval_s : float
        Sample interval, s.
    tau : float
        Time constant of the motor's first-order lag, s; 0 for none.

    Returns
    -------
    Array, shape (M,)
        Throttle behind the lag, dimensionless.
    """
    throttle = commands[:, 3]
    kept = float(np.exp(-interval_s / tau)) if tau > 0.0 else 0.0
    before = np.append(throttle[0], throttle[:-1])
    return first_order_lag(before, kept, float(throttle[0]))


def with_rotor_speed(
    commands: Array, speed: Denoised | None, vehicle: Vehicle, interval_s: float
) -> tuple[Array, Array]:
    """Commands whose throttle gives the measured propeller speed.

    The simulation passes a held throttle through the motor's lag; here that lag is undone, so that the propeller turns
    as measured at every sample. Without a counter the throttle stays as commanded; where CQ is known but nothing gives
    the propeller's speed, it counts as standing, without torque.

    Parameters
    ----------
    commands : Array, shape (M, 4)
        Commands de, da, dr, rad, and throttle, dimensionless.
    speed : Denoised or None
        Speed of the propeller at the M samples, 1/min; None without a counter.
    vehicle : Vehicle
        Vehicle, whose [propulsion] counts.
    interval_s : float
        Sample interval, s.

    Returns
    -------
    commands : Array, shape (M, 4)
        As given but for the throttle.
    errors : Array, shape (K, M)
        Errors of that throttle that the counter's noise leaves, of one standard deviation each, dimensionless.
    """
    propulsion = vehicle.propulsion
    exact = np.zeros((0, commands.shape[0]))
    if propulsion is None or not (propulsion.CT or propulsion.CQ):
        return commands, exact
    commands = commands.copy()
    if speed is None:
        if not propulsion.max_rpm:
            commands[:, 3] = 0.0
        return commands, exact
    share = 2.0 * np.pi / 60.0 / rotor_scale(propulsion)
    commands[:, 3] = _before_lag(share * speed.values, interval_s, propulsion.tau)
    return commands, _before_lag(share * speed.doubt, interval_s, propulsion.tau)


def _before_lag(share: Array, interval_s: float, tau: float) -> Array:
    """The held command (..., M) behind which, after the motor's lag, the propeller turns at `share` (..., M)."""
    after = np.concatenate((share[..., 2:], share[..., -1:]), axis=-1)
    if tau <= 0.0:
        return np.concatenate((share[..., 1:2], after), axis=-1)
    kept = float(np.exp(-interval_s / tau))
    # At rest at the first command, so the lag is undone from the second sample on.
    now = np.concatenate((share[..., :1], share[..., 2:]), axis=-1)
    return np.concatenate((share[..., :1], (after - kept * now) / (1.0 - kept)), axis=-1)

"""Thrust by what the battery gives, where no sensor measures it; and a throttle that a falling voltage weakens.

A propeller of diameter D that turns n times a second gives in an airspeed V, with J = V / (n D) and its disk A,

    T = rho n^2 D^4 a (J0 - J),   P = T (V + v) + c0 rho n^3 D^5,   T = 2 rho A (V + v) v

P is what the shaft gives: what is left in the air behind the propeller (momentum theory: McCormick, Aerodynamics,
Aeronautics, and Flight Mechanics, 2nd ed., 1995, section 6.3) and the drag of its blades. Without thrust it turns a
little faster than its pitch p says, J0 = p / D + 0.15. Of the battery's U I the share `efficiency` gets to the shaft.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightSignals, Signal, finite, repeats

# Signals that say what the battery gives, V and A, and what follows from them: its power, W, thrust, N, and how that
# changes where blades take more than they are taken to, N, one standard deviation.
VOLTAGE, CURRENT = "battery_voltage", "battery_current"
POWER, BY_BATTERY, BY_BLADES = "battery_power", "battery_thrust", "battery_thrust_by_blades"
LAW = "diameter and pitch"
# Share of the battery's power that motor and controller give to the shaft, where it is not given, and its standard
# deviation: motors of small aircraft give 0.7 to 0.88 of what they take, controllers 0.9 to 0.97.
_USUAL, _USUAL_STD = 0.76, 0.08
# Slope of the thrust over the advance ratio, advance ratio without thrust beyond pitch over diameter, and power of the
# blades' drag, as they suit four propellers best: 10 x 4.7 and 11 x 4.7 inch in a wind tunnel from J = 0.1 to 0.45
# (University of Illinois, Propeller Data Site, volume 1), and the published 12 x 6 and 20 x 16 inch ones of an Ultra
# Stick 25e and an Aerosonde.
_SLOPE, _BEYOND_PITCH, _BLADES = 0.157, 0.15, 0.0071
# What the law may be wrong by: a share of the thrust, and one of the blades' power, of which there is the more of the
# whole the nearer the propeller is to no thrust.
_LAW_STD, _BLADES_STD = 0.08, 0.3
# Throttle below which the propeller takes nothing, and what still flows is for the other electronics.
AT_REST = 0.02
# Share of the power's changes that a curve of the throttle must explain, so that power between its readings follows
# the throttle; and the degree of that curve.
_EXPLAINED, _DEGREE = 0.8, 3
# Fewest readings of the battery, and how far the throttle must have moved for a curve of it.
_FEWEST, _THROTTLE_MOVED = 8, 0.05
# What the throttle does not explain turns with airspeed and charge: slower than this.
_SLOW_HZ = 0.5
_HALVINGS = 40


def efficiency(propulsion: Propulsion) -> tuple[float, float]:
    """Share of the battery's power that gets to the shaft, and its standard deviation."""
    value = _USUAL if propulsion.efficiency is None else propulsion.efficiency
    return value, _USUAL_STD if propulsion.efficiency_std is None else propulsion.efficiency_std


def gain_doubt(propulsion: Propulsion) -> float:
    """Share by which all of a thrust by the battery's power may be wrong, one standard deviation, beside the blades."""
    value, std = efficiency(propulsion)
    return math.hypot(std / value, _LAW_STD)


@dataclass(frozen=True)
class PrintedPropeller:
    """A propeller of which no more is known than is printed on it: diameter and pitch, m. blades: power of their drag
    over rho n^3 D^5.
    """

    diameter: float
    pitch: float
    blades: float = _BLADES

    @property
    def _without_thrust(self) -> float:
        return self.pitch / self.diameter + _BEYOND_PITCH

    def _power(self, turning: Array, airspeed: Array, rho: Array) -> tuple[Array, Array]:
        """W and N at speeds n D of the propeller, m/s, from where it gives thrust on."""
        square = self.diameter**2
        thrust = rho * square * _SLOPE * np.maximum(self._without_thrust * turning**2 - airspeed * turning, 0.0)
        induced = -0.5 * airspeed + np.sqrt(0.25 * airspeed**2 + thrust / (0.5 * np.pi * rho * square))
        return thrust * (airspeed + induced) + self.blades * rho * turning**3 * square, thrust

    def thrust(self, power: Array, airspeed: Array, rho: Array) -> Array:
        """Thrust at a power of the shaft.

        Parameters
        ----------
        power : Array, shape (N,)
            W; what does not turn the propeller fast enough for a thrust gives none.
        airspeed, rho : Array, shape (N,)
            True airspeed, m/s, and air density, kg/m^3.

        Returns
        -------
        Array, shape (N,)
            N.
        """
        slow = np.maximum(airspeed, 0.0)
        low = slow / self._without_thrust
        high = np.maximum(low, np.cbrt(np.maximum(power, 0.0) / (self.blades * rho * self.diameter**2)))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            more = self._power(middle, slow, rho)[0] < power
            low, high = np.where(more, middle, low), np.where(more, high, middle)
        return self._power(low, slow, rho)[1]

    def power(self, thrust: Array, airspeed: Array, rho: Array) -> Array:
        """Power of the shaft for a thrust, the inverse of `thrust`.

        Parameters
        ----------
        thrust : Array, shape (N,)
            N; below 0 it counts as 0.
        airspeed, rho : Array, shape (N,)
            m/s, kg/m^3.

        Returns
        -------
        Array, shape (N,)
            W.
        """
        ratio = self._without_thrust
        load = np.maximum(thrust, 0.0) / (rho * self.diameter**2 * _SLOPE)
        turning = (airspeed + np.sqrt(airspeed**2 + 4.0 * ratio * load)) / (2.0 * ratio)
        return self._power(turning, airspeed, rho)[0]


def printed_propeller(vehicle: Vehicle) -> PrintedPropeller | None:
    """The propeller by its print, where the vehicle file gives that and has one motor."""
    motor = vehicle.propulsion
    if motor is None or motor.diameter is None or motor.pitch is None or vehicle.motors:
        return None
    return PrintedPropeller(motor.diameter, motor.pitch)


def _by_battery(vehicle: Vehicle) -> PrintedPropeller | None:
    """The propeller whose thrust is to be taken from the battery's power, where a flight has it: the vehicle file gives
    `efficiency`, or no law of rpm or throttle.
    """
    motor = vehicle.propulsion
    wanted = motor is not None and (motor.efficiency is not None or not (motor.by_throttle or motor.by_rpm))
    return printed_propeller(vehicle) if wanted else None


def with_electric_thrust(signals: FlightSignals, vehicle: Vehicle) -> FlightSignals:
    """The flight with the battery's power, and its thrust by that, or with a throttle of the voltage that laws of it
    hold for.

    Parameters
    ----------
    signals : FlightSignals
        A flight.
    vehicle : Vehicle
        Its [propulsion] says which of the two is wanted.

    Returns
    -------
    FlightSignals
        Itself where the battery was not recorded; only its power is added where thrust was measured, or where the
        vehicle file asks for neither.
    """
    if VOLTAGE not in signals.signals:
        return signals
    motor = vehicle.propulsion
    signals = _with_power(signals)
    there = signals.signals
    measured = "thrust" in there and not repeats(there["thrust"].values)
    if motor is None or measured:
        return signals
    propeller = _by_battery(vehicle)
    if propeller is not None and {POWER, "airspeed"} <= there.keys():
        return _with_thrust(signals, vehicle, motor, propeller)
    return _with_weaker_throttle(signals, motor)


def _with_power(signals: FlightSignals) -> FlightSignals:
    """The flight with the battery's power, on the stamps of its current."""
    (time_s, current), (stamps, voltage) = finite(signals, CURRENT), finite(signals, VOLTAGE)
    if time_s.size < _FEWEST or stamps.size < _FEWEST or repeats(current):
        return signals
    source = f"{signals.signals[VOLTAGE].source}, {signals.signals[CURRENT].source}"
    power = Signal(time_s, current * np.interp(time_s, stamps, voltage), "W", source)
    return replace(signals, signals={**signals.signals, POWER: power})


def _held(signals: FlightSignals, name: str, time_s: Array) -> Array:
    """A command at other stamps: each stays until the next; NaN where there is none."""
    stamps, values = finite(signals, name)
    if not stamps.size:
        return np.full(time_s.size, np.nan)
    return np.asarray(values[np.clip(np.searchsorted(stamps, time_s, side="right") - 1, 0, stamps.size - 1)])


def _with_thrust(
    signals: FlightSignals, vehicle: Vehicle, motor: Propulsion, propeller: PrintedPropeller
) -> FlightSignals:
    time_s, power = finite(signals, POWER)
    resting = power[_held(signals, "throttle", time_s) < AT_REST]
    power = power - (float(np.median(resting)) if resting.size >= _FEWEST else 0.0)
    step = float(np.median(np.diff(time_s)))
    stamps, airspeed = finite(signals, "airspeed", float(time_s[0]) - step, float(time_s[-1]) + step)
    if stamps.size < _FEWEST:
        return signals
    rho = np.full(stamps.size, vehicle.environment.air_density or SEA_LEVEL_DENSITY)
    known, density = finite(signals, "air_density")
    if vehicle.environment.air_density is None and known.size:
        rho = np.interp(stamps, known, density)
    if vehicle.sensors.airspeed.kind != "true":
        airspeed = airspeed * np.sqrt(SEA_LEVEL_DENSITY / rho)
    share = efficiency(motor)[0]
    shaped = _between_readings(signals, stamps, time_s, power, motor)
    thrust = propeller.thrust(share * shaped, airspeed, rho)
    rougher = replace(propeller, blades=(1.0 + _BLADES_STD) * propeller.blades)
    by_blades = rougher.thrust(share * shaped, airspeed, rho) - thrust
    source = signals.signals[POWER].source
    made = {BY_BATTERY: Signal(stamps, thrust, "N", source), BY_BLADES: Signal(stamps, by_blades, "N", source)}
    return replace(signals, signals={**signals.signals, **made})


def _between_readings(signals: FlightSignals, stamps: Array, time_s: Array, power: Array, motor: Propulsion) -> Array:
    """Power, W, at stamps: a battery is read a few times a second, with noise that no thrust has. What it gives turns
    with the throttle, and else slowly.
    """
    # What the motor does follows its throttle by its lag.
    read, asked = (_held(signals, "throttle", one - motor.tau) for one in (time_s, stamps))
    good = np.isfinite(read)
    if np.count_nonzero(good) >= _FEWEST and float(np.ptp(read[good])) > _THROTTLE_MOVED:
        levels = np.unique(np.round(read[good], 2)).size
        curve = np.polynomial.Polynomial.fit(read[good], power[good], min(_DEGREE, levels - 1))
        rest = power[good] - curve(read[good])
        if float(np.var(rest)) < (1.0 - _EXPLAINED) * float(np.var(power[good])):
            shape = curve(np.clip(asked, float(np.min(read[good])), float(np.max(read[good]))))
            return np.asarray(shape + _slow(time_s[good], rest, stamps, _SLOW_HZ))
        return np.asarray(np.interp(stamps, time_s, power))
    return _slow(time_s, power, stamps, _SLOW_HZ)


def _slow(time_s: Array, values: Array, stamps: Array, cutoff_hz: float) -> Array:
    """The slow part of readings, at stamps."""
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1], step)
    if even.size < _FEWEST or cutoff_hz > 0.4 / step:
        return np.asarray(np.interp(stamps, time_s, values))
    smooth = fourier_smooth(np.ascontiguousarray(np.interp(even, time_s, values)), step, cutoff_hz).values
    return np.asarray(np.interp(stamps, even, smooth))


def _with_weaker_throttle(signals: FlightSignals, motor: Propulsion) -> FlightSignals:
    """Thrust goes with the square of the voltage, the propeller's speed with the voltage itself."""
    throttle = signals.signals.get("throttle")
    if motor.voltage is None or throttle is None or not motor.by_throttle:
        return signals
    stamps, voltage = finite(signals, VOLTAGE)
    if stamps.size < _FEWEST:
        return signals
    weaker = np.interp(throttle.time_s, stamps, voltage) / motor.voltage
    values = throttle.values * (weaker if motor.by_throttle == "CT(J)" else weaker**2)
    return replace(signals, signals={**signals.signals, "throttle": replace(throttle, values=values)})

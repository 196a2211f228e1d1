"""Imperfect sensors: bias, scale factor, noise, lag, resolution and sample rate over what ideal ones read.

Figures: Jolly, Unhelkar and Arya, "A Comprehensive Sensor Suite for Mini Aerial Vehicle Flight Tests", Table
II, for air data, inertial sensors and attitude; section II for GPS. Thrust, barometer, rpm and resolutions
are usual for the parts named there. A reading is `(1 + scale) true + bias + noise`; the true errors never
leave the process but by `true_errors`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.failures import Failures
from sim_vehicle.physics import atmosphere
from sim_vehicle.vehicle.adc_curves import AnalogueBoard, load_analogue
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS, by_place
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

_DEG = np.pi / 180.0
_G = 9.81  # m/s^2; Table III prints 0.02 g as 0.1962
HOME = (19.1334, 72.9133)  # deg, latitude and longitude of the field, north = east = 0
_EARTH_RADIUS = 6378137.0  # m, WGS-84 equator: metres to degrees at the field, not navigation
GPS_POSITION_NOISE = 1.5  # m, horizontal, wandering with the time constant below
GPS_CORRELATION_S = 30.0


def degrees_from_home(north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude, deg, of a place so far from the field, m."""
    along = float(np.degrees(north / _EARTH_RADIUS))
    return HOME[0] + along, HOME[1] + float(np.degrees(east / (_EARTH_RADIUS * np.cos(np.radians(HOME[0])))))


@dataclass(frozen=True)
class ChannelError:
    """Errors of one channel, SI: reading = (1 + scale) true + bias + noise, in steps of `quantum`, after `lag` s."""

    bias: float = 0.0
    noise: float = 0.0
    scale: float = 0.0
    quantum: float = 0.0
    lag: float = 0.0


_ACCEL = ChannelError(bias=0.02 * _G, noise=0.008 * _G, quantum=16.0 * _G / 2**16)
_GYRO = ChannelError(bias=0.25 * _DEG, noise=0.03 * _DEG, quantum=1000.0 * _DEG / 2**16)
_VANE = ChannelError(noise=0.3 * _DEG, scale=0.005)
_ATTITUDE = ChannelError(noise=0.05 * _DEG)
_GPS_VELOCITY = ChannelError(noise=0.1)

TABLE_II: dict[str, ChannelError] = {
    "airspeed": ChannelError(noise=0.02),
    "alpha": _VANE,
    "beta": _VANE,
    "p": _GYRO,
    "q": _GYRO,
    "r": _GYRO,
    "phi": _ATTITUDE,
    "theta": _ATTITUDE,
    "psi": _ATTITUDE,
    "ax": _ACCEL,
    "ay": _ACCEL,
    "az": _ACCEL,
    "thrust": ChannelError(noise=0.02),
    "altitude": ChannelError(noise=0.3),
    "vn": _GPS_VELOCITY,
    "ve": _GPS_VELOCITY,
    "vd": _GPS_VELOCITY,
    "rpm": ChannelError(noise=10.0, quantum=1.0),
    "temperature": ChannelError(noise=0.05),
}
NOISE_NAMES = ("table2", "none")

RATES_HZ: dict[str, float] = {
    "imu": 50.0,
    "attitude": 50.0,
    "vanes": 50.0,
    "air": 50.0,
    "baro": 50.0,
    "engine": 50.0,
    "adc": 50.0,
    "gps": 5.0,
}
GROUPS: dict[str, tuple[str, ...]] = {
    "imu": ("ax", "ay", "az", "p", "q", "r"),
    "attitude": ("phi", "theta", "psi"),
    "vanes": ("alpha", "beta"),
    "air": ("airspeed", "differential_pressure"),
    "baro": ("altitude", "static_pressure", "temperature"),
    "engine": ("thrust", "rpm"),
    "gps": ("lat", "lon", "gps_altitude", "gps_north", "gps_east", "vn", "ve", "vd"),
}

_TRUE_ERROR_NAMES: dict[str, tuple[str, str]] = {
    "accel_bias_x": ("ax", "bias"),
    "accel_bias_y": ("ay", "bias"),
    "accel_bias_z": ("az", "bias"),
    "gyro_bias_p": ("p", "bias"),
    "gyro_bias_q": ("q", "bias"),
    "gyro_bias_r": ("r", "bias"),
    "alpha_scale": ("alpha", "scale"),
    "alpha_bias": ("alpha", "bias"),
    "beta_scale": ("beta", "scale"),
    "beta_bias": ("beta", "bias"),
    "airspeed_scale": ("airspeed", "scale"),
    "airspeed_bias": ("airspeed", "bias"),
    "phi_bias": ("phi", "bias"),
    "theta_scale": ("theta", "scale"),
    "theta_bias": ("theta", "bias"),
}


@dataclass(frozen=True)
class Reading:
    """What the sensors read in one tick.

    values: every signal's newest value, SI and rad (lat, lon in deg). due: groups that were sampled in this tick.
    """

    values: Mapping[str, float]
    due: frozenset[str]


def error_table(noise: str, changes: Mapping[str, float]) -> dict[str, ChannelError]:
    """Errors of every channel: those of `noise` ("table2" or "none") with `changes` of single ones.

    A change is named as in results (`accel_bias_x`, `alpha_scale`) or `CHANNEL.FIELD` (`airspeed.noise`, `alpha.lag`).
    """
    if noise not in NOISE_NAMES:
        raise SimVehicleError(f"no noise {noise!r}; there are {', '.join(NOISE_NAMES)}")
    table = dict(TABLE_II) if noise == "table2" else dict.fromkeys(TABLE_II, ChannelError())
    for name, value in changes.items():
        channel, _, part = name.partition(".")
        channel, part = _TRUE_ERROR_NAMES.get(name, (channel, part))
        if channel not in table or part not in ChannelError.__dataclass_fields__:
            known = ", ".join(_TRUE_ERROR_NAMES)
            raise SimVehicleError(f"no sensor error {name!r}; there are {known}, and CHANNEL.noise, .quantum, .lag")
        table[channel] = ChannelError(**{**table[channel].__dict__, part: float(value)})
    return table


class SensorSuite:
    """All sensors of a vehicle, sampled once in a control tick.

    vehicle: decides what the airspeed sensor reads, and its analogue board. noise: "table2" or "none" (exact values).
    generator: source of all noise, or its seed. changes: as for `error_table`.
    rates_hz: sample rates of groups, instead of RATES_HZ. failures: what breaks.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        noise: str = "table2",
        generator: np.random.Generator | int,
        dt: float = 0.02,
        changes: Mapping[str, float] | None = None,
        rates_hz: Mapping[str, float] | None = None,
        failures: Failures | None = None,
    ) -> None:
        self._errors = error_table(noise, changes or {})
        self._exact = noise == "none"
        self._generator = np.random.default_rng(generator)
        self._dt = dt
        self._failures = failures or Failures()
        # Second sensors have noise of their own, so that the others read the same with and without them.
        self._second = {name: vehicle.sensors.second[one.key].position for name, one in SECOND_SENSORS.items()
                        if one.key in vehicle.sensors.second}  # fmt: skip
        self._beside = self._generator.spawn(1)[0]
        self._first = {one.of: vehicle.sensors[one.first].position for one in SECOND_SENSORS.values()}
        self._beta_kinds = (vehicle.sensors.beta_vane.kind, vehicle.sensors["beta2_vane"].kind)
        self._airspeed_is_true = vehicle.sensors.airspeed.kind == "true"
        self.board: AnalogueBoard | None = load_analogue(vehicle.path)
        self._rates = {**RATES_HZ, **(rates_hz or {})}
        self._signals = {group: self._carried(group) for group in self._rates}
        self._taken = dict.fromkeys(self._rates, -1)
        self._values: dict[str, float] = {}
        self._channels = tuple(self._errors)
        rows = [self._errors[name] for name in self._channels]
        self._gain = np.array([1.0 + row.scale for row in rows])
        self._bias = np.array([row.bias for row in rows])
        self._sigma = np.array([row.noise for row in rows])
        self._quantum = np.array([row.quantum for row in rows])
        self._coarse = self._quantum > 0.0
        lags = np.array([row.lag for row in rows])
        self._follow = np.where(lags > 0.0, 1.0 - np.exp(-dt / np.maximum(lags, 1e-12)), 1.0)
        self._lagged: Array | None = None
        wander = 0.0 if self._exact else GPS_POSITION_NOISE
        self._gps_error = wander * self._generator.standard_normal(3)

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups of signals that are sampled together."""
        return tuple(self._rates)

    def true_errors(self) -> dict[str, float]:
        """The errors hidden in the readings, by the names of an identification's result (SI, rad)."""
        return {name: float(getattr(self._errors[ch], part)) for name, (ch, part) in _TRUE_ERROR_NAMES.items()}

    def sample(self, time_s: float, ideal: Mapping[str, float]) -> Reading:
        """Sample at `time_s`.

        ideal: what perfect sensors read, SI: every channel of TABLE_II but temperature, and north, east, rho.
        """
        ideal = {**ideal, "temperature": atmosphere.air_at(ideal["altitude"])[0]}
        true = np.array([ideal[name] for name in self._channels])
        if self._lagged is None:
            self._lagged = true.copy()
        self._lagged += self._follow * (true - self._lagged)
        noise = self._sigma * self._generator.standard_normal(true.size)
        read = self._gain * self._lagged + self._bias + noise
        coarse = self._coarse
        read[coarse] = (read[coarse] / self._quantum[coarse]).round() * self._quantum[coarse]
        fresh = {**dict(zip(self._channels, read.tolist(), strict=True)), "north": ideal["north"]}
        self._failures.read(time_s, fresh)
        self._derive(fresh, ideal)
        fresh |= self._second_readings(ideal)
        due = frozenset(group for group in self._rates if self._is_due(group, time_s)) - self._failures.lost(time_s)
        for group in due:
            self._values.update({name: fresh[name] for name in self._signals[group]})
        return Reading(dict(self._values), due)

    def _is_due(self, group: str, time_s: float) -> bool:
        number = math.floor(time_s * self._rates[group] + 1e-6)
        if number == self._taken[group]:
            return False
        self._taken[group] = number
        return True

    def signals_of(self, group: str) -> tuple[str, ...]:
        """Names of the signals that a group carries, second sensors with the first ones."""
        return self._signals[group]

    def _carried(self, group: str) -> tuple[str, ...]:
        if group == "adc":
            return tuple(f"adc{channel.adc}" for channel in self.board.channels) if self.board else ()
        return (*GROUPS[group], *(name for name in self._second if SECOND_SENSORS[name].of in GROUPS[group]))

    def _second_readings(self, ideal: Mapping[str, float]) -> dict[str, float]:
        """What second sensors read at their own places, with the noise of the first ones and none of their errors."""
        found = {}
        rates, speed = (ideal["p"], ideal["q"], ideal["r"]), max(ideal["airspeed"], 1.0)
        for name, place in self._second.items():
            of = SECOND_SENSORS[name].of
            true = ideal[of]
            if of == "beta" and self._beta_kinds[0] != self._beta_kinds[1]:
                # tan(flank) = tan(sideslip) / cos(alpha), one way or the other.
                cosine = np.cos(ideal["alpha"])
                true = float(np.arctan(np.tan(true) * (cosine if self._beta_kinds[0] == "flank" else 1.0 / cosine)))
            own, first = (by_place(of, where, rates, speed) for where in (place, self._first[of]))
            noise = self._errors[of].noise * self._beside.standard_normal()
            found[name] = float(true + own - first + noise)
        return found

    def _derive(self, fresh: dict[str, float], ideal: Mapping[str, float]) -> None:
        """Signals that share a sensor with another one share its error."""
        for angle in ("phi", "psi"):
            fresh[angle] = math.atan2(math.sin(fresh[angle]), math.cos(fresh[angle]))
        fresh["static_pressure"] = atmosphere.air_at(fresh["altitude"])[1]
        airspeed = fresh["airspeed"]
        ratio = ideal["rho"] / SEA_LEVEL_DENSITY if self._airspeed_is_true else 1.0
        calibrated = airspeed * math.sqrt(ratio)
        fresh["differential_pressure"] = float(atmosphere.dynamic_pressure(calibrated))
        self._place(fresh, ideal)
        if self.board:
            fresh |= self.board.read({**fresh, "airspeed": calibrated}, exact=self._exact)

    def _place(self, fresh: dict[str, float], ideal: Mapping[str, float]) -> None:
        decay = math.exp(-self._dt / GPS_CORRELATION_S)
        drive = 0.0 if self._exact else GPS_POSITION_NOISE * math.sqrt(1.0 - decay**2)
        self._gps_error = decay * self._gps_error + drive * self._generator.standard_normal(3)
        north, east = fresh["north"] + self._gps_error[0], ideal["east"] + self._gps_error[1]
        fresh["lat"], fresh["lon"] = degrees_from_home(float(north), float(east))
        fresh["gps_north"], fresh["gps_east"] = float(north), float(east)
        fresh["gps_altitude"] = float(ideal["altitude"] + 2.0 * self._gps_error[2])

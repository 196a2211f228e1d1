"""What PX4's simulator interface says in MAVLink: sensors out, actuators in.

Source: PX4's user guide, "Simulation", section "Simulator MAVLink API", and the messages HIL_SENSOR, HIL_GPS,
HIL_STATE_QUATERNION and HIL_ACTUATOR_CONTROLS of MAVLink's common dialect.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.flight.sensor_suite import TABLE_II, degrees_from_home
from sim_vehicle.physics import atmosphere
from sim_vehicle.physics.rotation import rotation_matrix
from sim_vehicle.sitl.physics import Motion

Array = NDArray[np.float64]

# Bits of HIL_SENSOR.fields_updated: accelerometer, gyro, magnetometer, absolute and differential pressure, pressure
# altitude, temperature.
ALL_FIELDS = 0b1_1111_1111_1111
# HIL_ACTUATOR_CONTROLS: armed in its mode, built with lockstep in its flags.
_ARMED, _LOCKSTEP = 128, 1
# The earth's field at the simulator's field, gauss, north east down (World Magnetic Model 2020: 0.44 G, dip 27 deg).
_FIELD = (0.389, 0.0, 0.200)
_FIELD_NOISE = 0.003
_PRESSURE_NOISE_HPA = 0.03
_HPA = 100.0  # Pa
_MOST_INT16 = 32767.0
# Pulse widths, us, that an actuator of -1, 0 and 1 stands for; of a motor 0 and 1.
_MIDDLE, _HALF, _CLOSED, _FULL = 1500.0, 500.0, 1000.0, 1000.0


@dataclass(frozen=True)
class Actuators:
    """One HIL_ACTUATOR_CONTROLS. time_us: of the sensors that it answers."""

    time_us: int
    controls: tuple[float, ...]
    armed: bool
    lockstep: bool

    @classmethod
    def of(cls, message: Any) -> Actuators:
        """From pymavlink's message; what is no number is 0."""
        controls = tuple(float(one) if math.isfinite(one) else 0.0 for one in message.controls)
        return cls(int(message.time_usec), controls, bool(message.mode & _ARMED), bool(message.flags & _LOCKSTEP))

    def pulses(self, motors: Sequence[int]) -> tuple[int, ...]:
        """Pulse widths, us, by output: neutral, and motors off, where the vehicle is not armed. motors: outputs."""
        if not self.armed:
            return tuple(round(_CLOSED if place in motors else _MIDDLE) for place in range(1, len(self.controls) + 1))
        return tuple(
            round(_CLOSED + _FULL * min(max(one, 0.0), 1.0))
            if place in motors
            else round(_MIDDLE + _HALF * min(max(one, -1.0), 1.0))
            for place, one in enumerate(self.controls, 1)
        )


class Sensors:
    """Makes the messages of one flight, whose runway is at sea level. build: pymavlink's encoder."""

    def __init__(self, build: Any, generator: np.random.Generator) -> None:
        self._build, self._generator = build, generator

    def readings(self, time_us: int, motion: Motion, wind: Array) -> Any:
        """HIL_SENSOR with the noise of Table II: readings that repeat count as those of a dead sensor there."""
        noise = self._generator.standard_normal(12)
        to_body = np.array(rotation_matrix(*motion.attitude)).reshape(3, 3)
        force = motion.specific_force + TABLE_II["ax"].noise * noise[:3]
        rates = motion.rates + TABLE_II["p"].noise * noise[3:6]
        field = to_body @ np.array(_FIELD) + _FIELD_NOISE * noise[6:9]
        height = -float(motion.position[2])
        pressure = float(atmosphere.pressure(height)) / _HPA + _PRESSURE_NOISE_HPA * noise[9]
        air = to_body @ (motion.velocity - wind)
        ahead = float(air[0]) + TABLE_II["airspeed"].noise * noise[10]
        # A pitot tube along the body's x reads what comes from ahead.
        density = float(atmosphere.density(height))
        pitot = 0.5 * density * ahead * abs(ahead) / _HPA
        temperature = float(atmosphere.temperature(height)) - 273.15 + TABLE_II["temperature"].noise * noise[11]
        return self._build.hil_sensor_encode(
            time_us, *force, *rates, *field, pressure, pitot, float(atmosphere.pressure_altitude(pressure * _HPA)),
            temperature, ALL_FIELDS,
        )  # fmt: skip

    def position(self, time_us: int, motion: Motion) -> Any:
        """HIL_GPS."""
        latitude, longitude = degrees_from_home(float(motion.position[0]), float(motion.position[1]))
        noise = TABLE_II["vn"].noise * self._generator.standard_normal(3)
        vn, ve, vd = np.clip((motion.velocity + noise) * 100.0, -_MOST_INT16, _MOST_INT16)
        course = math.degrees(math.atan2(ve, vn)) % 360.0
        return self._build.hil_gps_encode(
            time_us, 3, round(latitude * 1e7), round(longitude * 1e7),
            round(-float(motion.position[2]) * 1e3), 100, 100, round(math.hypot(vn, ve)),
            round(vn), round(ve), round(vd), round(course * 100.0) % 36000, 12,
        )  # fmt: skip

    def truth(self, time_us: int, motion: Motion, wind: Array) -> Any:
        """HIL_STATE_QUATERNION, which PX4 logs as ground truth."""
        latitude, longitude = degrees_from_home(float(motion.position[0]), float(motion.position[1]))
        airspeed = float(np.linalg.norm(motion.velocity - wind))
        height = -float(motion.position[2])
        calibrated = airspeed * math.sqrt(float(atmosphere.density(height)) / SEA_LEVEL_DENSITY)
        force_mg = motion.specific_force * (1000.0 / STANDARD_GRAVITY)
        return self._build.hil_state_quaternion_encode(
            time_us, [float(one) for one in motion.attitude], *(float(one) for one in motion.rates),
            round(latitude * 1e7), round(longitude * 1e7), round(height * 1e3),
            *(round(float(one)) for one in np.clip(motion.velocity * 100.0, -_MOST_INT16, _MOST_INT16)),
            min(round(calibrated * 100.0), 65535), min(round(airspeed * 100.0), 65535),
            *(round(float(one)) for one in np.clip(force_mg, -_MOST_INT16, _MOST_INT16)),
        )  # fmt: skip

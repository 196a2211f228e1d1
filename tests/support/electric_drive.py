"""A battery, a controller, a motor and a propeller of a wind tunnel's tables: what a board's battery monitor reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.signals.flight import FlightSignals, Signal

Array = NDArray[np.float64]

#: (J, CT, CP) of an APC Slow Flyer 10 x 4.7 inch at 6512 1/min and of an 11 x 4.7 inch at 6006 1/min, thinned out;
#: University of Illinois, Propeller Data Site, volume 1 (Brandt & Selig, AIAA 2011-1255). The first row is at rest.
TABLES = {
    "10x4.7": (0.254, ((0.0, 0.1299, 0.0531), (0.112, 0.1171, 0.0522), (0.199, 0.1019, 0.0493), (0.287, 0.0865, 0.0460),
                       (0.357, 0.0743, 0.0434), (0.445, 0.0562, 0.0381))),
    "11x4.7": (0.2794, ((0.0, 0.1259, 0.0493), (0.107, 0.1120, 0.0477), (0.197, 0.0960, 0.0448),
                        (0.287, 0.0803, 0.0417), (0.373, 0.0637, 0.0376), (0.436, 0.0496, 0.0336))),
}  # fmt: skip


@dataclass(frozen=True)
class Drive:
    """propeller: of TABLES, `larger` times as large. kv: rad/s/V. resistance, no_load: of the motor, Ohm, A.
    controller: its efficiency. charged, inner: open-circuit V and Ohm of the battery. falls: V/s. electronics: W beside
    the motor.
    """

    propeller: str = "10x4.7"
    kv: float = 100.0
    resistance: float = 0.06
    no_load: float = 0.6
    controller: float = 0.94
    charged: float = 12.3
    inner: float = 0.04
    falls: float = 0.002
    electronics: float = 3.0
    larger: float = 1.0

    @property
    def diameter(self) -> float:
        """m."""
        return self.larger * TABLES[self.propeller][0]

    @property
    def pitch(self) -> float:
        """As it is printed on the propeller, m."""
        return self.larger * 4.7 * 0.0254

    def power(self, thrust: Array, airspeed: Array, rho: Array) -> Array:
        """W that the controller takes for a thrust, N, at an airspeed, m/s; straight beyond the tables' ends."""
        diameter = self.diameter
        J, CT, CP = np.array(TABLES[self.propeller][1]).T
        # T / (rho V^2 D^2) = CT / J^2 falls with J: the advance ratio by the thrust.
        fine = np.linspace(0.02, 0.69, 3000)
        ends = [np.interp(fine, J, one) + np.maximum(fine - J[-1], 0.0) * (one[-1] - one[-2]) / (J[-1] - J[-2])
                for one in (CT, CP)]  # fmt: skip
        ends[0] = np.maximum(ends[0], 1e-5)
        load = thrust / (rho * airspeed**2 * diameter**2)
        ratio = np.interp(-np.log(np.maximum(load, 1e-6)), -np.log(ends[0] / fine**2), fine)
        turning = airspeed / (ratio * diameter)
        shaft = np.interp(ratio, fine, ends[1]) * rho * turning**3 * diameter**5
        omega = 2.0 * np.pi * turning
        current = shaft / omega * self.kv + self.no_load
        return np.asarray((omega / self.kv + current * self.resistance) * current / self.controller)

    def share(self, thrust: Array, airspeed: Array, rho: Array) -> Array:
        """Of the controller's power, what is left in the air behind the propeller: T (V + v)."""
        disk = 0.25 * np.pi * self.diameter**2
        v = -0.5 * airspeed + np.sqrt(0.25 * airspeed**2 + thrust / (2.0 * rho * disk))
        return np.asarray(thrust * (airspeed + v) / self.power(thrust, airspeed, rho))


def with_battery(
    signals: FlightSignals, drive: Drive, flown: Mapping[str, Array], rate_hz: float, seed: int
) -> FlightSignals:
    """The flight without a thrust sensor, its battery read at `rate_hz`. flown: time_s, thrust, airspeed (true) and
    rho as they were, (N,) each.
    """
    random = np.random.default_rng(seed)
    time_s = flown["time_s"]
    power = drive.power(flown["thrust"], flown["airspeed"], flown["rho"])
    power = np.where(flown["thrust"] > 0.02, power, 0.0) + drive.electronics
    open_v = drive.charged - drive.falls * (time_s - time_s[0])
    current = (open_v - np.sqrt(open_v**2 - 4.0 * drive.inner * power)) / (2.0 * drive.inner)
    voltage = open_v - drive.inner * current
    stamps = np.arange(time_s[0], time_s[-1], 1.0 / rate_hz)
    read = {
        "battery_voltage": np.interp(stamps, time_s, voltage) + random.normal(0.0, 0.02, stamps.size),
        "battery_current": np.interp(stamps, time_s, current) + random.normal(0.0, 0.1, stamps.size),
    }
    kept = {name: one for name, one in signals.signals.items() if name != "thrust"}
    unit = {"battery_voltage": "V", "battery_current": "A"}
    kept |= {name: Signal(stamps, values, unit[name], "SYS_STATUS") for name, values in read.items()}
    return replace(signals, signals=kept)

"""The vehicle's own clock: seconds since its boot, which may run fast and start anew."""

from __future__ import annotations

from dataclasses import dataclass

BOOT_S = 12.0  # s the autopilot has been running when the flight's first sample is taken
RESTART_S = 1.0  # s between a restart and the first message after it


@dataclass(frozen=True)
class VehicleClock:
    """Stamps of a flight.

    boot_s: s since boot at flight time 0. drift: how much too fast the clock runs, s/s (50e-6 is 50 ppm).
    resets: flight times, s, rising, at which the vehicle restarts; its clock then counts from RESTART_S.
    """

    boot_s: float = BOOT_S
    drift: float = 0.0
    resets: tuple[float, ...] = ()

    def restarts(self, time_s: float) -> int:
        """How often the vehicle has restarted by flight time `time_s`."""
        return sum(time_s + 1e-9 >= reset for reset in self.resets)

    def since_boot(self, time_s: float) -> float:
        """What the clock shows at flight time `time_s`, s."""
        count = self.restarts(time_s)
        if count:
            return RESTART_S + (time_s - self.resets[count - 1]) * (1.0 + self.drift)
        return self.boot_s + time_s * (1.0 + self.drift)

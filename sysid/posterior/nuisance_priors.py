"""What is estimated beside coefficients, and what is known of it before the flight: the one table of priors.

A nuisance is what stands between the aircraft and the numbers in the log: servos that are delayed, vanes that swing, an
airspeed that reads too little. Each has a prior, for from the flight alone it is often not identifiable, and a null,
the value at which it does nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Array

DEGREE = math.pi / 180.0
GROUPS = ("longitudinal", "lateral")
# Surfaces that move a group of axes, and the flow angle that its vane reads.
SURFACES_OF = {"longitudinal": ("de",), "lateral": ("da", "dr")}
# Of the aircraft itself, where its vehicle file does not give them.
PRODUCT_INERTIA, THRUST_ARM, MOVING_MASS = "product_inertia", "thrust_arm", "moving_mass"
AIRSPEED_SCALE = "airspeed_error"
FLOW_OF = {"longitudinal": "alpha", "lateral": "beta"}


@dataclass(frozen=True)
class Nuisance:
    """One unknown beside the coefficients.

    mean, std: Gaussian prior. null: the value that does nothing. low, high: bounds. step: for difference quotients.
    group: "longitudinal", "lateral" or "both". source: where the prior is from. flight: the one that it belongs to, ""
    for all.
    """

    name: str
    mean: float
    std: float
    null: float
    low: float
    high: float
    step: float
    unit: str
    group: str
    source: str
    flight: str = ""

    @property
    def key(self) -> str:
        """Its name among all unknowns."""
        return f"{self.name} of {self.flight}" if self.flight else self.name

    def acts_on(self, flight: str) -> bool:
        """Whether it stands in a flight."""
        return self.flight in ("", flight)

    def serves(self, group: str) -> bool:
        """Whether the unknown belongs to a group of axes."""
        return self.group in (group, "both")


# Sizes of what hobby-grade parts do; each is one standard deviation of the population of aircraft.
PRIORS: tuple[Nuisance, ...] = (
    Nuisance("servo_delay", 0.045, 0.030, 0.0, -0.03, 0.25, 1e-3, "s", "both",
             "frame of 20 ms, its place in the log, the servo's own controller"),
    Nuisance("servo_lag", 0.035, 0.020, 0.0, 0.0, 0.20, 1e-3, "s", "both",
             "0.06 to 0.15 s per 60 deg of hobby servos, small strokes"),
    Nuisance("servo_backlash", 0.15 * DEGREE, 0.12 * DEGREE, 0.0, 0.0, 0.6 * DEGREE, 5e-4 * DEGREE, "rad", "both",
             "half the play of clevis, horn and gear train of small linkages"),
    Nuisance("command_rounding", 0.5, 0.5, 0.0, 0.0, 1.0, 0.1, "1", "both",
             "a log in whole steps says what its servo was sent, or rounds what it was sent"),
    Nuisance(AIRSPEED_SCALE, 0.0, 0.015, 0.0, -0.2, 0.2, 1e-3, "1", "both",
             "bench calibration of a differential pressure sensor, 3 % of dynamic pressure"),
    Nuisance("airspeed_alpha", 0.0, 0.08, 0.0, -1.0, 1.0, 5e-3, "1/rad", "longitudinal",
             "position error of a pitot in the upwash of a wing"),
    Nuisance("alpha_scale", 1.0, 0.08, 1.0, 0.5, 1.6, 1e-3, "1", "longitudinal", "upwash before a wing"),
    Nuisance("beta_scale", 1.0, 0.056, 1.0, 0.5, 1.6, 1e-3, "1", "lateral", "sidewash beside a fuselage"),
    Nuisance("vane_clock", 0.0, 0.020, 0.0, -0.1, 0.1, 1e-3, "s", "both", "stamps given when a message is sent"),
    Nuisance("vane_period", 0.125, 0.0625, 0.0, 0.0, 0.5, 2e-3, "s", "both",
             "small balanced vanes at 15 m/s swing at 5 to 12 Hz; a probe does not"),
    Nuisance("vane_log_damping", math.log(0.3), math.log(1.8), math.log(0.3), math.log(0.08), math.log(2.0), 0.03, "1",
             "both", "vane in an airstream, Wieringa 1967"),
    Nuisance("accelerometer_tilt", 0.0, 0.010, 0.0, -0.1, 0.1, 1e-3, "rad", "longitudinal",
             "mounting of the IMU; cross-axis sensitivity of MEMS accelerometers, 1 %"),
    Nuisance("gyro_tilt", 0.0, 0.010, 0.0, -0.1, 0.1, 1e-3, "rad", "lateral",
             "mounting of the IMU; cross-axis sensitivity of MEMS gyros, 1 to 2 %"),
    Nuisance("thrust_error", 0.0, 0.03, 0.0, -0.5, 0.5, 1e-3, "1", "longitudinal", "calibration of a force sensor"),
    Nuisance("theta_offset", 0.0, 1.0 * DEGREE, 0.0, -0.2, 0.2, 1e-4, "rad", "longitudinal", "mounting of the IMU"),
    Nuisance("phi_offset", 0.0, 1.0 * DEGREE, 0.0, -0.2, 0.2, 1e-4, "rad", "lateral", "mounting of the IMU"),
    Nuisance("alpha_offset", 0.0, 1.5 * DEGREE, 0.0, -0.2, 0.2, 1e-4, "rad", "both",
             "zero of the angle of attack as it was measured: lift pulls ahead by it, and a roll makes sideslip"),
)  # fmt: skip

# A log that says where the surfaces were leaves only its own stamp open.
POSITION: dict[str, tuple[float, float]] = {"servo_delay": (0.0, 0.010)}
POSITION_FIXED = ("servo_lag", "servo_backlash", "command_rounding")

# Standard deviation of thrust by the propeller's speed: curves of other samples of a propeller, measured in a wind
# tunnel and not behind a nose (Brandt & Selig, AIAA 2011-1255: a tenth between propellers of one name).
THRUST_BY_SPEED_STD = 0.10

# What holds from one start-up to the next: messages fall into another phase of what they report.
OF_A_FLIGHT = frozenset(("servo_delay", "vane_clock", "airspeed_lag"))

# Largest zero error, 1 sigma, that the mean of an output is trusted to. SI units.
ZERO_STD = {"ax": 0.25, "ay": 0.25, "az": 0.25, "p": 0.005, "q": 0.005, "r": 0.005, "alpha": 0.017, "beta": 0.017}


@dataclass(frozen=True)
class Unknowns:
    """Nuisances of one group that are estimated, with their priors, and values of those that are not."""

    free: tuple[Nuisance, ...]
    fixed: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free ones, in order."""
        return tuple(one.key for one in self.free)

    def __iter__(self) -> Iterator[Nuisance]:
        return iter(self.free)

    def values(self, theta: Array, flight: str) -> dict[str, float]:
        """All values of a flight by name, from those of the free ones."""
        own = {one.name: float(v) for one, v in zip(self.free, theta, strict=True) if one.acts_on(flight)}
        return {**self.fixed, **own}

    def without(self, name: str) -> Unknowns:
        """The same with one of the free ones held at its mean."""
        held = {one.name: one.mean for one in self.free if one.name == name}
        return Unknowns(tuple(one for one in self.free if one.name != name), {**self.fixed, **held})

    @property
    def mean(self) -> Array:
        """(K,) prior means."""
        return np.array([one.mean for one in self.free])

    @property
    def std(self) -> Array:
        """(K,) prior standard deviations."""
        return np.array([one.std for one in self.free])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(K,) lowest and highest values."""
        return np.array([one.low for one in self.free]), np.array([one.high for one in self.free])


def unknowns_of(
    group: str,
    vane: bool,
    position: bool,
    stated: Mapping[str, tuple[float | None, float | None]],
    more: Sequence[Nuisance] = (),
    flights: Sequence[str] = (),
) -> Unknowns:
    """Unknowns of a group of axes.

    vane: whether its vane was read. position: whether the log holds positions of surfaces instead of commands.
    stated: name -> (mean, std) instead of the table's, None leaves it; a std of 0 fixes the value. more: further ones
    of this flight. flights: their names, where there are several.
    """
    free, fixed = [], {}
    for one in (*PRIORS, *more):
        for mean, std in (
            POSITION.get(one.name, (None, None)) if position else (None, None),
            stated.get(one.name, (None, None)),
        ):
            one = replace(one, mean=one.mean if mean is None else mean, std=one.std if std is None else std)
        idle = not one.serves(group) or (position and one.name in POSITION_FIXED)
        if idle or (not vane and (one.name.startswith("vane") or one.name in ("alpha_scale", "beta_scale"))):
            fixed[one.name] = one.null
        elif one.std == 0.0:
            fixed[one.name] = one.mean
        elif one.name in OF_A_FLIGHT and len(flights) > 1:
            free += [replace(one, flight=flight) for flight in flights]
        else:
            free.append(one)
    return Unknowns(tuple(free), fixed)

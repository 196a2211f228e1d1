"""Every limit that a verdict rests on, with its unit and where it is from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QualityLimits:
    """Limits of the rules of `sysid.quality`.

    imu_hz, imu_least_hz: rate of gyros and accelerometers below which a flight is used with care, and is too poor: 20
    and 5 samples over the period of a short-period mode of 2 Hz (25 times the mode are usual: Klein & Morelli, ch. 9).
    sideslip_hz: the same below which a sideslip without a vane is too poor: at 10 Hz in gusts lateral derivatives were
    15 and more of their bars off.
    vane_hz, command_hz, air_hz: the same of vanes, commands and airspeed, with care.
    lost, lost_most: share of time without samples of the IMU.
    uneven: middle 80 % of its intervals over the median one.
    vibration: noise of an accelerometer, m/s^2, that no sensor of Table II has by a factor of ten.
    ranges_g: ends of range of accelerometers, g; clipped: readings there.
    still, least: standard deviation of a surface, rad, that is a movement whatever the log resolves, and that is none;
    resolved: between them, times the standard deviation of its rounding, beyond which it has moved (as for the
    estimator).
    alike: correlation of aileron and rudder, beyond which neither is distinguished from the other.
    gusts: m/s, that move a small aircraft as much as test inputs of 2 deg.
    lift, lift_usual: lift coefficient, by weight, airspeed and wing area, outside of which no aircraft flies level, and
    few do.
    loose: standard error of a main derivative over its value, or over half of its usual size where that is larger.
    tic: of a validation, times the limit, beyond which an axis is too poor.
    signs: standard errors beyond which a damping has the wrong sign.
    lift_slope: CL_alpha, of wings of aspect ratio 1 to 20 (Helmbold), with a margin. A recording alone, without
    elevator and pitch rate taken off, is judged by half and by one and a half times these.
    lift_by_angle: correlation of lift and angle of attack from which on their slope is known to a factor of two.
    """

    imu_hz: float = 40.0
    imu_least_hz: float = 10.0
    sideslip_hz: float = 20.0
    vane_hz: float = 15.0
    command_hz: float = 20.0
    air_hz: float = 5.0
    lost: float = 0.02
    lost_most: float = 0.3
    uneven: float = 0.6
    vibration: float = 3.0
    ranges_g: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)
    clipped: int = 5
    still: float = 0.003
    least: float = 1e-4
    resolved: float = 4.0
    alike: float = 0.95
    gusts: float = 0.7
    lift: tuple[float, float] = (0.03, 3.0)
    lift_usual: tuple[float, float] = (0.08, 1.8)
    loose: float = 0.15
    tic: float = 2.0
    signs: float = 3.0
    lift_slope: tuple[float, float] = (1.0, 9.0)
    lift_by_angle: float = 0.7


LIMITS_OF_QUALITY = QualityLimits()

"""What a recording is worth before anything is estimated: rates, gaps, timing, vibration, excitation, sensors, air.

Of what makes an axis too poor, that is marked `no_numbers` which moves the estimates without widening their bars: an
IMU sampled too seldom for the motion, and a sideslip reconstructed from one that is slow. The rest leaves the numbers
to the estimator, whose own rules know more: it refuses what no surface moved unless a prior model knows it, and drag
without thrust; samples that were lost widen the bars (with 45 % lost in bursts, misses stay below four of them); thrust
that repeats one value is a dead sensor's or a glider's; and the file of another aircraft scales the numbers without
being a fault of the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.model.aerodynamic_terms import AXES
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.numerics.feedback_law import LAW_OF, is_feedback_law
from sysid.numerics.smoothing import noise_sigma
from sysid.quality.flight_quality import CARE, LATERAL, LONGITUDINAL, POOR, Quality, Reason, once
from sysid.quality.thresholds import LIMITS_OF_QUALITY as LIMITS
from sysid.signals.flight import BY_ATTITUDE, FlightSignals, repeats
from sysid.signals.preparation import Prepared
from sysid.signals.rounding import rounding_of

_IMU = ("p", "q", "r", "ax", "ay", "az")
_SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder"}
# What is known less well without each of them.
_SHOWN_BY = {"ax": ("CD",), "ay": ("CY",), "az": ("CL",), "p": LATERAL, "q": LONGITUDINAL, "r": LATERAL}
_OTHER_AIRCRAFT = "is it the vehicle file of another aircraft? check mass, wing area and the unit of the airspeed"
_MOVED_BY = {LONGITUDINAL: ("de",), LATERAL: ("da", "dr")}


@dataclass(frozen=True)
class SeenFlight:
    """A flight as the rules see it.

    signals: as recorded, within the parts that are used. gusts: m/s, as estimated by kinematics; 0 for calm air, or not
    known. simulated: whether the method simulates the lateral motion, and needs no sideslip by kinematics.
    """

    signals: FlightSignals
    prepared: Prepared
    vehicle: Vehicle
    gusts: float
    simulated: bool

    def samples(self, name: str) -> tuple[Array, Array]:
        """Stamps and values that carry a number, within the parts."""
        one = self.signals.signals.get(name)
        if one is None:
            return np.zeros(0), np.zeros(0)
        good = np.isfinite(one.time_s) & np.isfinite(one.values)
        inside = np.zeros(good.size, dtype=bool)
        for stretch in self.prepared.stretches:
            inside |= (one.time_s >= stretch.segment.start_s) & (one.time_s <= stretch.segment.end_s)
        return one.time_s[good & inside], one.values[good & inside]

    def moved(self, surface: str) -> bool:
        """Whether a surface moved by more than its log resolves."""
        values = self.samples(surface)[1]
        least = min(LIMITS.still, LIMITS.resolved * rounding_of(values, None).std)
        return values.size > 1 and float(np.std(values)) > max(least, LIMITS.least)

    def follows_a_law(self, surface: str) -> bool:
        """Whether nothing moved a surface but a law of the motion."""
        stamps, values = self.samples(surface)

        def command(time_s: Array) -> Array:
            return np.asarray(np.interp(time_s, stamps, values))

        for stretch in self.prepared.stretches:
            felt = [stretch.data[name] for name in LAW_OF[surface] if name in stretch.data.columns]
            if np.ptp(command(stretch.record.time_s)) == 0.0:
                continue
            if not felt or not is_feedback_law(command, stretch.record.time_s, felt):
                return False
        return True


def flights_quality(
    signals: Sequence[FlightSignals], prepared: Sequence[Prepared], vehicle: Vehicle, gusts: float, simulated: bool
) -> Quality:
    """The verdict of flights that are used together. signals: of each, as recorded. gusts: m/s. simulated: as in
    SeenFlight.
    """
    pairs = zip(signals, prepared, strict=True)
    return quality_of([SeenFlight(one, each, vehicle, gusts, simulated) for one, each in pairs])


def quality_of(flights: Sequence[SeenFlight]) -> Quality:
    """The verdict by the rules of this module: what excites an axis is asked of all flights together."""
    lost = tuple(_not_flown(flights))
    found = [reason for one in flights for reason in _reasons(one)]
    gone = {axis for one in lost for axis in one.axes}
    found += [one for one in _excitation(flights) if set(one.axes) - gone]
    return Quality(once(found), AXES, lost)


def _reasons(seen: SeenFlight) -> list[Reason]:
    """What is said of one flight; nothing of axes that it did not fly."""
    gone = {axis for one in _not_flown([seen]) for axis in one.axes}
    return [one for rule in RULES for one in rule(seen) if not one.axes or set(one.axes) - gone]


def _intervals(seen: SeenFlight, name: str) -> Array:
    """Times between samples within the parts, s; breaks between parts are none of them."""
    stamps = seen.samples(name)[0]
    steps = np.diff(stamps)
    edges = [stretch.segment.end_s for stretch in seen.prepared.stretches]
    across = np.zeros(steps.size, dtype=bool)
    for edge in edges:
        across |= (stamps[:-1] <= edge) & (stamps[1:] > edge)
    return np.asarray(steps[~across & (steps > 0.0)])


def _rate(seen: SeenFlight, name: str) -> float:
    steps = _intervals(seen, name)
    return 1.0 / float(np.median(steps)) if steps.size else 0.0


def _slowest(seen: SeenFlight) -> float:
    """Rate of the slowest of gyros and accelerometers, Hz."""
    return min((_rate(seen, name) for name in _IMU if name in seen.signals.signals), default=0.0)


def _rates(seen: SeenFlight) -> Iterator[Reason]:
    slowest = _slowest(seen)
    if slowest < LIMITS.imu_hz - 0.5:
        poor = slowest < LIMITS.imu_least_hz - 0.2
        text, advice = f"gyros and accelerometers come at {slowest:.0f} Hz", "have them sent at 50 Hz or more"
        yield Reason(POOR if poor else CARE, text, advice, no_numbers=poor)
    for names, least, words in (
        (("alpha", "beta"), LIMITS.vane_hz, "vanes"),
        (("de", "da", "dr"), LIMITS.command_hz, "commands"),
        (("airspeed",), LIMITS.air_hz, "airspeed"),
    ):
        rates = [rate for name in names if (rate := _rate(seen, name)) > 0.0]
        if rates and min(rates) < 0.95 * least:
            yield Reason(CARE, f"{words}: {min(rates):.1f} Hz", f"have them sent at {least:.0f} Hz or more")


def _gaps(seen: SeenFlight) -> Iterator[Reason]:
    steps = _intervals(seen, "q")
    if steps.size < 2:
        return
    usual = float(np.median(steps))
    long = steps[steps > 1.8 * usual]
    share = float((long - usual).sum() / steps.sum())
    if share > LIMITS.lost:
        gaps = "1 gap" if long.size == 1 else f"{long.size} gaps"
        yield Reason(
            POOR if share > LIMITS.lost_most else CARE,
            f"{share:.0%} of the time is without gyros ({gaps}, the longest {long.max():.2g} s)",
            "log on board, or at a rate that the link carries",
        )
    short = steps[steps <= 1.8 * usual]
    spread = float(np.subtract(*np.percentile(short, (90.0, 10.0)))) / usual
    if spread > LIMITS.uneven:
        yield Reason(CARE, f"stamps of the gyros are uneven by {spread:.0%} of their interval", "log on board")


def _vibration(seen: SeenFlight) -> Iterator[Reason]:
    for name in ("ax", "ay", "az"):
        stamps, values = seen.samples(name)
        if values.size < 50:
            continue
        try:
            noise = noise_sigma(values, float(np.median(np.diff(stamps))))
        except SignalError:
            continue
        if noise > LIMITS.vibration:
            yield Reason(
                CARE,
                f"{name} shakes by {noise:.1f} m/s^2 from sample to sample",
                "balance the propeller, put the autopilot on foam",
            )
        top = float(np.max(np.abs(values))) / STANDARD_GRAVITY
        at_end = int(np.count_nonzero(np.abs(values) > 0.999 * top * STANDARD_GRAVITY))
        if at_end >= LIMITS.clipped and any(abs(top / one - 1.0) < 0.03 for one in LIMITS.ranges_g):
            yield Reason(CARE, f"{name} is cut off at {top:.1f} g, {at_end} times", "set a wider range")


def _not_flown(flights: Sequence[SeenFlight]) -> Iterator[Reason]:
    for axes, surfaces in _MOVED_BY.items():
        words = " and ".join(_SURFACES[name] for name in surfaces)
        moved = {name: of for name in surfaces if (of := [one for one in flights if one.moved(name)])}
        if not moved:
            yield Reason(POOR, f"{words} did not move", f"fly test inputs on {words}", axes)
        elif all(one.gusts > 0.0 and one.follows_a_law(name) for name, of in moved.items() for one in of):
            alone = " and ".join(_SURFACES[name] for name in moved)
            text = f"{alone} did nothing but follow the motion (a hold, a damper), which gusts alone have excited"
            yield Reason(POOR, text, f"fly test inputs on {words}", axes, no_numbers=True)


def _excitation(flights: Sequence[SeenFlight]) -> Iterator[Reason]:
    """Whether each surface has moved by itself. How much and how long is enough the bars say
    (`sysid.quality.estimate_rules`).
    """
    moved = [name for name in ("da", "dr") if any(one.moved(name) for one in flights)]
    if len(moved) == 2:
        both = np.concatenate([_aileron_and_rudder(one) for one in flights], axis=1)
        if both.shape[1] and both.std(axis=1).min() > 0.0 and abs(float(np.corrcoef(both)[0, 1])) > LIMITS.alike:
            yield Reason(
                CARE, "aileron and rudder move together", "move one at a time, or a multisine on each", LATERAL
            )
    elif moved:
        (still,) = {"da", "dr"} - set(moved)
        yield Reason(CARE, f"{_SURFACES[still]} did not move", f"fly test inputs on {_SURFACES[still]}", LATERAL)


def _aileron_and_rudder(seen: SeenFlight) -> Array:
    """(2, N) of a flight about their means, at the aileron's stamps."""
    (stamps, aileron), (others, rudder) = seen.samples("da"), seen.samples("dr")
    if not stamps.size or not others.size:
        return np.zeros((2, 0))
    there = np.interp(stamps, others, rudder)
    return np.stack((aileron - aileron.mean(), there - there.mean()))


def _sideslip(seen: SeenFlight) -> Iterator[Reason]:
    """Whether there is a sideslip at all: the kinematics smear one that gusts bring within a few of their samples, and
    all lateral coefficients are estimated together.
    """
    slowest = _slowest(seen)
    if not seen.simulated and "beta" not in _measured(seen) and slowest < LIMITS.sideslip_hz - 0.5:
        text = (
            f"sideslip is reconstructed from {slowest:.0f} Hz signals: below {LIMITS.sideslip_hz:.0f} Hz its error is"
            " larger than the bars can say"
        )
        yield Reason(POOR, text, "log the IMU at 50 Hz or fit a beta vane", LATERAL, no_numbers=True)


def _measured(seen: SeenFlight) -> set[str]:
    """Signals that a sensor measures and that change."""
    signals = seen.signals.signals.items()
    return {name for name, one in signals if _is_alive(one.values) and one.source != BY_ATTITUDE}


def _sensors(seen: SeenFlight) -> Iterator[Reason]:
    there = _measured(seen)
    for name, axes in _SHOWN_BY.items():
        if name not in there:
            text = f"no {'accelerometer' if name.startswith('a') else 'gyro'} {name[-1]}: it is done without"
            yield Reason(CARE, text, "see whether its sensor is dead, and whether it is logged", axes)
    for name, axes, words in (("alpha", ("CL", "Cm"), "attack"), ("beta", LATERAL, "sideslip")):
        if name not in there:
            source = "simulated" if name == "beta" and seen.simulated else "taken from the kinematics"
            text = f"no vane of the angle of {words}: it is {source}"
            yield Reason(CARE, text, "a vane, or calm air and large inputs", axes)
    if "thrust" in seen.prepared.data and "thrust" not in there:
        yield Reason(POOR, "thrust repeats one value", "see whether its sensor is dead", ("CD",))
    if seen.prepared.thrust_source.missing:
        yield Reason(POOR, f"thrust is unknown: {seen.prepared.thrust_source.missing}", "", ("CD",))
    elif not seen.prepared.thrust_source.measured:
        yield Reason(CARE, f"thrust is taken {seen.prepared.thrust_source}", "measure it", ("CD",))


def _is_alive(values: Array) -> bool:
    """Whether a signal is measured at all."""
    return bool(np.isfinite(values).sum() > 1) and not repeats(values)


def _air(seen: SeenFlight) -> Iterator[Reason]:
    if seen.gusts > LIMITS.gusts:
        yield Reason(CARE, f"gusts of {seen.gusts:.1f} m/s", "fly at dawn, or with larger inputs")


def _aircraft(seen: SeenFlight) -> Iterator[Reason]:
    """Whether this is the aircraft of the vehicle file: weight against lift, and what the lift gains with the angle."""
    if not _is_alive(seen.samples("az")[1]):
        return
    speed = np.concatenate([stretch.data["airspeed"] for stretch in seen.prepared.stretches])
    force = np.concatenate([stretch.data["az"] for stretch in seen.prepared.stretches])
    density = SEA_LEVEL_DENSITY
    if seen.vehicle.sensors.airspeed.kind == "true":
        density = float(np.median(np.concatenate([stretch.record.rho for stretch in seen.prepared.stretches])))
    mass, area = seen.vehicle.mass.mass, seen.vehicle.geometry.S
    pressure = 0.5 * density * float(np.nanmedian(speed)) ** 2
    lift = mass * float(np.nanmedian(np.abs(force))) / max(pressure * area, 1e-12)
    wing = f"the wing of {area:.3g} m^2"
    if not LIMITS.lift_usual[0] < lift < LIMITS.lift_usual[1]:
        impossible = not LIMITS.lift[0] < lift < LIMITS.lift[1]
        yield Reason(
            POOR if impossible else CARE,
            f"to carry {mass:.3g} kg at {np.nanmedian(speed):.3g} m/s {wing} needs a lift coefficient of {lift:.2g}",
            _OTHER_AIRCRAFT,
        )
    if not _is_alive(seen.samples("alpha")[1]):
        return
    angle = np.concatenate([stretch.data["alpha"] for stretch in seen.prepared.stretches])
    slope = _slope(angle, -mass * force / np.maximum(0.5 * density * speed**2 * area, 1e-12))
    if slope is not None and not (slope[1] > LIMITS.lift_slope[0] / 2.0 and slope[0] < LIMITS.lift_slope[1] * 1.5):
        low, high = LIMITS.lift_slope
        yield Reason(
            POOR,
            f"at {mass:.3g} kg the lift coefficient of {wing} would rise by {slope[0]:.2g} to {slope[1]:.2g} per radian"
            f" of angle of attack; that of wings rises by {low:g} to {high:g}",
            _OTHER_AIRCRAFT,
        )


def _slope(angle: Array, lift: Array) -> tuple[float, float] | None:
    """Slope of the lift coefficient, 1/rad: the least and the most that noise of angle and lift leave; None where
    they hardly go together.

    The regression of the lift on the angle is too flat by the noise of the angle, and the inverse one too steep by that
    of the lift (Frisch 1934: the bounds of errors in both variables): the truth lies between.
    """
    good = np.isfinite(angle) & np.isfinite(lift)
    if np.count_nonzero(good) < 50 or min(np.std(angle[good]), np.std(lift[good])) == 0.0:
        return None
    shared = float(np.corrcoef(angle[good], lift[good])[0, 1])
    if shared < LIMITS.lift_by_angle:
        return None
    ratio = float(np.std(lift[good]) / np.std(angle[good]))
    return shared * ratio, ratio / shared


RULES: tuple[Callable[[SeenFlight], Iterator[Reason]], ...] = (
    _aircraft, _rates, _sideslip, _gaps, _vibration, _sensors, _air,
)  # fmt: skip

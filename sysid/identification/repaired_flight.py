"""A flight as its sensors meant it: what is lost is bridged, what is dead done without, what is misread mended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SegmentError, SignalError, SysidError
from sysid.signal_check.corrected_faults import repaired
from sysid.signal_check.dead_airspeed import with_airspeed
from sysid.signal_check.dead_thrust import without_dead_thrust
from sysid.signal_check.fault import Mistake
from sysid.signals.flight import BY_ATTITUDE, FlightSignals, Signal, repeats
from sysid.signals.preparation import Prepared, prepare
from sysid.signals.record import SURFACES
from sysid.signals.sensor_groups import ATTITUDE, ESSENTIAL, GYRO, IMU
from sysid.signals.thrust.electric import with_electric_thrust

# Lost samples over so long are bridged, s.
_BRIDGED_S = 2.0
# Samples below which there is no attitude.
_FEWEST = 10


@dataclass(frozen=True)
class RepairedFlight:
    """A flight as its sensors meant it: its signals, the same prepared, and the mistakes that were mended.

    signals: without accelerometers that are dead, and the attitude's rates for gyros that are. doubt: why it may not be
    a flight, where all of it was taken. whole: whether nothing was lost that had to be bridged. airspeed_std: share by
    which all of the airspeed may be wrong where something else stands for its dead sensor, else 0.
    """

    signals: FlightSignals
    prepared: Prepared
    mistakes: tuple[Mistake, ...]
    doubt: SysidError | None
    whole: bool
    airspeed_std: float = 0.0

    def as_measured(
        self, vehicle: Vehicle, start_s: float | None = None, stop_s: float | None = None, anew: bool = False
    ) -> Prepared:
        """The flight prepared with the gaps that it has, for methods that take every sample for a measurement.

        anew: for a vehicle that is not the one it was repaired for. Raises SysidError where no part of it is flight.
        """
        if self.doubt is not None:
            raise self.doubt
        if self.whole and not anew:
            return self.prepared
        try:
            return prepare(self.signals, vehicle, start_s, stop_s)
        except SysidError as error:
            raise type(error)(f"{error}; --method map does without what is missing or lost between samples") from error


def meant(
    flight: FlightSignals,
    vehicle: Vehicle,
    as_recorded: Sequence[str] = (),
    start_s: float | None = None,
    stop_s: float | None = None,
) -> RepairedFlight:
    """A flight without mistakes that no owner would doubt (sysid.signal_check.corrected_faults). Raises SysidError."""
    airflow = with_airspeed(without_dead(flight), vehicle)
    flight = with_electric_thrust(airflow.signals, vehicle)
    found = prepared_flight(flight, vehicle, start_s, stop_s)
    while (thrusting := without_dead_thrust(flight, found.prepared)) is not flight:
        flight, found = thrusting, prepared_flight(thrusting, vehicle, start_s, stop_s)
    try:
        signals, mistakes = repaired(flight, found.prepared, vehicle, as_recorded)
        if signals is not flight:
            found = replace(prepared_flight(signals, vehicle, start_s, stop_s), mistakes=tuple(mistakes))
        elif mistakes:
            found = replace(found, mistakes=tuple(mistakes))
    except SysidError as error:
        raise (found.doubt or error) from error
    return replace(found, airspeed_std=airflow.scale_std)


@dataclass(frozen=True)
class FlightsRead:
    """The flights of a job as their sensors meant them: those that are fitted, and those that a model is judged by.

    left_out: of which others no part is long enough, and why.
    """

    fitted: Sequence[RepairedFlight]
    judges: Sequence[RepairedFlight]
    left_out: tuple[str, ...] = ()

    def as_measured(
        self, vehicle: Vehicle, start_s: float | None, stop_s: float | None
    ) -> tuple[FlightsRead, list[Prepared]]:
        """The flights of which a part can be taken as it was measured (RepairedFlight.as_measured), and those parts.

        Raises SegmentError where there is none.
        """
        kept, prepared, errors = [], [], []
        for one in self.fitted:
            try:
                prepared.append(one.as_measured(vehicle, start_s, stop_s))
                kept.append(one)
            except SegmentError as error:
                errors.append(error)
        if not kept:
            raise errors[0]
        return replace(self, fitted=kept, left_out=(*self.left_out, *map(_left_out, errors))), prepared

    def mistakes(self) -> tuple[Mistake, ...]:
        """What was mended in the flights that are fitted, or reported of them."""
        return tuple({one.sentence: one for each in self.fitted for one in each.mistakes}.values())

    def require_airspeed(self) -> None:
        """Raise SignalError for methods without doubts of their inputs, where a dead sensor's airspeed was made up."""
        for one in self.fitted:
            if one.airspeed_std:
                raise SignalError(
                    f"{one.signals.name}: the airspeed repeats one value: its sensor is dead or not connected;"
                    " --method map does without it"
                )

    def doubted(self, vehicle: Vehicle) -> Vehicle:
        """The aircraft as these flights measured it: with the doubt of an airspeed that something else stands for."""
        share = max((one.airspeed_std for one in self.fitted), default=0.0)
        if share == 0.0:
            return vehicle
        sensor = vehicle.sensors.airspeed
        sensor = replace(sensor, scale_std=float(np.hypot(sensor.scale_std or 0.0, share)))
        return replace(vehicle, sensors=replace(vehicle.sensors, airspeed=sensor))

    def warnings(self) -> list[str]:
        """What is reported of the flights that are left out, and of those to judge by."""
        each = [(one.prepared.warnings, [mistake.sentence for mistake in one.mistakes]) for one in self.judges]
        return [*self.left_out, *(line for warnings, mistakes in each for line in (*warnings, *mistakes))]


def read_flights(
    flights: Sequence[FlightSignals],
    validate_on: Sequence[FlightSignals],
    vehicle: Vehicle,
    as_recorded: Sequence[str],
    start_s: float | None,
    stop_s: float | None,
) -> FlightsRead:
    """The flights of a job. start_s, stop_s: the part of those that are fitted. One of several that is too short is
    left out, and named.

    Raises SysidError where one lacks what is needed, all are too short, or one to judge by is no flight.
    """
    fitted, errors = [], []
    for flight in _named_apart(flights):
        try:
            fitted.append(meant(flight, vehicle, as_recorded, start_s, stop_s))
        except SegmentError as error:
            errors.append(error)
    if errors and not fitted:
        raise errors[0]
    judges = [meant(one, vehicle, as_recorded) for one in validate_on]
    for one in judges:
        if one.doubt is not None:
            raise one.doubt
    return FlightsRead(fitted, judges, tuple(map(_left_out, errors)))


def _named_apart(flights: Sequence[FlightSignals]) -> list[FlightSignals]:
    """The flights, each with a name of its own: by that they are held apart."""
    found: list[FlightSignals] = []
    for flight in flights:
        taken, name, number = {one.name for one in found}, flight.name, 2
        while name in taken:
            name, number = f"{flight.name} ({number})", number + 1
        found.append(flight if name == flight.name else replace(flight, name=name))
    return found


def _left_out(error: SegmentError) -> str:
    return f"left out: {error}"


def bridged(signals: FlightSignals) -> FlightSignals:
    """The flight with bursts of lost samples up to 2 s, and what comes between those of slower sensors than the gyros,
    filled by straight lines, so that it stays in one part.

    For finding the parts of a flight alone: what is fitted is compared at the stamps of the samples there are.
    """
    filled = {}
    usual = min((float(np.median(np.diff(one.time_s))) for one in _imu(signals) if one.time_s.size > 10), default=0.0)
    for name, one in signals.signals.items():
        good = np.isfinite(one.time_s) & np.isfinite(one.values)
        time_s, values = one.time_s[good], one.values[good]
        if name in (*IMU, *ESSENTIAL, "alpha", "beta", *SURFACES, "throttle", "thrust") and time_s.size > 10:
            time_s, values = _filled(time_s, values, usual if name in (*IMU, *ESSENTIAL) else 0.0)
        filled[name] = Signal(time_s, values, one.unit, one.source, one.calibration)
    if all(filled[name].time_s.size == one.time_s.size for name, one in signals.signals.items()):
        return signals
    return replace(signals, signals=filled)


def _imu(signals: FlightSignals) -> list[Signal]:
    return [signals.signals[name] for name in IMU if name in signals.signals]


def _filled(time_s: Array, values: Array, least_s: float) -> tuple[Array, Array]:
    """Samples with more of them on straight lines, at the usual interval of the signal or at `least_s`."""
    steps = np.diff(time_s)
    usual = least_s if least_s > 0.0 else float(np.median(steps))
    more = [
        np.linspace(time_s[i], time_s[i + 1], max(2, round(steps[i] / usual)) + 1)[1:-1]
        for i in np.flatnonzero((steps > 1.5 * usual) & (steps < _BRIDGED_S))
    ]
    if not more:
        return time_s, values
    every = np.sort(np.concatenate((time_s, *more)))
    return every, np.interp(every, time_s, values)


def missing_inertial(signals: FlightSignals) -> list[str]:
    """Accelerometers and gyros that a flight does not have."""
    return [name for name in IMU if name not in signals.signals]


def has_whole_imu(signals: FlightSignals) -> bool:
    """Whether every accelerometer and gyro measured."""
    return all(name in signals.signals and signals.signals[name].source != BY_ATTITUDE for name in IMU)


def without_dead(signals: FlightSignals) -> FlightSignals:
    """The flight without accelerometers and gyros that are dead; the attitude's rates stand for gyros, where it has
    them. What is missing of the IMU is reported.
    """
    kept, warnings = dict(signals.signals), []
    if not any(name in kept for name in IMU):
        return signals
    for name in IMU:
        if name in kept and np.isfinite(kept[name].values).any() and not repeats(kept[name].values):
            continue
        why = "no signal" if name not in kept else "no change of"
        rate = attitude_rate(signals, name)
        if rate is not None:
            warnings.append(f"{why} {name}: {BY_ATTITUDE} is taken in its place")
            kept[name] = rate
        else:
            warnings.append(f"{why} {name}: it is done without")
            kept.pop(name, None)
    return replace(signals, signals=kept, warnings=(*signals.warnings, *warnings)) if warnings else signals


def attitude_rate(signals: FlightSignals, rate: str) -> Signal | None:
    """p, q or r [rad/s] between the samples of the attitude, by its change (Klein & Morelli 2016, eq. 3.21); None where
    that is not measured, or no rate of the body's.

    Differences over one interval pass 99 % of what moves at 3 Hz, and no noise below; what they make of noise above is
    among what the estimate finds to be left.
    """
    angles = [signals.signals.get(name) for name in ATTITUDE]
    if rate not in GYRO or any(one is None or np.isfinite(one.values).sum() < _FEWEST for one in angles):
        return None
    good = [(one.time_s[here], one.values[here]) for one in angles if one for here in (np.isfinite(one.values),)]
    stamps, interval = good[1][0], np.diff(good[1][0])
    phi, theta, psi = (np.interp(stamps, time_s, np.unwrap(values)) for time_s, values in good)
    kept = interval > 0.0
    middle = (stamps[:-1] + 0.5 * interval)[kept]
    turn = [np.diff(one)[kept] / interval[kept] for one in (phi, theta, psi)]
    phi, theta = (np.interp(middle, stamps, one) for one in (phi, theta))
    values = {
        "p": turn[0] - turn[2] * np.sin(theta),
        "q": turn[1] * np.cos(phi) + turn[2] * np.cos(theta) * np.sin(phi),
        "r": turn[2] * np.cos(theta) * np.cos(phi) - turn[1] * np.sin(phi),
    }[rate]
    return Signal(middle, np.asarray(values), "rad/s", BY_ATTITUDE)


def _with_stand_ins(signals: FlightSignals) -> FlightSignals:
    """The flight with a signal for each accelerometer and gyro that is missing, of a slope far below any noise.

    For finding the parts of a flight alone; the estimate does without them.
    """
    there, lost = _imu(signals), missing_inertial(signals)
    if not there or not lost:
        return signals
    like = max(there, key=lambda one: one.time_s.size)
    nothing = replace(like, values=1e-12 * np.arange(like.time_s.size, dtype=np.float64))
    return replace(signals, signals={**signals.signals, **dict.fromkeys(lost, nothing)})


def prepared_flight(
    flight: FlightSignals, vehicle: Vehicle, start_s: float | None, stop_s: float | None
) -> RepairedFlight:
    """The flight prepared as recorded; where no part of it seems to be flight, all of it, and why not."""
    filled = _with_stand_ins(bridged(flight))
    filled.require(*IMU, *ESSENTIAL)
    try:
        return RepairedFlight(flight, prepare(filled, vehicle, start_s, stop_s), (), None, filled is flight)
    except SysidError as error:
        time_s = filled.signals["q"].time_s
        if start_s is not None or stop_s is not None or time_s.size < 2:
            raise
        try:
            whole = prepare(filled, vehicle, float(time_s[0]), float(time_s[-1]))
        except SysidError:
            raise error from None
        return RepairedFlight(flight, whole, (), error, filled is flight)

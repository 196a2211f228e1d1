"""Commands and sensors put in time for an estimation, and the delays that came out of it."""

from __future__ import annotations

from collections.abc import Sequence

from sim_vehicle.vehicle import Vehicle
from sysid.command_delay import command_delay
from sysid.delays import COMMANDS, Delay, prepared_in_time, total
from sysid.estimate import Likeliest, Problem, excited_motion, free_coefficients
from sysid.flight import FlightData
from sysid.late import COMMAND_DELAY, SENSOR_DELAYS
from sysid.prepare import Prepared
from sysid.residuals import body_of
from sysid.signalcheck import SignalCheck


def commands_in_time(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    check: SignalCheck,
    parts: Sequence[FlightData],
    names: Sequence[str],
    refined: bool,
) -> tuple[list[Prepared], SignalCheck, dict[str, float]]:
    """Flights whose commands act when they do by equation error, the check with that delay, and what is left of it.

    parts: corrected parts for equation error. names: coefficients. refined: whether output error will estimate the rest
    of the delay; then only whole samples are taken off, which leaves the commands what they are. What is left is the
    start value, s, of the delay that output error estimates.
    """
    motion = excited_motion([stretch.record for flight in prepared for stretch in flight.stretches])
    profile = command_delay(parts, body_of(vehicle), free_coefficients(names, motion))
    if profile is None or not profile.counts():
        return list(prepared), check, {}
    interval = prepared[0].data.interval_s
    value = round(profile.delay / interval) * interval if refined else profile.delay
    rest = {COMMAND_DELAY: profile.delay - value} if refined else {}
    if value == 0.0:
        return list(prepared), check, rest
    late = Delay(COMMANDS, value, profile.std)
    return prepared_in_time(prepared, vehicle, [late]), check.with_delays([*check.delays, late]), rest


def refined_delays(
    prepared: Sequence[Prepared], vehicle: Vehicle, check: SignalCheck, problem: Problem, result: Likeliest
) -> tuple[list[Prepared], SignalCheck]:
    """The flights and the check with what an estimate has made of the delays among its unknowns."""
    places = {parameter.name: i for i, parameter in enumerate(result.parameters)}
    late = []
    for name in problem.delays:
        signals = COMMANDS if name == COMMAND_DELAY else SENSOR_DELAYS[name]
        i = places[name]
        late.append(Delay(signals, float(result.theta[i]), float(result.covariance[i, i]) ** 0.5))
    if not late:
        return list(prepared), check
    return prepared_in_time(prepared, vehicle, late), check.with_delays(total([*check.delays, *late]))

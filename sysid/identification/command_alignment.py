"""Commands and sensors put in time for an estimation, and the delays that came out of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.command_delay import command_delay
from sysid.problem.delay_parameters import COMMAND_DELAY
from sysid.problem.problem import excited_motion, free_coefficients
from sysid.signal_check.check import SignalCheck
from sysid.signals.delay import COMMANDS, Delay, prepared_in_time, total
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared


def commands_in_time(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    check: SignalCheck,
    parts: Sequence[FlightData],
    names: Sequence[str],
    method: str,
    calm: bool,
) -> tuple[list[Prepared], SignalCheck, dict[str, float]]:
    """Flights whose commands act when they do by equation error, the check with that delay, and what is left of it.

    parts: corrected parts for equation error. names: coefficients. method: of METHODS of sysid.identify; where maximum
    likelihood will estimate the rest, only whole samples are taken off, which leaves the commands what they are.
    calm: whether the air was; in rough air equation error may be wrong, and filter error decides. What is left is the
    start value, s, of the delay that maximum likelihood estimates.
    """
    motion = excited_motion([stretch.record for flight in prepared for stretch in flight.stretches])
    profile = command_delay(parts, body_of(vehicle), free_coefficients(names, motion))
    if profile is None or not profile.counts():
        return list(prepared), check, {}
    interval = prepared[0].data.interval_s
    if method == "ee":
        # Gusts that the vanes see and the wing does not, or not then, move the estimate by up to a sample.
        value, std = profile.delay, profile.std if calm else float(np.hypot(profile.std, interval))
    elif calm:
        value, std = round(profile.delay / interval) * interval, profile.std
    else:
        value, std = 0.0, profile.std
    rest = {} if method == "ee" else {COMMAND_DELAY: profile.delay - value}
    if value == 0.0:
        return list(prepared), check, rest
    late = Delay(COMMANDS, value, std)
    return prepared_in_time(prepared, vehicle, [late]), check.with_delays([*check.delays, late]), rest


def with_late_commands(prepared: Sequence[Prepared], vehicle: Vehicle, late: Mapping[str, float]) -> list[Prepared]:
    """The flights as if the commands were corrected for a delay that is only suspected (see `commands_in_time`)."""
    return prepared_in_time(prepared, vehicle, [Delay(COMMANDS, late[COMMAND_DELAY], 0.0)])


def refined_delays(
    prepared: Sequence[Prepared], vehicle: Vehicle, check: SignalCheck, more: Sequence[Delay]
) -> tuple[list[Prepared], SignalCheck]:
    """The flights and the check with what an estimate has added to the delays; one that was taken back is gone."""
    if not more:
        return list(prepared), check
    told = [one for one in total([*check.delays, *more]) if one.value != 0.0]
    return prepared_in_time(prepared, vehicle, more), check.with_delays(told)

"""Flights to judge a model by, with surfaces and thrust as servos and a motor's mass were found to make them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.posterior.estimates import PosteriorEstimate
from sysid.posterior.flight_part import inputs_of
from sysid.posterior.group_model import servo_of
from sysid.posterior.inputs import InputSignal, surface_motion
from sysid.posterior.nuisance_priors import GROUPS, MOVING_MASS, SURFACES_OF
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS, PRE_ROLL_S, SURFACES, Record

_SMOOTH_S = 0.05  # half of what the acceleration of a motor is averaged over
_MARGIN_S = 1.0  # s of inputs beyond the samples, more than any delay


def with_estimated_deflections(
    prepared: Sequence[Prepared], signals: Sequence[FlightSignals], vehicle: Vehicle, found: PosteriorEstimate
) -> list[Prepared]:
    """The flights with what their surfaces did from sample to sample in place of their commands.

    What accelerates the motor on its thrust sensor is added to the thrust.

    signals: of each flight, on their own stamps. A group that was not estimated stays as it was recorded.
    """
    moved = []
    for flight, own in zip(prepared, signals, strict=True):
        first, last = flight.stretches[0].record.time_s[0], flight.stretches[-1].record.time_s[-1]
        logged, _ = inputs_of(own, vehicle, float(first) - PRE_ROLL_S - _MARGIN_S, float(last) + _MARGIN_S)
        inputs = found.as_sent(logged)
        of_group = {group: found.servos(group, flight.data.name) for group in GROUPS}
        servos = {
            surface: values
            for group, values in of_group.items()
            if values is not None
            for surface in SURFACES_OF[group]
        }
        common = next((values for values in of_group.values() if values is not None), None)
        if common is not None:
            servos |= {
                name: tuple(servo_of(vehicle, name, common, inputs))
                for name in vehicle.named_controls
                if name in inputs
            }
        stretches = [
            replace(one, record=_thrusting(_moved(one.record, inputs, servos), found)) for one in flight.stretches
        ]
        moved.append(replace(flight, stretches=tuple(stretches)))
    return moved


def _moved(record: Record, inputs: Mapping[str, InputSignal], servos: dict[str, tuple[float, ...]]) -> Record:
    commands = record.commands.copy()
    begin = float(record.time_s[0]) - record.start * record.interval_s
    for j, name in enumerate((*SURFACES, "throttle", *record.named)):
        if name in inputs and name in servos:
            motion = surface_motion(inputs[name], begin, record.interval_s, commands.shape[0], servos[name])
            commands[:, j] = motion.means
    return replace(record, commands=np.ascontiguousarray(commands), joined=True)


def _thrusting(record: Record, found: PosteriorEstimate) -> Record:
    """The record with what accelerates the mass that was found to hang on the sensor of its thrust."""
    mass = next((one.value for one in found.nuisances if one.name == MOVING_MASS), 0.0)
    ahead = record.z[:, OUTPUTS.index("ax")]
    good = np.isfinite(ahead)
    if mass == 0.0 or record.thrust_source.signal != "thrust" or not good.any():
        return record
    begin = float(record.time_s[0]) - record.start * record.interval_s
    every = begin + record.interval_s * np.arange(record.thrust.size)
    # Noise of an input acts as rough air would.
    half = max(1, round(_SMOOTH_S / record.interval_s))
    felt = uniform_filter1d(np.interp(every, record.time_s[good], ahead[good]), 2 * half + 1, mode="nearest")
    return replace(record, thrust=record.thrust + mass * felt, moving_mass=record.moving_mass + mass)

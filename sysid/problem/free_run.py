"""The gap: how far a free-running simulation strays from the measurement over windows of five seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.flight.wind import dryden_gusts
from sim_vehicle.vehicle.packed_model import PackedModel
from sysid.arrays import Array
from sysid.compatibility.reconstruction import smoothed_states
from sysid.numerics.dryden import Turbulence
from sysid.problem.predictor import STILL_AIR, Predictor
from sysid.signals.record import OUTPUTS, STATES, Record, angle_wrap
from sysid.signals.sensor_mounting import SensorMounting

WINDOW_S = 5.0  # s, over which a free simulation runs before it starts afresh
GAP_OUTPUTS = ("airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az")
# Names of the outputs in results.
GAP_NAMES = {name: ("V" if name == "airspeed" else name) for name in GAP_OUTPUTS}
# Readings that the motion alone makes, and the states that make rates and attitude.
_FLOW, _TURNING = ("airspeed", "alpha", "beta"), ("p", "q", "r", "phi", "theta")
_READ = [OUTPUTS.index(name) for name in (*_FLOW, *_TURNING)]
# Of the search for a state that reads as measured: change that is none, and steps at most.
_SAME, _TRIES = 1e-6, 20


@dataclass(frozen=True)
class Fixed:
    """A model with nothing left free: flat model, sensor errors, and how samples show commands."""

    flat: PackedModel
    errors: Mapping[str, float]
    command_first: float = 0.0


def windows(record: Record) -> list[Record]:
    """Consecutive windows of WINDOW_S; what is left over at the end joins none unless it is half a window."""
    size = round(WINDOW_S / record.interval_s)
    edges = [(begin, min(begin + size, record.length)) for begin in range(0, record.length, size)]
    kept = [edge for edge in edges if edge[1] - edge[0] >= size // 2] or edges[:1]
    return [record.window(begin, end) for begin, end in kept]


def free_run(record: Record, states: Array, model: Fixed, gusts: Array = STILL_AIR) -> Array:
    """Outputs of a free run.

    Parameters
    ----------
    record : Record
        What drives the run, N output samples.
    states : Array, shape (9,)
        Initial u, v, w, m/s, p, q, r, rad/s, phi, theta, psi, rad.
    model : Fixed
        Model with nothing left free.
    gusts : Array, shape (M, 3) or (0, 3)
        Velocity of the air in body axes at every sample of the commands, m/s; none in still air.

    Returns
    -------
    Array, shape (N, 15)
        OUTPUTS, each column in its output's unit.
    """
    predictor = Predictor(model.flat, (), (record,), command_first=model.command_first)
    return predictor.outputs(0, model.flat, dict(model.errors), states, gusts)


def start_read_alike(record: Record, start: Array, model: Fixed) -> Array:
    """The nine states that the model's sensors read as sensors without its effects read `start`.

    Motion is reconstructed without effects. What an effect makes of a reading (a pitot tube in air of another density,
    a vane in upwash) would else count as a jump of the motion at the beginning of every run. Fixed-point iteration;
    where it finds nothing (no effect, or one too large) the start stays.

    Parameters
    ----------
    record : Record
        The run that begins there.
    start : Array, shape (9,)
        States as reconstructed: u, v, w, m/s, p, q, r, rad/s, phi, theta, psi, rad.
    model : Fixed
        Model with nothing left free.

    Returns
    -------
    Array, shape (9,)
        States in the same order.
    """
    first = record.window(0, min(2, record.length))
    measured = np.isfinite(first.z[0, _READ])
    plain = replace(model, flat=replace(model.flat, E=np.zeros_like(model.flat.E)))
    wanted = free_run(first, start, plain)[0, _READ]
    found = start
    for _ in range(_TRIES):
        off = np.where(measured, wanted - free_run(first, found, model)[0, _READ], 0.0)
        if not np.isfinite(off).all():
            return start
        if np.abs(off).max() < _SAME:
            return found
        found = _moved(found, off, wanted[0])
    return start


def _moved(states: Array, off: Array, airspeed: float) -> Array:
    """States moved by differences of readings `off`, (8,), at this reading of the airspeed."""
    found = states.copy()
    u, v, w = states[:3]
    speed = float(np.sqrt(u * u + v * v + w * w))
    alpha, beta = np.arctan2(w, u) + off[1], np.arcsin(v / speed) + off[2]
    speed *= 1.0 + off[0] / max(airspeed, 1.0)
    along = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    found[:3] = speed * along
    found[[STATES.index(name) for name in _TURNING]] += off[3:]
    return found


def window_residuals(record: Record, layout: SensorMounting, model: Fixed) -> list[tuple[Record, Array]]:
    """Measured minus free-running simulation, for every window of a record.

    Parameters
    ----------
    record : Record
        Stretch of a flight, which is cut into windows of five seconds.
    layout : SensorMounting
        Where the sensors sit and what they read, for the initial states.
    model : Fixed
        Model with nothing left free.

    Returns
    -------
    list of tuple of Record and Array, shape (N, 15)
        Each window, and the residuals of OUTPUTS at its N samples, each column in its output's unit, angles phi and psi
        in [-pi, pi]; NaN where nothing was measured.
    """
    states = smoothed_states(record, layout, dict(model.errors))
    path = np.stack([states[name] for name in STATES], axis=1)
    result = []
    begin = 0
    for part in windows(record):
        start = start_read_alike(part, path[begin], model)
        result.append((part, angle_wrap(part.z - free_run(part, start, model))))
        begin += part.length
    return result


def gap(records: Sequence[Record], layout: SensorMounting, model: Fixed) -> dict[str, float]:
    """Root mean square per output over all windows, those not measured left out; not finite where a run diverged."""
    residuals = np.concatenate([r for record in records for _, r in window_residuals(record, layout, model)])
    measured = np.concatenate([part.z for record in records for part in windows(record)])
    result = {}
    for name in GAP_OUTPUTS:
        j = OUTPUTS.index(name)
        there = np.isfinite(measured[:, j])
        if there.any():
            result[GAP_NAMES[name]] = float(np.sqrt(np.mean(residuals[there, j] ** 2)))
    return result


def _flown_by(
    model: Fixed, record: Record, start: Array, layout: SensorMounting, gusts: Array
) -> list[tuple[Record, Array]]:
    """What a model makes of a run's commands, (N, 15): of the whole run or, where it diverges, of each window."""
    y = free_run(record, start_read_alike(record, start, model), model, gusts)
    if np.isfinite(y).all():
        return [(record, y)]
    states = smoothed_states(record, layout, dict(model.errors))
    path = np.stack([states[name] for name in STATES], axis=1)
    found, begin = [], 0
    for part in windows(record):
        moving = gusts[begin : begin + part.rho.size] if gusts.size else gusts
        start = start_read_alike(part, path[begin], model)
        found.append((part, np.nan_to_num(free_run(part, start, model, moving))))
        begin += part.length
    return found


def _gusts(record: Record, start: Array, air: Turbulence, generator: np.random.Generator) -> Array:
    """(M, 3) gusts in body axes at every sample of the commands; (0, 3) for still air."""
    if air.calm:
        return STILL_AIR
    speed = float(np.linalg.norm(start[:3]))
    unit = dryden_gusts(
        record.rho.size, record.interval_s, sigma=1.0, length=air.length, airspeed=speed, generator=generator
    )
    return np.ascontiguousarray(unit * [air.horizontal, air.horizontal, air.vertical])


def noise_floor(
    records: Sequence[Record],
    starts: Sequence[Array],
    layout: SensorMounting,
    model: Fixed,
    sigma: Array,
    thrust_sigma: float,
    air: Turbulence,
    generator: np.random.Generator,
    repeats: int = 9,
) -> dict[str, float]:
    """Median gap of the model on data generated from itself with the estimated noise.

    A model that diverges over the whole run flies it window by window, from the motion measured at their beginnings.

    Parameters
    ----------
    records : Sequence of Record
        Runs to generate data for.
    starts : Sequence of Array, shape (9,) each
        Initial state of each run: u, v, w, m/s, p, q, r, rad/s, phi, theta, psi, rad.
    layout : SensorMounting
        Where the sensors sit and what they read.
    model : Fixed
        Model with nothing left free.
    sigma : Array, shape (15,)
        Standard deviation of the noise of OUTPUTS, each in its output's unit; NaN counts as 0.
    thrust_sigma : float
        Standard deviation of the thrust's noise, N.
    air : Turbulence
        Turbulence of the air: intensities, m/s, and scale length, m.
    generator : np.random.Generator
        Source of the random numbers.
    repeats : int
        Number of times that data are generated.

    Returns
    -------
    dict of str to float
        Name of the output, V for the airspeed -> median over the repeats of the root mean square of its residuals over
        all windows, in its unit.
    """
    found: list[dict[str, float]] = []
    for _ in range(repeats):
        made = []
        for record, start in zip(records, starts, strict=True):
            gusts = _gusts(record, start, air, generator)
            for part, y in _flown_by(model, record, start, layout, gusts):
                noise = generator.standard_normal(y.shape) * np.nan_to_num(sigma)
                z = np.where(np.isfinite(part.z), y + noise, np.nan)
                thrust = part.thrust + thrust_sigma * generator.standard_normal(part.thrust.size)
                made.append(Record(**{**part.__dict__, "z": z, "thrust": thrust}))
        found.append(gap(made, layout, model))
    return {name: float(np.median([one[name] for one in found])) for name in found[0]}

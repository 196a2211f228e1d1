"""Manoeuvres timed to the modes of a model and sized to what the aircraft may do.

Timing: a doublet of pulse width w has the peak of its spectrum at 2.33 / w rad/s, a 3-2-1-1 of unit w the centre of
its energy at 1.76 / w (from their Fourier transforms; half power from 0.28 / w to 2.65 / w). Sizes: the plan is flown
in the simulator without noise, and made larger or smaller until the first limit is just kept.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.errors import FlightError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.multisine import optimised_phases, relative_peak_factor, synthesise
from sim_vehicle.manoeuvres.plan import RECOVERY_S, Plan
from sim_vehicle.manoeuvres.shapes import SURFACES, Segment, check, manoeuvre, shape_of
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.design.multisine_spectrum import Limits, flat_amplitudes, optimal_amplitudes, prior_linear
from sysid.design.prediction import structure_of
from sysid.design.simulated_flight import RATE_HZ, channel_noise, rehearse
from sysid.errors import EstimationError
from sysid.identification.linear_model import LinearModel

SPECTRA = ("flat", "d-optimal")
DOUBLET_PEAK, CENTRE_3211 = 2.33, 1.76  # rad/s times the unit width
# Shapes that are timed and sized; the others are flown as they are.
TUNED = ("pulse", "doublet", "3211", "multisine")
LONGEST_S = 20.0  # of one manoeuvre: as long as one free run of the estimate
_QUIET_S = 2.0  # of a multisine's duration without excitation: 1 s before it and 1 s after
_BAND = 1.6  # highest frequency over that of the mode
_SHORTEST_S = 0.2  # pulse width that servos follow
_LOWEST_HZ = 0.1
_SAMPLES_PER_CYCLE = 10.0
_FEWEST = 4  # harmonics of one axis
_STEPS = 4
_MARGIN = 0.97
_TRAVEL = 0.8  # of the way from trim to a surface's stop


def tuned_plan(
    vehicle: Vehicle,
    model: Model,
    names: Sequence[str],
    *,
    limits: Limits | None = None,
    spectrum: str = "flat",
    duration: float | None = None,
    structure: Model | None = None,
    rate_hz: float = RATE_HZ,
) -> Plan:
    """The named manoeuvres, timed and sized, with 5 s of recovery between them.

    limits: how far they may go, None for the usual ones. spectrum: "flat" or "d-optimal", of multisines. duration: s,
    of the whole plan, which is repeated or cut; a multisine alone is stretched to it, up to 20 s.
    Raises EstimationError, SimVehicleError in one line.
    """
    if spectrum not in SPECTRA:
        raise EstimationError(f"no spectrum {spectrum!r}; there are {', '.join(SPECTRA)}")
    limits = limits or Limits()
    flight = vehicle.flight
    density = Plant(vehicle, model).density(flight.altitude)
    linear = prior_linear(vehicle, model, structure_of(vehicle, structure), flight.airspeed, density)
    segments: list[Segment] = []
    for name in names:
        segment = manoeuvre(name)
        if shape_of(name) in TUNED and set(segment.axes) <= set(SURFACES):
            if shape_of(name) == "multisine":
                length = min(duration or segment.duration, LONGEST_S) - _QUIET_S
                segment = multisine(vehicle, linear, segment, length, limits, spectrum, rate_hz)
            else:
                segment = timed(segment, linear, rate_hz)
            segment = sized(vehicle, model, segment, limits)
        if segments and "cruise" not in (name, segments[-1].manoeuvre):
            segments.append(manoeuvre("cruise", duration=RECOVERY_S))
        segments.append(segment)
    plan = Plan(tuple(segments))
    return plan if duration is None else plan.fitted(duration)


def mode_frequencies(linear: LinearModel) -> dict[str, float]:
    """What each surface is to excite, rad/s: short period, roll and Dutch roll; absent where there is no such mode."""
    modes = linear.modes()
    wanted = {"elevator": "short period", "aileron": "roll", "rudder": "Dutch roll"}
    found = {}
    for axis, name in wanted.items():
        sizes = [abs(mode.eigenvalue) for mode in modes if mode.name.split(",")[0] == name]
        if sizes:
            found[axis] = math.exp(sum(map(math.log, sizes)) / len(sizes))
    return found


def timed(segment: Segment, linear: LinearModel, rate_hz: float = RATE_HZ) -> Segment:
    """A pulse, doublet or 3-2-1-1 whose spectrum lies on the mode it is to excite; whole samples wide."""
    mode = mode_frequencies(linear).get(segment.axes[0])
    if mode is None or shape_of(segment.manoeuvre) == "pulse":
        return segment
    factor = CENTRE_3211 if shape_of(segment.manoeuvre) == "3211" else DOUBLET_PEAK
    width = max(factor / mode, _SHORTEST_S)
    return replace(segment, width=max(1, round(width * rate_hz)) / rate_hz)


def band_harmonics(
    axes: Sequence[str], linear: LinearModel, length: float, rate_hz: float = RATE_HZ
) -> dict[str, tuple[int, ...]]:
    """Disjoint harmonics of 1 / `length` for each axis, in even combs up to a little above the axis' mode.

    Even combs, since irregular ones have no phases of small peak factor.
    """
    modes = mode_frequencies(linear)
    most = rate_hz / _SAMPLES_PER_CYCLE
    high = {axis: min(_BAND * modes.get(axis, 2.0 * math.pi) / (2.0 * math.pi), most) for axis in axes}
    first = max(1, math.ceil(_LOWEST_HZ * length - 1e-9))
    found = {
        axis: list(range(first + place, math.floor(high[axis] * length) + 1, len(axes)))
        for place, axis in enumerate(axes)
    }
    short = [axis for axis, numbers in found.items() if len(numbers) < _FEWEST]
    if short:
        raise EstimationError(f"{length:g} s are too short for a multisine of {short[0]}; give a longer --duration")
    return {axis: tuple(numbers) for axis, numbers in found.items()}


def multisine(
    vehicle: Vehicle,
    linear: LinearModel,
    segment: Segment,
    length: float,
    limits: Limits,
    spectrum: str = "flat",
    rate_hz: float = RATE_HZ,
) -> Segment:
    """An orthogonal multisine in the band of the modes, with phases of small peak factor and sizes to begin with."""
    axes = [axis for axis in segment.axes if axis in vehicle.controls]
    if not axes or length <= 0.0:
        raise EstimationError(f"{segment.manoeuvre}: no surface to move, or no time to; check vehicle and --duration")
    harmonics = band_harmonics(axes, linear, length, rate_hz)
    if spectrum == "flat":
        amplitudes = flat_amplitudes(linear, harmonics, length, limits)
        weights: dict[str, tuple[float, ...]] = {}
    else:
        noise, samples = channel_noise(vehicle), round(length * rate_hz)
        amplitudes = optimal_amplitudes(linear, harmonics, length, limits, noise, samples)
        weights = {axis: tuple((row / row.max()).tolist()) for axis, row in amplitudes.items()}
    phases = {axis: optimised_phases(harmonics[axis], weights.get(axis, ())) for axis in axes}
    peaks = {
        axis: float(amplitudes[axis].max()) * _half_travel(harmonics[axis], phases[axis], weights.get(axis))
        for axis in axes
    }
    shaped = replace(
        segment, axes=tuple(axes), duration=length + _QUIET_S, length=length, harmonics=harmonics, phases=phases,
        weights=weights, amplitudes=peaks, amplitude=max(peaks.values()),
        low=min(min(numbers) for numbers in harmonics.values()) / length,
        high=max(max(numbers) for numbers in harmonics.values()) / length,
    )  # fmt: skip
    check(shaped)
    return shaped


def _half_travel(harmonics: Sequence[int], phases: Sequence[float], weights: Sequence[float] | None) -> float:
    """Half the travel of a multisine whose largest harmonic has amplitude 1."""
    wave = _period(harmonics, phases, weights)
    return float(0.5 * (wave.max() - wave.min()))


def _period(harmonics: Sequence[int], phases: Sequence[float], weights: Sequence[float] | None) -> Array:
    time = np.linspace(0.0, 1.0, 64 * max(harmonics), endpoint=False)
    return synthesise(harmonics, phases, time, 1.0, weights)


def peak_factors(plan: Plan) -> dict[str, float]:
    """Largest relative peak factor of each axis over the plan's multisines."""
    found: dict[str, float] = {}
    for segment in plan.segments:
        if shape_of(segment.manoeuvre) != "multisine":
            continue
        for axis in segment.axes:
            numbers, weights = segment.harmonic_set(axis), segment.weights.get(axis, ())
            phases = segment.phases.get(axis) or optimised_phases(numbers, weights)
            factor = relative_peak_factor(_period(numbers, phases, weights or None))
            found[axis] = max(factor, found.get(axis, 0.0))
    return found


def sized(vehicle: Vehicle, model: Model, segment: Segment, limits: Limits) -> Segment:
    """The segment as large as the limits allow, by flying it alone without noise."""
    room = _room(vehicle, model, limits)
    segment = _within(segment, {axis: min(1.0, room[axis] / _peak(segment, axis)) for axis in segment.axes})
    for _ in range(_STEPS):
        reached = _reached(vehicle, model, segment, limits)
        factors = {}
        for axis in segment.axes:
            longitudinal = axis == "elevator"
            used = reached[0 if longitudinal else 1]
            alone = len(segment.axes) == 1
            used = max(used, reached[1 if longitudinal else 0]) if alone else used
            factors[axis] = min(_MARGIN / max(used, 0.1), room[axis] / _peak(segment, axis))
        if all(0.95 <= factor <= 1.05 for factor in factors.values()):
            break
        segment = _within(segment, factors)
    reached = _reached(vehicle, model, segment, limits)
    return _within(segment, dict.fromkeys(segment.axes, min(1.0, _MARGIN / max(*reached, _MARGIN))))


def _room(vehicle: Vehicle, model: Model, limits: Limits) -> dict[str, float]:
    """Largest amplitude of each surface, rad: the limit, and a share of the way from trim to its nearer stop."""
    command = Plant(vehicle, model).trim().command
    found = {}
    for j, axis in enumerate(SURFACES):
        low, high = vehicle.controls[axis].limits if axis in vehicle.controls else (0.0, 0.0)
        found[axis] = min(limits.surface, _TRAVEL * min(high - command[j], command[j] - low))
    return found


def _peak(segment: Segment, axis: str) -> float:
    return segment.amplitudes.get(axis, segment.amplitude)


def _within(segment: Segment, factors: Mapping[str, float]) -> Segment:
    """The segment with each axis' amplitude multiplied."""
    if not segment.amplitudes:
        return replace(segment, amplitude=segment.amplitude * min(factors.values()))
    peaks = {axis: peak * factors[axis] for axis, peak in segment.amplitudes.items()}
    return replace(segment, amplitudes=peaks, amplitude=max(peaks.values()))


def _reached(vehicle: Vehicle, model: Model, segment: Segment, limits: Limits) -> tuple[float, float]:
    """Shares of the limits that (longitudinal, lateral) motion takes up; 2 where the aircraft goes out of control."""
    try:
        _, flown = rehearse(vehicle, model, Plan((segment,)), seed=0, noise="none")
    except FlightError:
        return 2.0, 2.0
    allowed = limits.of_outputs(float(flown.truth["V"][0]))
    share = {
        name: float(np.max(np.abs(flown.truth[name] - flown.truth[name][0]))) / limit for name, limit in allowed.items()
    }
    return max(share["alpha"], share["V"], share["theta"]), max(share["beta"], share["phi"])

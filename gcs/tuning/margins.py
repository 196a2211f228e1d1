"""How much an autopilot's loops can bear: margins, bandwidth, rejection of gusts, and by how much each gain may grow.

Definitions: gain and phase margin as in python-control's `stability_margins`; bandwidth where the answer to a demanded
angle has fallen by 3 dB; sensitivity 1 / (1 + L). The factor by which one gain may grow is where 1 + L reaches 0 with
the others as they are. 95 % intervals are those of models drawn from the joint error of the estimates, each with servos
drawn from what is known of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.aircraft import aircraft_of, well_formed
from gcs.errors import ExportError
from gcs.exports.exported import Exported
from gcs.exports.samples import drawn
from gcs.flights.autopilot_settings import filled, parameters_of
from gcs.flights.streams import sender_of
from gcs.recording.reader import Recording
from gcs.tuning.handling import handling
from gcs.tuning.loops import AXES, GAINS, Controller, OpenLoop, along, autopilot_of, controller, open_loop
from gcs.tuning.travel import full_travel, range_warnings
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.model_file import Model, model_from_json
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.arrays import Array
from sysid.identification.linear_model import Complex, linearise
from sysid.posterior.nuisance_priors import PRIORS
from sysid.uncertainty.bench_errors import is_of_travel

SAMPLES = 100
FREQUENCY_HZ: Array = np.geomspace(0.02, 25.0, 1200)
# Motion that grows by less a second is no instability: a spiral that a pilot does not see. The path beside the
# imaginary axis, rad/s.
_GROWS = 0.02
_BESIDE: Complex = np.asarray(_GROWS + 1j * np.concatenate([[0.0], np.geomspace(1e-4, 300.0, 1500)]))
# Of a curve for a picture.
_SHOWN = 12
_GROUP = {"roll": "lateral", "pitch": "longitudinal"}
_CONTROL = {"roll": "aileron", "pitch": "elevator"}
# Of the states, those of each axis.
_BLOCK = {"roll": slice(4, 8), "pitch": slice(0, 4)}
# Share of the models drawn that must fly, else a warning says how many do not.
_MOST_DRAWN = 0.95
# A limit beyond so many times a gain is none.
_MOST = 100.0
_UNITS = {
    "gain_margin": "dB", "phase_margin": "deg", "delay_margin": "ms", "crossover": "Hz", "oscillation": "Hz",
    "bandwidth": "Hz", "rejection": "Hz", "peak_sensitivity": "dB",
}  # fmt: skip


@dataclass(frozen=True)
class _Loop:
    """A loop cut open, and whether it is stable closed."""

    open: OpenLoop
    stable: bool


def margins(
    result: Any,
    vehicle: str | None = None,
    parameters: Mapping[str, float] | None = None,
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> dict[str, Any]:
    """The sheet of a result of gcs identify; the JSON of schema margins/1.

    vehicle: a vehicle file in place of the one that the result holds. parameters: those of another log. Raises
    SettingsError, ExportError or SimVehicleError in one line.
    """
    with well_formed(result):
        return _margins(result, vehicle, parameters, progress)


def _margins(
    result: Any,
    vehicle: str | None,
    parameters: Mapping[str, float] | None,
    progress: Callable[[float, str], None],
) -> dict[str, Any]:
    craft, kept, _ = aircraft_of(result)
    now = kept if parameters is None else parameters
    craft = craft if vehicle is None else filled(load_vehicle(vehicle), now)
    model = Exported(model_from_json(result["model"], "the result's model"), craft)
    space = result.get("state_space") or {}
    speed = float(space.get("airspeed") or craft.flight.airspeed)
    rho = float(space.get("air_density") or SEA_LEVEL_DENSITY)
    autopilot = autopilot_of(now)
    warnings = [*craft.warnings, *range_warnings(craft, autopilot, now)]
    try:
        others = drawn(model, SAMPLES, without=is_of_travel)
    except ExportError as error:
        others = []
        warnings.append(f"no intervals: {error}")
    random = np.random.default_rng(4)
    loops: dict[str, Any] = {}
    refused: list[dict[str, str]] = []
    for number, axis in enumerate(AXES):
        made = controller(axis, now, speed * math.sqrt(rho / SEA_LEVEL_DENSITY), math.sqrt(SEA_LEVEL_DENSITY / rho))
        full = full_travel(craft, _CONTROL[axis], autopilot, now)
        why = _refusal(axis, model.model, full, made)
        if why or isinstance(made, str) or isinstance(full, str):
            refused.append({"name": axis, "refused": why})
            continue
        block = _BLOCK[axis]
        servo = _servo(result, craft, axis)

        def loop(
            one: Exported,
            delay: float,
            lag: float,
            axis: str = axis,
            made: Controller = made,
            full: float = full,
            block: slice = block,
        ) -> _Loop:
            system = linearise(one.vehicle, _bare(one.model), speed, rho).system
            travel = math.copysign(full, _sense(axis, one.model))

            def at(s: Complex) -> OpenLoop:
                return open_loop(axis, system, made, travel, delay, lag, s)

            # Modes of the other axes are not in the loop.
            grows = int(np.count_nonzero(np.linalg.eigvals(system.A[block, block]).real > _GROWS))
            return _Loop(at(along(FREQUENCY_HZ)), is_stable(at(_BESIDE).total, grows))

        best = loop(model, servo[0][0], servo[1][0])
        spread = []
        for k, one in enumerate(others):
            progress((number + (k + 1.0) / len(others)) / len(AXES), f"models drawn from the errors, {axis}")
            delay, lag = (max(mean + std * float(random.standard_normal()), 0.0) for mean, std in servo)
            try:
                spread.append(loop(one, delay, lag))
            except SimVehicleError:
                continue
        if len(spread) < _MOST_DRAWN * len(others):
            warnings.append(
                f"{axis}: {len(others) - len(spread)} of {len(others)} models drawn cannot fly level, and count nowhere"
            )
        loops[axis] = _sheet(best, spread, made)
        share = loops[axis]["stable_share"]
        if not best.stable:
            warnings.append(f"the {axis} loop is unstable by this model: its margins say nothing, lower its gains")
        elif share is not None and share < 1.0:
            warnings.append(f"the {axis} loop is unstable by {1.0 - share:.0%} of the models that the flight allows")
        loops[axis]["servo"] = {
            name: {"value": mean, "std": std, "unit": "s"}
            for name, (mean, std) in zip(("delay", "lag"), servo, strict=True)
        }
    doubtful = model.model.not_identified()
    if doubtful:
        warnings.append(f"not identified, and flown by the mean of a refused estimate: {', '.join(doubtful)}")
    return {
        "schema": "margins/1", "autopilot": autopilot, "vehicle": craft.name, "model": model.model.name,
        "airspeed": speed, "air_density": rho, "loops": loops, "refused": refused,
        "handling": handling(result.get("modes") or [], craft.geometry.b), "warnings": warnings,
    }  # fmt: skip


def parameters_in(path: Path, system: int | None = None) -> dict[str, float]:
    """The autopilot's parameters of a recording. Raises GcsError in one line."""
    recording = Recording(path)
    return parameters_of(recording, sender_of(recording, system).system)[0]


def _refusal(axis: str, model: Model, full: float | str, made: Controller | str) -> str:
    """Why nothing is said of an axis, "" where it is."""
    if isinstance(made, str):
        return made
    needed = {"roll": ("Cl_p", "Cl_da"), "pitch": ("Cm_alpha", "Cm_q", "Cm_de", "CL_alpha")}[axis]
    values, doubtful = model.values(), {*model.not_identified(), *model.unknown()}
    if missing := [name for name in needed if name not in values or name in doubtful]:
        return f"the flight does not show {', '.join(missing)}"
    return full if isinstance(full, str) else ""


def _bare(model: Model) -> Model:
    """The model without errors, of which the state space alone is wanted."""
    return replace(model, coefficients={n: replace(one, std=None) for n, one in model.coefficients.items()})


def _sense(axis: str, model: Model) -> float:
    """The way in which a deflection rolls right or pitches up: the autopilot's, or it could not fly."""
    return model.values()["Cl_da" if axis == "roll" else "Cm_de"]


def _servo(result: Mapping[str, Any], craft: Vehicle, axis: str) -> list[tuple[float, float]]:
    """Delay and lag of the axis' servo, s, each with its standard error: as estimated, else as the vehicle file says,
    else what is usual.
    """
    found = {one["name"]: one for one in result.get("nuisances") or [] if one.get("group") == _GROUP[axis]}
    control = craft.controls[_CONTROL[axis]]
    servo = []
    for key, known in (("servo_delay", control.delay), ("servo_lag", control.lag)):
        if key in found:
            servo.append((float(found[key]["value"]), float(found[key]["std"])))
        elif known.value is not None:
            servo.append((known.value, known.std or 0.0))
        else:
            servo.append(next((one.mean, one.std) for one in PRIORS if one.name == key))
    return servo


def is_stable(total: Complex, grows: int) -> bool:
    """Nyquist's criterion along a path from the real axis up, a little to the right of the imaginary one.

    total: (N,) return ratio. grows: how many of its poles lie to the right of the path.
    """
    turned = np.unwrap(np.angle(1.0 + total))
    return grows - round(float(turned[-1] - turned[0]) / math.pi) == 0


def _sheet(given: _Loop, drawn_: list[_Loop], made: Controller) -> dict[str, Any]:
    """Figures of a loop with their intervals, and its curve; intervals are those of the models that are stable."""
    best, spread = given.open, [one.open for one in drawn_ if one.stable]
    figures: dict[str, float | None] = _figures(best) if given.stable else dict.fromkeys(_UNITS)
    spread = spread if given.stable else []
    every = [_figures(one) for one in spread]
    entries = {name: _entry(value, [one[name] for one in every], _UNITS[name]) for name, value in figures.items()}
    limits = {
        name: {
            "parameter": made.names[name], "now": made.gains[name],
            "may_grow": _entry(grown[0], [limit(one, name)[0] for one in spread], "1"),
            "oscillation": grown[1],
        }
        for name in GAINS
        if made.gains[name] > 0.0
        for grown in (limit(best, name) if given.stable else (None, None),)
    }  # fmt: skip
    L = best.total[::_SHOWN]
    curve = {
        "frequency_hz": best.frequency_hz[::_SHOWN].tolist(),
        "gain_db": (20.0 * np.log10(np.abs(L))).tolist(),
        "phase_deg": np.degrees(np.unwrap(np.angle(L))).tolist(),
    }
    share = float(np.mean([one.stable for one in drawn_])) if drawn_ else None
    return {**entries, "stable": given.stable, "stable_share": share, "gains": limits, "curve": curve}


def _entry(value: float | None, others: list[float | None], unit: str) -> dict[str, Any]:
    """Value and 95 % interval; a figure that some models do not have has an open end."""
    entry: dict[str, Any] = {"value": value, "unit": unit}
    if others:
        ends = np.array([math.inf if one is None else one for one in others])
        low, high = np.quantile(ends, (0.025, 0.975), method="nearest")
        entry["interval"] = [float(one) if math.isfinite(one) else None for one in (low, high)]
    return entry


def _crossings(values: Array, x: Array) -> list[tuple[float, float]]:
    """Where values change sign: place in the samples and x there, on a line between samples."""
    sign = np.signbit(values)
    found = []
    for i in np.flatnonzero(sign[1:] != sign[:-1]):
        share = float(values[i] / (values[i] - values[i + 1]))
        found.append((float(i) + share, float(x[i] + share * (x[i + 1] - x[i]))))
    return found


def _at(values: Array, place: float) -> float:
    return float(np.interp(place, np.arange(values.size), values))


def _figures(loop: OpenLoop) -> dict[str, float | None]:
    """The figures of one loop, None for one that it does not have."""
    L, hz = loop.total, loop.frequency_hz
    gain = 20.0 * np.log10(np.abs(L))
    # Where the imaginary part is 0 and the real one negative a factor alone leads to -1.
    turned = [(p, f) for p, f in _crossings(L.imag, np.log(hz)) if _at(L.real, p) < 0.0]
    up = [(-_at(gain, p), math.exp(f)) for p, f in turned if _at(gain, p) < 0.0]
    margin, oscillation = min(up) if up else (None, None)
    phases = np.degrees(np.unwrap(np.angle(L)))
    crossed = [((_at(phases, p)) % 360.0, math.exp(f)) for p, f in _crossings(gain, np.log(hz))]
    # Distance from -180 deg, which is 180 modulo 360.
    spare = [(abs(phase - 180.0), phase - 180.0, f) for phase, f in crossed]
    phase, _, crossover = min(spare) if spare else (None, None, None)
    # A delay turns by 360 f T: until the phase, from above, meets -180 deg.
    delays = [(turn % 360.0) / 360.0 / f * 1e3 for _, turn, f in spare]
    closed = 20.0 * np.log10(np.abs(loop.forward / (1.0 + L)))
    fallen = [math.exp(f) for p, f in _crossings(closed - closed[0] + 3.0, np.log(hz))]
    sensitivity = -20.0 * np.log10(np.abs(1.0 + L))
    risen = [math.exp(f) for _, f in _crossings(sensitivity + 3.0, np.log(hz))]
    return {
        "gain_margin": margin, "oscillation": oscillation, "phase_margin": phase, "crossover": crossover,
        "delay_margin": min(delays) if delays else None, "bandwidth": fallen[0] if fallen else None,
        "rejection": risen[0] if risen else None, "peak_sensitivity": float(np.max(sensitivity)),
    }  # fmt: skip


def limit(loop: OpenLoop, name: str) -> tuple[float | None, float | None]:
    """By which factor a gain may grow until the loop oscillates, and at which frequency, Hz; None where by none."""
    part: Complex = loop.parts[name]
    ratio = -(1.0 + loop.total - part) / part
    found = []
    for place, at in _crossings(ratio.imag, np.log(loop.frequency_hz)):
        factor = _at(ratio.real, place)
        if 1.0 < factor < _MOST:
            found.append((factor, math.exp(at)))
    return min(found) if found else (None, None)


_WORDS = {
    "gain_margin": "gain margin", "phase_margin": "phase margin", "delay_margin": "delay margin",
    "crossover": "crossover", "oscillation": "oscillates at", "bandwidth": "bandwidth of the angle",
    "rejection": "rejects disturbances below", "peak_sensitivity": "peak of the sensitivity",
}  # fmt: skip


def margins_text(found: Mapping[str, Any]) -> str:
    """The sheet as lines."""
    lines = [f"{found['vehicle']}, {found['autopilot']}, at {found['airspeed']:.1f} m/s"]
    for axis, loop in found["loops"].items():
        lines += ["", f"{axis}:" if loop["stable"] else f"{axis}: UNSTABLE"]
        if not loop["stable"]:
            continue
        for name, words in _WORDS.items():
            entry = loop[name]
            lines.append(f"  {words:<28}{_figure(entry):>8} {entry['unit']:<4}{_between(entry)}".rstrip())
        for one in loop["gains"].values():
            entry = one["may_grow"]
            if entry["value"] is None:
                lines.append(f"  {one['parameter']} ({one['now']:.4g}): no factor makes the loop oscillate")
                continue
            lines.append(
                f"  {one['parameter']} ({one['now']:.4g}) may grow {entry['value']:.3g} times before {axis} oscillates"
                f" (at {one['oscillation']:.2g} Hz){_between(entry)}"
            )
    lines += [f"{one['name']}: {one['refused']}" for one in found["refused"]]
    if found["handling"]:
        lines += ["", "modes against MIL-F-8785C, scaled to its size:"]
    for one in found["handling"]:
        lines.append(
            f"  {one['mode']:<14}{one['quantity']:<16}{one['value']:>9.3g} {one['unit']:<4}level {one['level']}"
        )
    return "\n".join([*lines, *(f"warning: {one}" for one in found["warnings"])])


def _figure(entry: Mapping[str, Any]) -> str:
    return "-" if entry["value"] is None else f"{entry['value']:.3g}"


def _between(entry: Mapping[str, Any]) -> str:
    if "interval" not in entry:
        return ""
    low, high = ("beyond" if one is None else f"{one:.3g}" for one in entry["interval"])
    return f"  95 %: {low} … {high}"

"""A planned flight and what it can identify, as JSON of schema design/1 and as a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gcs.errors import SettingsError
from sim_vehicle.cli.options import UsageError, read_settings
from sim_vehicle.errors import PlanError
from sim_vehicle.manoeuvres.plan import Plan, plan_of, read_plan
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.design import Expected, Prediction, predict
from sysid.design.manoeuvre_sizing import peak_factors, tuned_plan
from sysid.design.multisine_spectrum import Limits
from sysid.design.simulated_flight import RATE_HZ
from sysid.identification.linear_model import linearise

Progress = Callable[[float, str], None]

# `--limit NAME=VALUE` -> what the number is multiplied by: degrees, percent.
LIMITS = {
    "alpha": math.radians(1.0), "beta": math.radians(1.0), "bank": math.radians(1.0), "pitch": math.radians(1.0),
    "surface": math.radians(1.0), "airspeed": 0.01,
}  # fmt: skip
_LARGEST_LIMIT = 90.0
_RATES_HZ = (10.0, 400.0)
_LONGEST_S = 3600.0
_SHORTEST_S = 4.0
# Rows of the comparison: its name, the manoeuvres, and the spectrum of a multisine.
CANDIDATES = (
    ("doublets", ("elevator-doublet", "aileron-doublet", "rudder-doublet"), "flat"),
    ("3-2-1-1", ("elevator-3211", "aileron-3211", "rudder-3211"), "flat"),
    ("multisine", ("multisine",), "flat"),
    ("multisine, d-optimal", ("multisine",), "d-optimal"),
)
COMPARED = ("CL_alpha", "CL_de", "CD_0", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r",
            "Cn_dr")  # fmt: skip


def _silent(share: float, text: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Request:
    """What is asked of a design.

    manoeuvres: names. tune: whether they are timed and sized to the model. plan: a plan file instead. duration: s, or
    None for the manoeuvres' own. settings: NAME=VALUE texts as of `sim-vehicle fly --set`. limits: NAME=VALUE texts.
    rate_hz: samples per second. without: sensors the aircraft lacks. gusts: turbulence, 1 sigma, m/s.
    """

    manoeuvres: Sequence[str] = ("multisine",)
    tune: bool = True
    plan: Path | None = None
    spectrum: str = "flat"
    duration: float | None = None
    settings: Sequence[str] = ()
    limits: Sequence[str] = ()
    rate_hz: float = RATE_HZ
    without: Collection[str] = ()
    gusts: float = 0.0
    structure: Model | None = None


@dataclass(frozen=True)
class Design:
    """A plan, what it can identify, and the vehicle and model it is for, settings applied."""

    vehicle: Vehicle
    model: Model
    plan: Plan
    prediction: Prediction
    result: dict[str, Any] = field(repr=False)

    def plan_json(self) -> dict[str, Any]:
        """The plan file: what `sim-vehicle fly --plan` flies, with the design beside it."""
        beside = {key: value for key, value in self.result.items() if key != "plan"}
        return {**self.plan.to_json(), "design": beside}


def design(vehicle: Vehicle, model: Model, request: Request, progress: Progress = _silent) -> Design:
    """Make the plan asked for and predict what it can identify.

    Raises SettingsError for a request that cannot be meant; SysidError and SimVehicleError for what cannot be flown.
    """
    vehicle, model, manoeuvre_settings = _settled(vehicle, model, request)
    progress(0.0, "making the plan")
    plan = _plan(vehicle, model, request, manoeuvre_settings)
    progress(0.4, "predicting")
    prediction = _predicted(vehicle, model, plan, request)
    return Design(vehicle, model, plan, prediction, _result(vehicle, model, plan, prediction, request))


def compare(
    vehicle: Vehicle, model: Model, request: Request, durations: Sequence[float], progress: Progress = _silent
) -> list[dict[str, Any]]:
    """What each usual manoeuvre, tuned, would identify in each duration, s: one row each, best first within a duration.

    A row's `score` is the geometric mean of standard errors over usual sizes: half of it is twice as good.
    """
    vehicle, model, _ = _settled(vehicle, model, request)
    limits = read_limits(request.limits)
    rows = []
    for number, duration in enumerate(durations):
        found = []
        for place, (name, names, spectrum) in enumerate(CANDIDATES):
            share = (number + place / len(CANDIDATES)) / len(durations)
            progress(share, f"{name}, {duration:g} s")
            flyable = [n for n in names if n == "multisine" or n.partition("-")[0] in vehicle.controls]
            plan = tuned_plan(
                vehicle, model, flyable, limits=limits, spectrum=spectrum, duration=duration,
                structure=request.structure, rate_hz=request.rate_hz,
            )  # fmt: skip
            found.append(_candidate(name, plan, _predicted(vehicle, model, plan, request)))
        rows += sorted(found, key=lambda row: float(row["score"]))
    return rows


def _candidate(name: str, plan: Plan, prediction: Prediction) -> dict[str, Any]:
    quantities = {entry.name: entry for entry in prediction.coefficients}
    errors = {n: {"std": e.std, "percent": e.percent} for n, e in quantities.items()}
    return {
        "name": name,
        "duration_s": plan.duration,
        "manoeuvres": [segment.manoeuvre for segment in plan.segments],
        "estimated": len(quantities),
        "refused": len(prediction.missing),
        "score": prediction.score,
        "coefficients": errors,
    }


def _predicted(vehicle: Vehicle, model: Model, plan: Plan, request: Request) -> Prediction:
    return predict(
        vehicle, model, plan, structure=request.structure, rate_hz=request.rate_hz, without=request.without,
        gusts=request.gusts,
    )  # fmt: skip


def _settled(vehicle: Vehicle, model: Model, request: Request) -> tuple[Vehicle, Model, Mapping[str, float]]:
    """Vehicle, model and the manoeuvres' settings with `--set` applied; the request's numbers checked."""
    low, high = _RATES_HZ
    if not low <= request.rate_hz <= high:
        raise SettingsError(f"--rate {request.rate_hz:g}: give {low:g} to {high:g} Hz")
    if request.duration is not None and not _SHORTEST_S <= request.duration <= _LONGEST_S:
        raise SettingsError(f"--duration {request.duration:g}: give {_SHORTEST_S:g} to {_LONGEST_S:g} s")
    if not 0.0 <= request.gusts <= 5.0:
        raise SettingsError(f"--gusts {request.gusts:g}: give the turbulence's standard deviation, 0 to 5 m/s")
    try:
        settings = read_settings(request.settings)
    except UsageError as error:
        raise SettingsError(str(error)) from None
    if settings.sensors:
        raise SettingsError("--set sensors: the sensors' noise stands in the vehicle file, under [sensors]")
    for name, value in settings.coefficients.items():
        model = model.with_coefficient(name, value)
    if unknown := model.unknown():
        demand = " ".join(f"--set {name}=VALUE" for name in unknown)
        raise SettingsError(f"the model has no value for {', '.join(unknown)}; give {demand}")
    return replace(vehicle, flight=replace(vehicle.flight, **settings.flight)), model, settings.manoeuvre


def read_limits(texts: Sequence[str]) -> Limits:
    """Limits from NAME=VALUE texts, degrees and percent. Raises SettingsError."""
    found = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if name not in LIMITS or not 0.0 < value <= _LARGEST_LIMIT:
            raise SettingsError(f"--limit {text}: give NAME=DEGREES (airspeed: percent) of {', '.join(LIMITS)}")
        found[name] = value * LIMITS[name]
    return Limits(**found)


def _plan(vehicle: Vehicle, model: Model, request: Request, settings: Mapping[str, float]) -> Plan:
    try:
        if request.plan is not None:
            plan = read_plan(request.plan).with_settings(settings)
        elif request.tune:
            if settings:
                raise SettingsError("--set manoeuvre: a manoeuvre that is tuned finds its own; leave out --tune")
            return tuned_plan(
                vehicle, model, request.manoeuvres, limits=read_limits(request.limits), spectrum=request.spectrum,
                duration=request.duration, structure=request.structure, rate_hz=request.rate_hz,
            )  # fmt: skip
        else:
            plan = plan_of(request.manoeuvres).with_settings(settings)
        return plan if request.duration is None else plan.fitted(request.duration)
    except PlanError as error:
        if request.plan is not None:
            raise
        raise SettingsError(str(error)) from None


def _result(vehicle: Vehicle, model: Model, plan: Plan, prediction: Prediction, request: Request) -> dict[str, Any]:
    manoeuvres = {refusal.name: refusal.manoeuvre for refusal in prediction.refused}
    reasons = {refusal.name: refusal.reason for refusal in prediction.refused}
    modes = linearise(vehicle, model, prediction.trim["V"], prediction.density).modes()
    return {
        "schema": "design/1",
        "vehicle": vehicle.name,
        "model": model.name,
        "plan": plan.to_json(),
        "duration_s": plan.duration,
        "rate_hz": request.rate_hz,
        "gusts": request.gusts,
        "without": sorted(request.without),
        "coefficients": [_entry(entry) for entry in prediction.coefficients],
        "sensor_errors": [_entry(entry) for entry in prediction.sensor_errors],
        "refused": [{"name": n, "reason": reasons[n], "manoeuvre": manoeuvres[n]} for n in reasons],
        "score": prediction.score,
        "trim": dict(prediction.trim),
        "excursions": {name: list(reach) for name, reach in prediction.excursions.items()},
        "peak_factors": peak_factors(plan),
        "modes": [mode.to_json() for mode in modes],
        "warnings": [*vehicle.warnings, *prediction.warnings],
    }


def _entry(entry: Expected) -> dict[str, Any]:
    found: dict[str, Any] = {"name": entry.name, "value": entry.value, "std": entry.std, "percent": entry.percent,
                             "unit": entry.unit}  # fmt: skip
    if entry.partner is not None:
        found["correlated"] = {"with": entry.partner[0], "correlation": entry.partner[1]}
    return found

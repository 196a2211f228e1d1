"""The result file of an identification (schema identification/1)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from sim_vehicle.model.aerodynamic_terms import parse_term
from sysid.compatibility.reconstruction import CompatibilityResult, SensorError
from sysid.errors import SysidError
from sysid.filter_error.estimator import FilterErrorResult
from sysid.identification.identify import Identification
from sysid.identification.linear_model import RESPONSES
from sysid.identification.measured_responses import measured_json
from sysid.identification.power_balance import power_balance
from sysid.signal_check.sensor_assessment import verdicts
from sysid.validation.largest_residual import outlier_text
from sysid.validation.residual_series import output_residuals, series_json
from sysid.validation.simulation_series import simulation_series
from sysid.validation.statistics import Validation

# Samples of a flight in its time histories: a minute at 50 Hz is whole.
_SAMPLES = 3000


def result_json(found: Identification) -> dict[str, Any]:
    """JSON values of an identification; what is not a finite number is null."""
    compatible = found.compatibility
    segments = [
        {
            "flight": flight.data.name,
            "start": round(stretch.segment.start_s, 3),
            "end": round(stretch.segment.end_s, 3),
            "kind": stretch.segment.kind,
            "reason": stretch.segment.reason,
        }
        for flight in found.flights
        for stretch in flight.stretches
    ]
    result = {
        "schema": "identification/1",
        "flights": [flight.data.name for flight in found.flights],
        "thrust": {flight.data.name: str(flight.thrust_source) for flight in found.flights},
        "sensor_errors": {
            name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in found.sensor_errors.items()
        },
        "compatibility": {
            "before": {name: vars(fit) for name, fit in compatible.before.items()},
            "after": {name: vars(fit) for name, fit in compatible.after.items()},
            "compatible": compatible.compatible if compatible.converged else None,
            "incompatible": compatible.incompatible,
            "turbulence": compatible.gust_sigma,
            "verdicts": [one.to_json() for one in verdicts(_finally(found), found.mistakes, found.posterior is None)],
        },
        "mistakes": [one.to_json() for one in found.mistakes],
        **_method(found),
        "battery": power_balance(found.flights),
        "model": found.model.to_json(),
        "dimensional": found.mean.derivatives,
        **_linear(found),
        **_regression(found),
        "quality": found.quality.to_json(),
        "repeatability": {name: one.to_json() for name, one in found.repeatability.items()},
        "validation": _validation(found.validation, found.validation_flights),
        **_series(found),
        "refused": [refusal.to_json() for refusal in found.refused],
        "segments": list({(s["flight"], s["start"]): s for s in segments}.values()),
        "warnings": [
            *found.warnings,
            *(found.mean.linear.left_out() if not isinstance(found.mean.linear, str) else ()),
        ],
    }
    clean: dict[str, Any] = finite_json(result)
    return clean


def _finally(found: Identification) -> CompatibilityResult:
    """The compatibility check with the sensor errors that the whole estimate ended with."""
    errors = {name: SensorError(*error) for name, error in found.sensor_errors.items()}
    return replace(found.compatibility, parameters=errors, refused=list(found.refused))


def _regression(found: Identification) -> dict[str, Any]:
    """How each axis was regressed, of those of which a coefficient is reported."""
    if found.equation_error is None:
        return {}
    known = {parse_term(name).axis for name, one in found.model.coefficients.items() if one.value is not None}
    return {"regression": {axis: one for axis, one in found.equation_error.report.items() if axis in known}}


def _method(found: Identification) -> dict[str, Any]:
    """How the coefficients were estimated, in what turbulence, and what beside them."""
    if found.posterior is not None:
        beside = {
            "nuisances": [one.to_json() for one in found.posterior.nuisances],
            "noise_spectrum": [one.to_json() for one in found.posterior.noise],
        }
        return {"method": "map", "turbulence": None, **beside}
    if found.likeliest is None:
        return {"method": "ee", "turbulence": None}
    result = found.likeliest.result
    if not isinstance(result, FilterErrorResult):
        return {"method": found.likeliest.method, "turbulence": None}
    names = {"horizontal": "m/s", "vertical": "m/s", "length": "m"}
    values = {name: {"value": getattr(result.turbulence, name), "unit": unit} for name, unit in names.items()}
    return {"method": found.likeliest.method, "turbulence": values}


def _linear(found: Identification) -> dict[str, Any]:
    """Modes, state space and frequency responses about the flight's mean airspeed, or why there are none."""
    linear = found.mean.linear
    if isinstance(linear, str):
        return {"modes": {"refused": linear}, "state_space": None, "frequency_responses": []}
    measured = measured_json(found.flown or found.flights, RESPONSES)
    responses = linear.responses_json()
    for one in responses:
        if (seen := measured.get(f"{one['output']} / {one['input']}")) is not None:
            one["measured"] = seen
    return {
        "modes": [mode.to_json() for mode in linear.modes()],
        "state_space": linear.system.to_json(),
        "frequency_responses": responses,
    }


def _series(found: Identification) -> dict[str, Any]:
    """Curves for a report."""
    if found.compared is None:
        return {}
    use = "estimation" if found.validation is None else "validation"
    series = series_json(found.compared, use)
    try:
        series["simulated"] = simulation_series(
            found.compared.flights, {"model": found.compared.model}, ("model",), _SAMPLES
        )
    except SysidError:
        series["simulated"] = []  # a motion that cannot be reconstructed has no states to begin from
    if found.likeliest is not None:
        interval = found.likeliest.problem.records[0].interval_s
        series["outputs"] = output_residuals(found.likeliest.result.residuals, interval)
    return {"series": series}


def _validation(validation: Validation | None, flights: tuple[str, ...]) -> dict[str, Any] | None:
    if validation is None:
        return None
    return {
        "flights": list(flights),
        "outputs": {name: output.to_json() | _largest(validation, name) for name, output in validation.outputs.items()},
        "acceptable": validation.acceptable,
        "limit": validation.limit,
        "reason": validation.reason,
        "outliers": outlier_text(validation.largest),
    }


def _largest(validation: Validation, name: str) -> dict[str, Any]:
    """The output's largest residual, and when; nothing where its noise is unknown."""
    found = validation.largest.get(name)
    return {} if found is None else {"largest_over_noise": found.over_noise, "largest_at": vars(found)}


def finite_json(value: Any) -> Any:
    """The same with numpy numbers made plain and numbers that are not finite made None."""
    if isinstance(value, dict):
        return {key: finite_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite_json(item) for item in value]
    if isinstance(value, bool | str | int) or value is None:
        return value
    if hasattr(value, "item"):
        return finite_json(value.item())
    return float(value) if math.isfinite(value) else None

"""The analyses: identification, simulation, the missing effect, and the plan of the next flight."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flightmodel.aircraft import Aircraft
from flightmodel.errors import FlightModelError
from flightmodel.flight import Flight
from flightmodel.optional import analysing, progress_bar
from flightmodel.results import Array, Design, Discrepancy, Identification, Simulation, one_flight
from sim_vehicle.model.model_file import Model, read_model

ModelLike = Model | Identification | str | Path
_SIMULATED = ("airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az")


def identify(
    flight: Flight | Sequence[Flight],
    aircraft: Aircraft,
    *,
    validate_on: Flight | Sequence[Flight] = (),
    structure: ModelLike | None = None,
    prior: ModelLike | None = None,
    method: str = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    as_recorded: Sequence[str] = (),
    progress: bool | None = None,
) -> Identification:
    """Identify the flight model of an aircraft.

    Parameters
    ----------
    flight : Flight | Sequence[Flight]
        One flight, or several that are estimated together.
    aircraft : Aircraft
        What is known of the aircraft.
    validate_on : Flight | Sequence[Flight]
        Flights that the model is judged by and not fitted to.
    structure : Model | Identification | str | Path | None
        A model whose coefficients are to be estimated; None takes the linear ones.
    prior : Model | Identification | str | Path | None
        A model whose values and errors are known before.
    method : str
        "auto", "map" (output error with an estimated noise spectrum and priors), "ee" (equation error), "oe" (output
        error), "fe" (filter error).
    start_s, stop_s : float | None
        The part to take, s from the flight's first stamp.
    as_recorded : Sequence[str]
        Signals that are right whatever seems, as "ax".
    progress : bool | None
        Whether a bar is shown; None shows it in a terminal or notebook.

    Returns
    -------
    Identification
        Model, errors, verdict.

    Raises
    ------
    sysid.errors.SysidError
        Where the flight lacks what is needed; its text says what.

    Examples
    --------
    >>> result = identify(flight, aircraft)
    >>> result.verdict
    'good'
    >>> round(result.values["CL_alpha"], 1), result.stds["CL_alpha"] < 0.2
    (4.6, True)
    """
    from gcs.analysis.provenance import made
    from gcs.analysis.sameflight import repeated
    from sim_vehicle.model.model_file import model_from_json
    from sysid.identification.result_file import result_json
    from sysid.identify import identify as run

    _expect(flight, aircraft)
    flights, judges = one_flight(flight), _several(validate_on)
    with progress_bar(progress) as shown, analysing(flights):
        found = run(
            [one.of(aircraft) for one in flights], aircraft.vehicle,
            validate_on=[one.of(aircraft) for one in judges],
            structure=None if structure is None else _model(structure),
            prior=None if prior is None else _model(prior),
            method=method, start_s=start_s, stop_s=stop_s, as_recorded=tuple(as_recorded), progress=shown,
        )  # fmt: skip
    result = result_json(found)
    twice = repeated([one.signals for one in flights], [one.signals for one in judges])
    result["warnings"] = list(dict.fromkeys([*twice, *aircraft.warnings, *result["warnings"]]))
    result["made"] = made({"vehicle": aircraft.name, "method": method, "from": start_s, "to": stop_s}, [])
    return Identification(result, model_from_json(result["model"]), aircraft, found.posterior)


def simulate(
    model: ModelLike,
    aircraft: Aircraft,
    flight: Flight,
    *,
    restart_s: float | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Simulation:
    """Fly a model with the surfaces and thrust of a flight, from the motion measured at its beginning.

    Parameters
    ----------
    model : Model | Identification | str | Path
        What is flown; a coefficient without a value counts by the mean of its estimate, else as 0. Of an
        Identification the errors of sensors and the delays of servos count too.
    aircraft : Aircraft
        Mass, inertia, wing.
    flight : Flight
        What was measured.
    restart_s : float | None
        s after which the simulation begins anew from the measured motion; None lets it run through each part.
    start_s, stop_s : float | None
        The part to take, s from the flight's first stamp; None takes the parts that are flight.

    Returns
    -------
    Simulation
        Measured and simulated outputs at the flight's samples.

    Examples
    --------
    >>> flown = simulate(identify(flight, aircraft), aircraft, flight, restart_s=5.0)
    >>> flown.tic["q"] < 0.05
    True
    """
    from sysid.compatibility.reconstruction import check_compatibility, smoothed_states
    from sysid.identification.moving_surfaces import with_surfaces_as_they_moved
    from sysid.identification.repaired_flight import read_flights
    from sysid.posterior.stated_priors import as_estimated
    from sysid.problem.formulation import timing_of
    from sysid.problem.free_run import free_run, start_read_alike
    from sysid.signals.record import OUTPUTS, STATES
    from sysid.validation.held_out import comparison
    from sysid.validation.servo_replay import with_estimated_deflections

    _expect(flight, aircraft)
    if restart_s is not None and restart_s <= 0.0:
        raise FlightModelError(f"restart_s is {restart_s:g}; give seconds above 0, or None")
    vehicle = aircraft.vehicle
    flights = read_flights([flight.of(aircraft)], [], vehicle, (), start_s, stop_s)
    (read,) = flights.fitted
    prepared = read.as_measured(vehicle, start_s, stop_s)
    errors: dict[str, tuple[float, float, str]] = {}
    if isinstance(model, Identification) and model.posterior is not None:
        errors = dict(model.posterior.sensor_errors())
        (prepared,) = with_estimated_deflections([prepared], [read.signals], vehicle, model.posterior)
        vehicle = as_estimated(vehicle, model.posterior.of_aircraft())
    else:
        compatible, span = check_compatibility([prepared]), (start_s, stop_s)
        moving = with_surfaces_as_they_moved(flights, vehicle, span, [prepared], compatible)
        if moving is not None:
            (prepared,), vehicle = moving.prepared, moving.vehicle
    if isinstance(model, Identification) and model.posterior is None:
        entries = model.result["sensor_errors"].items()
        errors = {name: (entry["value"], entry["std"], entry["unit"]) for name, entry in entries}
    fixed = comparison([prepared], vehicle, _model(model), errors, timing_of([prepared], False)).model
    times: list[Array] = []
    z: list[Array] = []
    y: list[Array] = []
    for stretch in prepared.stretches:
        record = stretch.record
        states = smoothed_states(record, prepared.layout, dict(fixed.errors))
        path = np.stack([states[name] for name in STATES], axis=1)
        size = record.length if restart_s is None else max(2, round(restart_s / record.interval_s))
        for begin in range(0, record.length, size):
            part = record.window(begin, min(begin + size, record.length))
            if part.length < 2:
                continue
            times.append(part.time_s)
            z.append(part.z)
            y.append(free_run(part, start_read_alike(part, path[begin], fixed), fixed))
    measured, simulated = np.concatenate(z), np.concatenate(y)
    places = {name: OUTPUTS.index(name) for name in _SIMULATED}
    there = {name: place for name, place in places.items() if np.isfinite(measured[:, place]).any()}
    return Simulation(
        flight.name, np.concatenate(times),
        {name: measured[:, place] for name, place in there.items()},
        {name: simulated[:, place] for name, place in there.items()},
        {name: _UNITS.get(name, "rad") for name in there},
    )  # fmt: skip


def discrepancy(
    flight: Flight | Sequence[Flight],
    aircraft: Aircraft,
    model: ModelLike,
    *,
    validate_on: Flight | Sequence[Flight] = (),
    ruled_out: Sequence[str] = (),
    method: str = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    progress: bool | None = None,
) -> Discrepancy:
    """Find where simulation and measurement disagree, and name the physical effect that the model lacks.

    Parameters
    ----------
    flight : Flight | Sequence[Flight]
        What is explained.
    aircraft : Aircraft
        What is known of the aircraft.
    model : Model | Identification | str | Path
        The baseline; a coefficient without a value begins at the mean of its estimate, else at 0.
    validate_on : Flight | Sequence[Flight]
        Flights on which the gap is shown, and to which nothing is fitted.
    ruled_out : Sequence[str]
        Effects that are known not to be there (docs/reference/effects.md).
    method : str
        "auto", "map" or "fe".
    start_s, stop_s : float | None
        The part to take, s.
    progress : bool | None
        Whether a bar is shown; None shows it in a terminal or notebook.

    Returns
    -------
    Discrepancy
        The verdict, the effects with their probabilities, and the model with them.

    Notes
    -----
    docs/notebooks/missing-effect.ipynb is an example, start to end.
    """
    from gcs.analysis.provenance import made
    from sim_vehicle.model.model_file import model_from_json
    from sysid.discrepancy import discrepancy as run
    from sysid.identification.result_file import finite_json

    _expect(flight, aircraft)
    baseline = _model(model).with_starts()
    flights = one_flight(flight)
    with progress_bar(progress) as shown, analysing(flights):
        found = run(
            [one.of(aircraft) for one in flights], aircraft.vehicle, baseline,
            validate_on=[one.of(aircraft) for one in _several(validate_on)],
            start_s=start_s, stop_s=stop_s, ruled_out=tuple(ruled_out), method=method, progress=shown,
        )  # fmt: skip
    result: dict[str, Any] = finite_json(found)
    result["made"] = made({"vehicle": aircraft.name, "method": method, "rule_out": list(ruled_out)}, [])
    return Discrepancy(result, model_from_json(result["model"]))


def design(
    aircraft: Aircraft,
    model: ModelLike,
    manoeuvres: Sequence[str] = ("multisine",),
    *,
    duration_s: float | None = None,
    gusts: float = 0.0,
    rate_hz: float = 50.0,
    without: Sequence[str] = (),
    progress: bool | None = None,
) -> Design:
    """Plan a flight, and say before it is flown what it will determine.

    Parameters
    ----------
    aircraft : Aircraft
        What flies.
    model : Model | Identification | str | Path
        What is known of it; a coefficient without a value counts by the mean of its estimate, else as 0.
    manoeuvres : Sequence[str]
        "multisine", "elevator-doublet", "rudder-3211", ...; they are timed and sized to the model.
    duration_s : float | None
        Of the whole plan, s; None takes the manoeuvres' own.
    gusts : float
        Turbulence, 1 sigma, m/s.
    rate_hz : float
        Samples a second.
    without : Sequence[str]
        Sensors that the aircraft lacks.
    progress : bool | None
        Whether a bar is shown; None shows it in a terminal or notebook.

    Returns
    -------
    Design
        The plan and the standard errors that it will give.

    Examples
    --------
    >>> plan = design(aircraft, identify(flight, aircraft), ["elevator-3211"])
    >>> plan.stds["Cm_alpha"] < 0.05
    True
    """
    from gcs.design.prediction import Request
    from gcs.design.prediction import design as run

    _expect(None, aircraft)
    start = _model(model).with_starts()
    request = Request(tuple(manoeuvres), duration=duration_s, gusts=gusts, rate_hz=rate_hz, without=frozenset(without))
    with progress_bar(progress) as shown:
        found = run(aircraft.vehicle, start, request, shown)
    return Design(found.result, found.plan_json())


_UNITS = {"airspeed": "m/s", **dict.fromkeys(("p", "q", "r"), "rad/s"), **dict.fromkeys(("ax", "ay", "az"), "m/s^2")}


def _expect(flight: object, aircraft: object) -> None:
    """Raise FlightModelError, in one line, where what was given for an aircraft is none."""
    if isinstance(aircraft, Aircraft):
        return
    if isinstance(flight, Aircraft):
        raise FlightModelError("the flight comes first, then the aircraft: identify(flight, aircraft)")
    raise FlightModelError(
        f"a {type(aircraft).__name__} is no aircraft: make one with Aircraft.read or Aircraft.estimate"
    )


def _several(flights: Flight | Sequence[Flight]) -> list[Flight]:
    return one_flight(flights) if isinstance(flights, Flight) or len(flights) else []


def _model(model: ModelLike) -> Model:
    """The model of an argument that takes one in several forms."""
    if isinstance(model, Identification):
        return model.model
    if isinstance(model, Model):
        return model
    if isinstance(model, str | Path):
        return read_model(model)
    raise FlightModelError(f"a {type(model).__name__} is no model: give one that identify made, or a file of one")

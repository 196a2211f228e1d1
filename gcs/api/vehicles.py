"""The station's aircraft: list, description, versions."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from fastapi.responses import Response

from gcs.api.schemas.problem import Problem
from gcs.api.service import Service, Serving
from gcs.api.vehicle_schemas import (
    EstimateView,
    FigureView,
    InertiaEstimate,
    InertiaRequest,
    TrendView,
    VehicleDraft,
    VehicleForm,
    VehicleItem,
    VehicleReading,
    VehicleView,
)
from gcs.catalogue.aircraft_rule import STATION
from gcs.errors import VehicleError
from gcs.text.intervals import of_the_flight
from gcs.text.utctext import utc_text
from gcs.vehicles.document import answers_of
from gcs.vehicles.figures import figures
from gcs.vehicles.inertia import by_bifilar, by_swing, period, ruler, scale
from gcs.vehicles.shelf import Shelved, read_text
from gcs.vehicles.sketch import sketch
from gcs.vehicles.trends import Estimate, Trend, trend
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import Vehicle

router = APIRouter(prefix="/api/vehicles", tags=["aircraft"])

_PROBLEM = {"model": Problem}
_MISSING: dict[int | str, dict[str, Any]] = {404: _PROBLEM, 409: _PROBLEM, 422: _PROBLEM, 503: _PROBLEM}
_REFUSED: dict[int | str, dict[str, Any]] = {409: _PROBLEM, 422: _PROBLEM, 503: _PROBLEM}


def _text(service: Service, draft: VehicleDraft, before: str = "") -> str:
    """The text that a draft makes; a form alone is put into what was there before."""
    text = before if draft.toml is None else draft.toml
    if draft.form is None:
        return text
    return service.drafts.filled(text, draft.form.answers())


def _reading(text: str, vehicle: Vehicle) -> VehicleReading:
    try:
        form = VehicleForm.of(answers_of(text))
    except (VehicleFileError, ValueError):
        form = None
    made = [
        FigureView(name=one.name, value=one.value, unit=one.unit, usual=one.usual, is_usual=one.is_usual)
        for one in figures(vehicle)
    ]
    return VehicleReading(
        toml=text, problem="", name=vehicle.name, warnings=list(vehicle.warnings), figures=made,
        sketch=sketch(vehicle), form=form,
    )  # fmt: skip


def _item(one: Shelved) -> VehicleItem:
    return VehicleItem(
        id=one.id,
        name=one.vehicle.name,
        version=one.version,
        changed=utc_text(one.changed_ns),
        editable=one.id != STATION,
        mass_kg=one.vehicle.mass.mass,
        span_m=one.vehicle.geometry.b,
        warnings=list(one.vehicle.warnings),
    )


@router.get("")
def vehicles(service: Serving) -> list[VehicleItem]:
    """Every aircraft, the one that the service was started with first."""
    return [_item(one) for one in service.jobs.choice.shelf.all()]


@router.post("", status_code=201, responses=_REFUSED)
def add(service: Serving, draft: VehicleDraft) -> VehicleItem:
    """A new aircraft; its id is made of its name. What it is like, POST /api/vehicles/check says beforehand."""
    return _item(service.jobs.choice.shelf.add(_text(service, draft)))


@router.post("/check", responses=_REFUSED)
def check(service: Serving, draft: VehicleDraft) -> VehicleReading:
    """What a description says, and what is wrong with it; nothing is kept."""
    text = draft.toml or ""
    try:
        text = _text(service, draft)
        return _reading(text, read_text(text))
    except (VehicleFileError, VehicleError) as error:
        return VehicleReading(
            toml=text, problem=str(error), name="", warnings=[], figures=[], sketch="", form=draft.form
        )


@router.post("/inertia", responses=_REFUSED)
def inertia(asked: InertiaRequest) -> InertiaEstimate:
    """A moment of inertia from the swings of the aircraft as a pendulum, with its standard error."""
    swing = period(asked.times_s, asked.swings)
    mass, length = scale(asked.mass_kg, asked.mass_std_kg), ruler(asked.length_m, asked.length_std_m)
    if asked.way == "bifilar":
        assert asked.spacing_m is not None
        found = by_bifilar(mass, length, ruler(asked.spacing_m, asked.spacing_std_m), swing)
    else:
        found = by_swing(mass, length, swing)
    return InertiaEstimate(value=found.value, std=found.std, period_s=swing.value, period_std_s=swing.std)


@router.get("/{vehicle_id}", responses=_MISSING)
def vehicle(service: Serving, vehicle_id: str) -> VehicleView:
    """One aircraft, in its newest version or, as `id@version`, in an older one."""
    shelf = service.jobs.choice.shelf
    found = shelf.get(vehicle_id)
    return VehicleView(
        **_item(found).model_dump(),
        versions=[1] if found.id == STATION else shelf.versions(found.id),
        reading=_reading(found.text, found.vehicle),
    )


@router.put("/{vehicle_id}", responses=_MISSING)
def change(service: Serving, vehicle_id: str, draft: VehicleDraft) -> VehicleItem:
    """A new version of an aircraft. Flights keep the one that they were identified with."""
    shelf = service.jobs.choice.shelf
    text = _text(service, draft, shelf.get(vehicle_id).text)
    return _item(shelf.change(vehicle_id, text))


@router.delete("/{vehicle_id}", status_code=204, responses=_MISSING)
def delete(service: Serving, vehicle_id: str) -> None:
    """Take an aircraft from the list. Its versions are kept, as flights were identified with them."""
    service.jobs.choice.shelf.remove(vehicle_id)


@router.post("/{vehicle_id}/restore", responses=_MISSING)
def restore(service: Serving, vehicle_id: str) -> VehicleItem:
    """Put an aircraft that was deleted into the list again."""
    return _item(service.jobs.choice.shelf.restore(vehicle_id))


@router.get("/{vehicle_id}/trends", responses=_MISSING)
def trends(service: Serving, vehicle_id: str) -> list[TrendView]:
    """Coefficients of an aircraft over its flights: have they changed? Of a flight its newest identification counts."""
    name = service.jobs.choice.shelf.get(vehicle_id).id
    found: dict[str, list[Estimate]] = {}
    for model in service.catalogue.identified_with(name):
        for coefficient, entry in model["coefficients"].items():
            value, std = entry.get("value"), of_the_flight(entry)
            if value is not None and std:
                one = Estimate(model["flight"], model["title"], model["start_ns"], float(value), float(std))
                found.setdefault(coefficient, []).append(one)
    return [_trend_view(trend(coefficient, estimates)) for coefficient, estimates in found.items()]


def _trend_view(found: Trend) -> TrendView:
    return TrendView(
        name=found.name,
        estimates=[
            EstimateView(flight=one.flight, title=one.title, start=utc_text(one.start_ns), value=one.value, std=one.std)
            for one in found.estimates
        ],
        mean=found.mean,
        std=found.std,
        scatter=found.scatter,
        constant_p=found.constant_p,
        change=found.change,
    )


@router.get(
    "/{vehicle_id}/toml",
    response_class=Response,
    responses={200: {"content": {"application/toml": {"schema": {"type": "string"}}}}, **_MISSING},
)
def toml(service: Serving, vehicle_id: str) -> Response:
    """The vehicle file, for gcs identify --vehicle; it needs no file beside it."""
    found = service.jobs.choice.shelf.get(vehicle_id)
    name = f'attachment; filename="{found.id}.toml"'
    return Response(found.text, media_type="application/toml", headers={"Content-Disposition": name})

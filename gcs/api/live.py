"""What the aircraft does now: the newest values, and a stream of events."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from gcs.api.held import HeldStream
from gcs.api.schemas.live import Live, Minute, NoteMade, NoteText
from gcs.api.schemas.problem import Problem
from gcs.api.service import Service, Serving
from gcs.live.feed import Samples
from gcs.text.jsontext import dumps
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import load_vehicle

router = APIRouter(tags=["live"])

_LOOK_S = 0.05
_HEARTBEAT_S = 10.0
_FRESH_NS = 2_000_000_000
_NO_VEHICLE = "no aircraft is known: describe it under Aircraft, or start the service with --vehicle FILE"
_DESCRIBED = "it begins with a flight, whose aircraft the station then knows or you choose on the flight's page"
_STARTING = (
    "the first estimates come a few seconds after the first messages; the very first time on a computer, loops are"
    " compiled for about a minute before"
)


@router.get("/api/live")
def live(service: Serving) -> Live:
    """The newest value of every signal, the links, and what is known of the aircraft so far."""
    return Live.model_validate(snapshot(service))


@router.get("/api/live/minute")
def minute(service: Serving) -> Minute:
    """The signals streamed over the last minute; units are in /api/live."""
    return Minute.model_validate(service.minute.to_json())


@router.get(
    "/api/live/stream",
    response_class=StreamingResponse,
    responses={
        200: {"content": {"text/event-stream": {}}, "description": "events `signals`, `status`, `estimate`, `state`"},
        503: {"model": Problem},
    },
)
async def stream(request: Request, service: Serving) -> StreamingResponse:
    """Server-sent events: `signals` ten times a second (newest values, and all samples since), `estimate` and `status`
    of the vehicle twice, `state` when it, flight or vehicle change.
    """
    who = request.state.identity.name
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return HeldStream(
        _events(service), media_type="text/event-stream", headers=headers, places=service.following, who=who
    )


@router.post("/api/live/notes", status_code=201, responses={409: {"model": Problem}})
def note(service: Serving, given: NoteText) -> NoteMade:
    """Note something in flight: it is kept in the recording of every flight that is going on, and shown with it."""
    return NoteMade(text=given.text, flights=service.recorder.note(given.text))


def snapshot(service: Service) -> dict[str, Any]:
    """The answer of GET /api/live."""
    feed, state = service.live, service.live.current
    now_ns = time.time_ns()
    signals = {
        name: {"value": value, "unit": unit, "age_s": max(now_ns - received_ns, 0) / 1e9}
        for name, (value, received_ns, unit) in state.signals.items()
    }
    vehicle = service.settings.vehicle
    why = None
    if state.identification is None:
        why = feed.problem or _STARTING
        if vehicle is None and feed.vehicle is None:
            why = _DESCRIBED if service.jobs.choice.shelf.ids() else _NO_VEHICLE
    return {
        "schema": "live/1",
        "flight": feed.flight,
        "time_s": state.time_s,
        "vehicle": feed.vehicle or vehicle_name(vehicle),
        "landed": service.recorder.landed(),
        "silent": service.recorder.silent(),
        "state": feed.link_state,
        "signals": signals,
        "status": state.status,
        "track": state.track,
        "links": service.recorder.link_status(),
        "identification": state.identification,
        "events": [] if state.identification is None else state.identification["events"],
        "why": why,
        "process": {
            "state": feed.process_state,
            "problem": feed.problem,
            "restarts": feed.restarts,
            "dropped_bytes": feed.dropped_bytes,
        },
    }


def vehicle_name(vehicle: str | None) -> str | None:
    """The name in the vehicle file as it stands there now, before the live process has read it."""
    if vehicle is None:
        return None
    path = Path(vehicle)
    return _name_at(vehicle, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=4)
def _name_at(vehicle: str, changed_ns: int) -> str:
    try:
        return load_vehicle(vehicle).name
    except VehicleFileError:  # somebody is writing it
        return Path(vehicle).stem


def joined(reports: Iterable[Samples]) -> Samples:
    """Samples of several reports, one behind the other."""
    found: Samples = {}
    for report in reports:
        for name, (times, values) in report.items():
            before = found.setdefault(name, ([], []))
            before[0].extend(times)
            before[1].extend(values)
    return found


def _event(name: str, data: dict[str, Any]) -> str:
    return f"event: {name}\ndata: {dumps(data)}\n\n"


async def _events(service: Service) -> AsyncIterator[str]:
    feed = service.live
    sent: object = None
    signals = estimate = status = 0
    spoken = time.monotonic()
    while not feed.ending.is_set():
        state, link = feed.current, feed.link_state
        text = ""
        name = feed.vehicle or vehicle_name(service.settings.vehicle)
        now = {"state": link, "flight": feed.flight, "vehicle": name, "landed": service.recorder.landed(),
               "silent": service.recorder.silent()}  # fmt: skip
        if now != sent:
            sent = now
            text += _event("state", {**now, "time_s": state.time_s})
        if state.signals_number != signals:
            samples = joined(recent for number, recent in state.recent if number > signals)
            signals = state.signals_number
            now_ns = time.time_ns()
            values = {name: v for name, (v, at_ns, _) in state.signals.items() if now_ns - at_ns < _FRESH_NS}
            text += _event("signals", {"time_s": state.time_s, "signals": values, "samples": samples})
        if state.status_number != status and state.status:
            status = state.status_number
            text += _event("status", state.status)
        if state.estimate_number != estimate and state.identification is not None:
            estimate = state.estimate_number
            text += _event("estimate", state.identification)
        if not text and time.monotonic() - spoken >= _HEARTBEAT_S:
            text = ": still here\n\n"
        if text:
            spoken = time.monotonic()
            yield text
        await asyncio.sleep(_LOOK_S)

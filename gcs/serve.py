"""Putting the service together and running it until it is asked to stop."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from types import FrameType

import uvicorn
from fastapi import FastAPI
from uvicorn.config import LOGGING_CONFIG

from gcs.allocator import give_memory_back
from gcs.api import create_app
from gcs.api.connections import MOST, BoundedProtocol, limited
from gcs.api.server import AT_A_TIME, WAITING, Server
from gcs.api.tls import tls_context
from gcs.catalogue.aircraft_rule import STATION
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import Leftover, Recovery, leftovers
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.catalogue.sole_user import sole_user
from gcs.catalogue.store import Catalogue
from gcs.errors import CatalogueFileError, GcsError, ServiceError
from gcs.jobs.flightviews import FlightViews
from gcs.jobs.programs import begin_no_more
from gcs.jobs.runner import JobRunner
from gcs.links.opening import Link, open_links
from gcs.live.feed import LiveFeed
from gcs.live.telemetry import EstimateTelemetry
from gcs.mavlink.dialect import Dialect
from gcs.portable import open_files
from gcs.settings import Settings
from gcs.station.forwardrules import parse_forward
from gcs.station.own_sender import StationVoice
from gcs.station.provenance import FreshProvenance, provenance
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation
from gcs.station.supervisor import Supervisor
from gcs.station.warmup import warm_up
from gcs.text.oserrors import reason
from gcs.text.sparing_log import log_sparingly
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import load_vehicle

_log = logging.getLogger(__name__)

# Open files and sockets that are asked for where a system sets no limit.
_DESCRIPTORS = 8192
# Bytes of a request before its body: a query of thousands of names is answered in words.
_LONGEST_HEAD = 64 * 1024
# What the service writes is nobody's but its user's and, to read, its group's.
_UMASK = 0o027


def _tidy(settings: Settings) -> None:
    """Remove the folders of uploads, drafts and jobs that a service which was killed left behind."""
    folders = [*settings.data.glob("upload-*"), *settings.data.glob("draft-*"), *settings.views.glob("reading-*")]
    folders += [*(settings.jobs.iterdir() if settings.jobs.is_dir() else ())]
    for folder in folders:
        if folder.is_dir() and not folder.is_symlink():
            shutil.rmtree(folder, ignore_errors=True)


def _connections() -> type[BoundedProtocol]:
    """HTTP that leaves most of the open files and sockets that this process may have to links and recordings."""
    return limited(min(MOST, open_files(_DESCRIPTORS) // 4))


@contextmanager
def _links(urls: tuple[str, ...]) -> Iterator[list[Link]]:
    """Open all links or none; the station closes them."""
    links = open_links(urls)
    try:
        yield links
    except BaseException:
        for link in links:
            link.close()
        raise


def _listen(settings: Settings) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        listener = socket.create_server((settings.host, settings.port), family=family, backlog=WAITING)
    except OSError as error:
        raise ServiceError(
            f"cannot listen on {settings.host} port {settings.port} ({reason(error)}); choose another --port"
        ) from error
    # Connections have it from here: else the second part of an answer waits 40 ms until the first is acknowledged.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def _identify_when_over(settings: Settings, jobs: JobRunner) -> Callable[[Flight], None]:
    """Queue an identification of every flight that has ended, where a vehicle file says of what aircraft."""

    def queue(flight: Flight) -> None:
        if flight.system is None or flight.follows is not None or not settings.identify:
            return
        try:
            jobs.choice.of(flight)
        except (GcsError, SimVehicleError) as error:
            _log.debug("flight %s is not identified: %s", flight.id, error)  # its page says so
            return
        try:
            jobs.submit(flight.id, {"kind": "identify", "system": flight.system, "automatic": True})
        except GcsError as error:
            _log.error("flight %s cannot be identified: %s", flight.id, error)

    return queue


def _vehicle_of(jobs: JobRunner, recorder: FlightRecorder) -> Callable[[str, int | None], str | None]:
    """The vehicle file of a flight that is being recorded, "" for the service's own, None where nobody knows it."""

    def file(flight_id: str, system: int | None) -> str | None:
        try:
            chosen = jobs.choice.for_flight(flight_id, system, board=recorder.board_of(system)).vehicle
        except (GcsError, SimVehicleError):
            return None
        return "" if chosen.id == STATION else str(chosen.vehicle.path)

    return file


def _configuration(app: FastAPI, settings: Settings, protocol: type[BoundedProtocol]) -> uvicorn.Config:
    """Of uvicorn, whose log goes with ours where ours is JSON. Requests are logged by gcs.api.request_ids alone."""
    own_log = None if settings.json_log else LOGGING_CONFIG
    return uvicorn.Config(
        app,
        backlog=AT_A_TIME,
        log_level="warning",
        log_config=own_log,
        access_log=False,
        timeout_graceful_shutdown=3,
        http=protocol,
        h11_max_incomplete_event_size=_LONGEST_HEAD,
    )


def serve(settings: Settings, announce: Callable[[str], None]) -> None:
    """Run the service until SIGINT or SIGTERM.

    Raises SettingsError, ServiceError, LinkError, VehicleFileError, CatalogueError.
    announce: called once with the URL at which the service answers.
    """
    os.umask(_UMASK)
    give_memory_back()
    protocol = _connections()
    tls = tls_context(settings.tls_cert, settings.tls_key) if settings.tls_cert and settings.tls_key else None
    if settings.vehicle is not None:
        for warning in load_vehicle(settings.vehicle).warnings:
            _log.warning("%s", warning)
    with (
        sole_user(settings.data),
        _listen(settings) as listener,
        closing(Catalogue(settings.database)) as catalogue,
    ):
        _tidy(settings)
        jobs = JobRunner(settings, catalogue)
        identify = _identify_when_over(settings, jobs)
        views = FlightViews(settings, vehicle_of=jobs.choice.file_of, outlined=catalogue.put_outline)

        def when_over(flight: Flight) -> None:
            identify(flight)
            views.prepare(flight)

        left: list[Leftover] = []
        try:
            for flight in catalogue.unidentified_flights():  # the last service may have ended before it queued them
                identify(flight)
            left = leftovers(settings, catalogue)
        except CatalogueFileError as error:  # flights are recorded all the same, and health says it
            _log.error("%s", error)
        recovery = Recovery(left, catalogue, when_over)
        dialect = Dialect.load(settings.link.dialect)
        warm_up(dialect)
        recorder = FlightRecorder(
            settings.flights,
            dialect,
            catalogue,
            silence_s=settings.silence_s,
            disarm_s=settings.disarm_s,
            on_flight_end=when_over,
            storage=settings.storage,
            provenance=FreshProvenance(
                lambda: provenance(dialect, settings.connect, settings.vehicle, settings.link.dialect)
            ),
            key=settings.link.key,
            require_signed=settings.link.require_signed,
        )
        forwards = [parse_forward(text, dialect) for text in settings.forward]
        with _links(settings.connect) as links, _links(tuple(url for url, _ in forwards)) as forward:
            rules = {link.name: rule for link, (_, rule) in zip(forward, forwards, strict=True)}
            voice = StationVoice(settings.link.own_key)
            live = LiveFeed(settings, recorder.live_vehicles, vehicle_of=_vehicle_of(jobs, recorder))
            if settings.link.require_signed:
                recorder.hear_believed = live.offer
            station = RecordingStation(
                links,
                recorder,
                forward,
                voice=voice,
                dialect=dialect,
                listen=None if settings.link.require_signed else live.offer,
                rules=rules,
                forward_key=settings.link.key if settings.link.require_signed else None,
            )
            live.on_estimate = EstimateTelemetry(station.send_to_stations, settings.link.own_key).take
            rule = RetentionRule(settings.keep_days, settings.keep_bytes)
            retention = Retention(settings.flights, catalogue, rule, backups=settings.backups)
            app = create_app(settings, catalogue, station, jobs, (retention, recovery, live), live, views)
            config = _configuration(app, settings, protocol)
            log_sparingly()  # behind the configuration, which makes handlers of its own

            def stop() -> None:
                begin_no_more()
                app.state.service.stop()

            server = Server(config, live, Supervisor(), lambda: station.alive, stop, tls)
            scheme = "http" if tls is None else "https"
            host = f"[{settings.host}]" if ":" in settings.host else settings.host
            with closing(retention):
                retention.start()
                recovery.start()
                _stop_on_signals(server, recovery)
                announce(f"{scheme}://{host}:{listener.getsockname()[1]}")
                server.run(sockets=[listener])


def _stop_on_signals(server: uvicorn.Server, recovery: Recovery) -> None:
    """Being asked to stop is a good end, so the signal that the server raises again behind it must not be a bad one."""

    def stopped(number: int, frame: FrameType | None) -> None:
        server.should_exit = True
        recovery.stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stopped)

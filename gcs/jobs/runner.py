"""Runs estimations one after another, each in a process of its own at low priority, so that reception never waits.

The worker reads one JSON line on its standard input, reports progress as JSON lines on its standard output, and
leaves its result in a file. Closing its input ends it, so no worker outlives the service.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from gcs.analysis.flight_part import part_problem
from gcs.catalogue.aircraft_rule import STATION
from gcs.catalogue.job_table import BY_PERSON, BY_STATION, Job
from gcs.catalogue.store import Catalogue
from gcs.errors import (
    CatalogueBusyError,
    CatalogueError,
    CatalogueFileError,
    GcsError,
    JobError,
    QueueFullError,
    ServiceError,
    in_words,
)
from gcs.jobs.limits import memory_limit
from gcs.jobs.programs import Program, begin
from gcs.settings import Settings
from gcs.text.jsontext import dumps
from gcs.text.sizes import size_text
from gcs.vehicles.choice import Chosen, VehicleChoice
from gcs.vehicles.shelf import VehicleShelf
from sim_vehicle.effects import effect_called
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.model_file import model_from_json
from sim_vehicle.vehicle.vehicle_file import Vehicle

_log = logging.getLogger(__name__)

KINDS = ("identify", "discrepancy", "design")
_MODEL_FIELDS = ("model", "structure", "prior")
_STOP_TIMEOUT_S = 5.0
# The longest flights take minutes; what takes longer never ends.
_LONGEST_S = 7200.0
_RETRY_S = 5.0
# Of what a job is asked for, models included; and jobs of a flight that came to nothing.
_LONGEST_REQUEST, _MOST_FRUITLESS = 256_000, 100
# Beyond so many no more are queued: a person hears of it, a flight can be identified from its page later.
_MOST_QUEUED = {BY_PERSON: 100, BY_STATION: 50}


class CancelledError(JobError):
    """Somebody has cancelled the job; no fault of anyone."""


class NothingToDoError(JobError):
    """The recording holds nothing that the job could work on; no fault of anyone."""


def _worker_of(settings: Settings) -> tuple[str, ...]:
    """The command that runs a job, here or on a cluster."""
    if settings.scheduler is None:
        return (sys.executable, "-m", "gcs.jobs.worker")
    return (sys.executable, "-m", "gcs.jobs.clusterworker", settings.scheduler)


class JobRunner:
    """Takes queued jobs from the catalogue. `worker` is the command that runs one, by the settings if not given.

    longest_s, memory_bytes: what one job may take; memory as `memory_limit` has it unless said otherwise.
    choice: the station's aircraft, and which of them flew.
    problem: why they wait, in words, empty when all is well.
    """

    def __init__(
        self,
        settings: Settings,
        catalogue: Catalogue,
        worker: Sequence[str] = (),
        longest_s: float = _LONGEST_S,
        memory_bytes: int | None = None,
    ) -> None:
        self._settings = settings
        self._catalogue = catalogue
        self.choice = VehicleChoice(VehicleShelf(settings.vehicles, settings.vehicle), catalogue)
        self._worker = tuple(worker) or _worker_of(settings)
        self._longest_s, self._memory_bytes = longest_s, memory_bytes or memory_limit()
        self.problem = ""
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._process: Program | subprocess.Popen[str] | None = None
        self._running, self._cancelled = "", set[str]()
        self._interrupted = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="jobs", daemon=True)

    def start(self) -> None:
        """Queue again what the last stop interrupted, and begin."""
        self._settings.jobs.mkdir(parents=True, exist_ok=True)
        try:
            self._catalogue.requeue_interrupted_jobs()
        except CatalogueFileError as error:  # flights are recorded all the same
            self._report(error)
        self._thread.start()

    def stop(self) -> None:
        """End the running worker (its job is queued again at the next start) and the thread."""
        self._stopping.set()
        self._wake.set()
        with self._lock:
            if self._process is not None:
                self._process.terminate()
        if self._thread.ident is not None:
            self._thread.join(_STOP_TIMEOUT_S)

    @property
    def alive(self) -> bool:
        """Whether the thread that runs jobs is there."""
        return self._thread.is_alive()

    def submit(self, flight_id: str, request: dict[str, Any], owner: str = "") -> Job:
        """Queue a job after checking all that can be checked at once.

        request: "kind", and optionally "model", "structure", "prior" (the id of a model, or a model as JSON),
        "validate" (flight ids), "method", "from", "to" (s), "system", "rule_out" (effects), "as_recorded" (signals),
        "manoeuvres", "duration" (s), "gusts" (m/s), "limits" (by name) of a design,
        "vehicle" (an aircraft of the station, as id or id@version; without it the one that the flight is known to be);
        "automatic" where no person asked for it: a recording of nothing but the ground is then skipped, not failed.
        owner: who asks for it, where it is not the station itself.
        Raises JobError, QueueFullError, CatalogueError, VehicleError where nobody knows which aircraft it was.
        """
        kind = request.get("kind")
        if kind not in KINDS:
            raise JobError(f"kind must be one of {', '.join(KINDS)}, not {kind!r}")
        if kind != "identify" and request.get("model") is None:
            raise JobError(f"{kind} needs a model: give the id of one (GET /api/models), or the model itself")
        for name in (flight_id, *request.get("validate", ())):
            self._check_flight(name)
        self._check_part(flight_id, request)
        if kind == "discrepancy" and request.get("method", "auto") not in COMPARED_BY:
            raise JobError(f"a discrepancy's method is one of {', '.join(COMPARED_BY)}, not {request['method']}")
        _check_effects(kind, request.get("rule_out", ()))
        for name in _MODEL_FIELDS:
            if request.get(name) is not None:
                self._model(request[name], name)
        priority = BY_STATION if request.get("automatic") else BY_PERSON
        if self._catalogue.queued_jobs(priority) >= _MOST_QUEUED[priority]:
            raise QueueFullError(
                f"{_MOST_QUEUED[priority]} jobs wait already; cancel some, or ask again when they are done"
            )
        if priority == BY_PERSON:
            self._check_growth(flight_id, request)
        notes = [self._puts_aside(flight_id, kind, request)]
        chosen = self._chosen(flight_id, request)
        if chosen.vehicle.id != STATION:  # kept with the version it has now, whatever becomes of it
            request = {**request, "vehicle": chosen.vehicle.reference}
            notes.append(f"aircraft: {chosen.vehicle.vehicle.name}, version {chosen.vehicle.version} ({chosen.why})")
        job = self._catalogue.add_job(
            flight_id, kind, request, priority, "station" if priority == BY_STATION else owner
        )
        for note in filter(None, notes):
            self._catalogue.report_progress(job.id, 0.0, note)
        job = self._catalogue.job(job.id)
        self._wake.set()
        return job

    def cancel(self, job_id: str) -> Job:
        """End a job that waits or runs; as it is then. JobError if it is over, CatalogueError if there is none."""
        job = self._catalogue.job(job_id)
        with self._lock:
            if not self._catalogue.cancel_job(job_id):
                raise JobError(
                    f"job {job_id} is over ({self._catalogue.job(job_id).state}); there is nothing to cancel"
                )
            self._cancelled.add(job_id)
            if self._running == job_id and self._process is not None:
                self._process.kill()
        return self._catalogue.job(job.id)

    def delete(self, job_id: str) -> None:
        """Forget a job with its result and model. JobError while it waits or runs, CatalogueError if there is none."""
        self._catalogue.job(job_id)
        if not self._catalogue.delete_job(job_id):
            raise JobError(f"job {job_id} is not over; POST /api/jobs/{job_id}/cancel ends it")

    def _check_flight(self, flight_id: str) -> None:
        """Raises JobError for a flight that no job can use."""
        flight = self._catalogue.flight(flight_id)
        if flight.state == "recording":
            raise JobError(f"flight {flight_id} is still being recorded; wait until it has ended")
        self._recordings(flight_id)
        if flight.system is None:
            raise JobError(f"flight {flight_id} holds no message of a vehicle; choose another")

    def _check_growth(self, flight_id: str, request: dict[str, Any]) -> None:
        """Raises JobError where people keep more of a flight's jobs than anybody looks at."""
        if len(dumps(request)) > _LONGEST_REQUEST:
            raise JobError(
                f"a job's models and settings may take {size_text(_LONGEST_REQUEST)}; name models by their ids"
            )
        if self._catalogue.fruitless_jobs(flight_id) >= _MOST_FRUITLESS:
            raise JobError(
                f"{_MOST_FRUITLESS} jobs of flight {flight_id} came to nothing; delete some (DELETE /api/jobs/ID)"
            )

    def aircraft_of(self, job: Job) -> Vehicle:
        """The aircraft that a job was for. Raises CatalogueError, VehicleError, VehicleFileError."""
        return self._chosen(job.flight_id, job.request).vehicle.vehicle

    def _chosen(self, flight_id: str, request: dict[str, Any]) -> Chosen:
        """The aircraft that a job is for. Raises CatalogueError, VehicleError, VehicleFileError."""
        if request.get("vehicle"):
            return Chosen(self.choice.shelf.get(request["vehicle"]), "named in the job")
        return self.choice.of(self._catalogue.flight(flight_id))

    def _check_part(self, flight_id: str, request: dict[str, Any]) -> None:
        """Raises JobError for a part of the flight that is none."""
        start, stop = request.get("from"), request.get("to")
        if problem := part_problem(start, stop):
            raise JobError(problem)
        flight = self._catalogue.flight(flight_id)
        lasts = flight.vehicle_s
        if start is not None and lasts is not None and start >= lasts:
            raise JobError(f"from ({start:g} s) is beyond the flight's end: it lasts {lasts:.1f} s")

    def _puts_aside(self, flight_id: str, kind: str, request: dict[str, Any]) -> str:
        """What is to be known where a result that nothing judges is to be newer than one judged on other flights."""
        if kind != "identify" or request.get("validate"):
            return ""
        try:
            job, result = self._catalogue.job_and_result(flight_id, kind)
        except CatalogueError:
            return ""
        judges = (result.get("validation") or {}).get("flights", [])
        if not judges:
            return ""
        return (
            f"the newest result so far was validated on {', '.join(map(str, judges))}; this job names no flight to"
            ' validate on ("validate": [FLIGHT]), and its result will be the newest. The validated one stays at'
            f" /api/flights/{flight_id}/identification?job={job}"
        )

    def _model(self, given: str | dict[str, Any], where: str) -> dict[str, Any]:
        data = self._catalogue.model(given) if isinstance(given, str) else given
        try:
            model_from_json(data, where)
        except SimVehicleError as error:
            raise JobError(str(error)) from error
        return data

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self._run_next()
            except Exception as error:  # the thread goes on whatever happens
                self._report(error)
                self._stopping.wait(_RETRY_S)

    def _report(self, error: Exception) -> None:
        problem = f"jobs wait: {in_words(error)}"
        _log.error("%s", problem)
        # That others write the catalogue it says itself, for as long as they do.
        self.problem = "" if isinstance(error, CatalogueBusyError) else problem
        self._interrupted = True  # whichever ran has no result now

    def _run_next(self) -> None:
        """Run the oldest queued job, or wait for one."""
        if self._interrupted:
            self._catalogue.requeue_interrupted_jobs("the catalogue could not be written")
            self._interrupted = False
        job = self._catalogue.take_job()
        self.problem = ""
        if job is None:
            self._wake.wait()
            self._wake.clear()
            return
        try:
            with tempfile.TemporaryDirectory(prefix=f"{job.id}-", dir=self._settings.jobs) as folder:
                result = self._execute(job, Path(folder))
                if result is not None:
                    self._catalogue.finish_job(job, result)
        except CancelledError:
            _log.info("job %s was cancelled", job.id)
        except NothingToDoError as reason:
            self._catalogue.skip_job(job.id, str(reason))
        except CatalogueFileError:
            raise
        except (GcsError, SimVehicleError, OSError) as error:
            self._catalogue.fail_job(job.id, str(error))
        except Exception as error:  # as a worker that answers what nobody expects
            _log.error("job %s failed: %s", job.id, in_words(error))
            self._catalogue.fail_job(job.id, in_words(error))

    def _execute(self, job: Job, folder: Path) -> dict[str, Any] | None:
        """The result, None if the service is being stopped; JobError with the worker's reason."""
        order = self._order(job, folder)
        errors = folder / "stderr"
        with errors.open("w", encoding="utf-8") as stderr:
            try:
                process = begin(self._worker, None, stderr.fileno())
            except ServiceError:  # begun at the next start; no other job is taken until this one is asked to stop
                self._stopping.wait()
                return None
        with self._lock:
            self._process, self._running = process, job.id
            if self._stopping.is_set() or job.id in self._cancelled:
                process.kill()
        assert process.stdin is not None
        assert process.stdout is not None
        late = threading.Event()
        watchdog = threading.Timer(self._longest_s, end_late, (process, late))
        watchdog.daemon = True
        watchdog.start()
        try:
            with contextlib.suppress(BrokenPipeError):  # it died at its start; exit code and last words say why
                process.stdin.write(dumps(order) + "\n")
                process.stdin.flush()
            last = self._follow(job, process.stdout)
            code = process.wait()
        except BaseException:
            process.kill()
            process.wait()
            raise
        finally:
            watchdog.cancel()
            with contextlib.suppress(BrokenPipeError):  # closing writes what the dead worker did not take
                process.stdin.close()
            process.stdout.close()
            with self._lock:
                self._process, self._running = None, ""
        if job.id in self._cancelled:
            raise CancelledError("cancelled")
        if self._stopping.is_set():
            return None
        if late.is_set():
            raise JobError(f"it was not done after {self._longest_s / 60.0:g} minutes; take a part of the flight")
        if "nothing" in last:
            raise NothingToDoError(last["nothing"])
        if "error" in last:
            raise JobError(last["error"])
        if code != 0:
            raise JobError(last_words(code, errors))
        return dict(json.loads(Path(order["output"]).read_text(encoding="utf-8")))

    def _follow(self, job: Job, lines: IO[str]) -> dict[str, str]:
        """Store progress until the worker's output ends; what it said last: an "error", or that there is "nothing"."""
        last: dict[str, str] = {}
        for line in lines:
            try:
                report = json.loads(line)
            except json.JSONDecodeError:
                report = {"log": line.rstrip()}  # a library that prints
            if not isinstance(report, dict):
                continue
            if isinstance(cost := report.get("cost"), dict):
                self._catalogue.note_cost(job.id, _number(cost.get("cpu_s")), int(_number(cost.get("peak_bytes"))))
                continue
            last |= {key: str(report[key]) for key in ("error", "nothing") if key in report}
            self._catalogue.report_progress(job.id, _number(report.get("progress")), str(report.get("log", "")))
        return last

    def _order(self, job: Job, folder: Path) -> dict[str, Any]:
        """What the worker is to do; the paths in it are the service's own, none comes from a client."""
        request = job.request
        models: dict[str, Path] = {}
        for name in _MODEL_FIELDS:
            if request.get(name) is not None:
                models[name] = folder / f"{name}.json"
                models[name].write_text(dumps(self._model(request[name], name)), encoding="utf-8")
        return {
            "kind": job.kind,
            "recordings": self._recordings(job.flight_id),
            "validate": [path for flight in request.get("validate", ()) for path in self._recordings(flight)],
            "vehicle": self._chosen(job.flight_id, request).vehicle.vehicle.path,
            "models": models,
            "method": request.get("method", "auto"),
            "start": request.get("from"),
            "stop": request.get("to"),
            "system": request.get("system"),
            "rule_out": request.get("rule_out", ()),
            "as_recorded": request.get("as_recorded", ()),
            "automatic": request.get("automatic", False),
            "plan": {
                **{key: request[key] for key in ("manoeuvres", "duration", "gusts", "limits") if key in request},
                "method": self._identified_by(job.flight_id),
            },
            "memory_bytes": self._memory_bytes,
            "output": folder / "result.json",
        }

    def _identified_by(self, flight_id: str) -> str | None:
        """The method of the newest identification of a flight, None where there is none."""
        with contextlib.suppress(CatalogueError):
            return str(self._catalogue.result(flight_id, "identify").get("method"))
        return None

    def _recordings(self, flight_id: str) -> list[Path]:
        return self._catalogue.flight(flight_id).kept_files(self._settings.flights)


# Methods of a comparison; an identification has more.
COMPARED_BY = ("auto", "map", "fe")


def _check_effects(kind: str, names: Sequence[str]) -> None:
    """Raises JobError for the name of no effect, and where none is looked for."""
    if names and kind != "discrepancy":
        raise JobError('rule_out is of jobs of the kind "discrepancy"; an identification looks for no effects')
    try:
        for name in names:
            effect_called(name)
    except SimVehicleError as error:
        raise JobError(str(error)) from error


def _number(given: object) -> float:
    """A number as a worker reports it; 0, which as progress changes nothing, for anything else."""
    return float(given) if isinstance(given, int | float) and math.isfinite(given) else 0.0


def end_late(process: Program | subprocess.Popen[str], late: threading.Event) -> None:
    """End a program that takes too long, and say so."""
    late.set()
    process.kill()


def last_words(code: int, errors: Path) -> str:
    """Why a worker ended, by its exit code and what it wrote to standard error."""
    if code < 0:
        return f"the worker was ended by signal {-code}; is there enough memory?"
    lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"the worker failed (exit code {code}): {lines[-1] if lines else 'without a message'}"

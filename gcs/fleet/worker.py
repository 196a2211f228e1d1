"""One job where it is carried out, a flight's or a campaign's: on this machine or another; nothing of it raises."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any


def worked(flights: Sequence[str], vehicle: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The result of schema identification/1, or where `options` have a `model` (JSON) discrepancy/1, with `start_ns` of
    the first flight and `cost_s`; `error` where there is none. Several flights are a campaign's: those that cannot be
    read, and where all together have no result those that have none alone, stand in `left_out`.
    """
    from gcs.errors import GcsError
    from sim_vehicle.errors import SimVehicleError
    from sim_vehicle.vehicle.vehicle_file import load_vehicle
    from sysid.errors import SysidError

    begun, starts = time.monotonic(), dict[Path, int]()
    left_out: list[str] = []
    try:
        with TemporaryDirectory(prefix="gcs-batch-") as name, ExitStack() as opened:
            folder = Path(name)
            file = load_vehicle(_here(vehicle, folder)).path
            job = partial(_result, vehicle=file, options=options, folder=folder)
            starts = _opened(flights, folder, opened, left_out)
            if not starts:
                raise GcsError("; ".join(left_out))
            try:
                result = job(list(starts))
            except (GcsError, SysidError) as error:
                usable = _usable(list(starts), job, left_out) if not _is_passing(error) else []
                if not 0 < len(usable) < len(starts):
                    raise
                starts = {path: starts[path] for path in usable}
                result = job(usable)
        kept = {key: value for key, value in result.items() if key != "series"}
        kept["warnings"] = [*(f"left out: {one}" for one in left_out), *result["warnings"]]
        about = {"start_ns": _first(starts), "cost_s": time.monotonic() - begun}
        return {**kept, **about, "flights_used": len(starts), "left_out": left_out}
    except (GcsError, SysidError, SimVehicleError) as error:
        found = _without(error, _first(starts), begun)
        return {**found, "transient": True} if _is_passing(error) else found
    except (OSError, ImportError, MemoryError) as error:  # of this machine, or a store that is not there just now
        return {**_without(error, _first(starts), begun), "transient": True}


def _opened(flights: Sequence[str], folder: Path, opened: ExitStack, left_out: list[str]) -> dict[Path, int]:
    """The recordings of all flights that can be read, with their begins, UTC ns, parts of one beside each other."""
    from gcs.inspection.info import as_recordings
    from gcs.recording.reader import Recording

    found: dict[Path, int] = {}
    for flight in flights:
        if any(path.stem == PurePosixPath(flight).stem for path in found):
            left_out.append(f"{PurePosixPath(flight).name}: another log of the same name is there")
            continue
        with _leaving_out(left_out, len(flights)):
            here = _here(flight, folder / "flights")
            (path,) = opened.enter_context(as_recordings([Path(here)]))
            found[path] = Recording(path).start_ns
    return found


def _usable(paths: Sequence[Path], job: Callable[[Sequence[Path]], object], left_out: list[str]) -> list[Path]:
    """The files of those recordings that have a result alone."""
    from gcs.recording.joined import by_recording

    recordings = by_recording(paths)
    usable: list[Path] = []
    for parts in recordings if len(recordings) > 1 else ():
        with _leaving_out(left_out, len(recordings)):
            job(parts)
            usable += parts
    return usable


@contextmanager
def _leaving_out(left_out: list[str], count: int) -> Iterator[None]:
    """What goes wrong with one of `count` flights is noted; of a single one it is the job's error, and so is what may
    go well another time.
    """
    from gcs.errors import GcsError
    from sysid.errors import SysidError

    try:
        yield
    except (GcsError, SysidError) as error:
        if count == 1 or _is_passing(error):
            raise
        left_out.append(_words(error))


def _is_passing(error: BaseException) -> bool:
    """Whether an error is this machine's, or its store's, and none of the flight."""
    from gcs.errors import DiskFullError

    return isinstance(error, DiskFullError) or isinstance(error.__context__, OSError)


def _first(starts: Mapping[Path, int]) -> int:
    return min((one for one in starts.values() if one), default=0)


def _result(paths: Sequence[Path], vehicle: Path, options: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    from gcs.analysis.postflight import discrepancy, identify

    others = {key: value for key, value in options.items() if key != "model"}
    if "model" not in options:
        return identify(paths, vehicle, **others)
    model = folder / "model.json"
    model.write_text(json.dumps(options["model"]), encoding="utf-8")
    return discrepancy(paths, vehicle, model, **others)


def _without(error: BaseException, start_ns: int, begun: float) -> dict[str, Any]:
    return {"error": _words(error), "start_ns": start_ns, "cost_s": time.monotonic() - begun}


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _here(place: str, folder: Path) -> str:
    """A file of this machine: that of an address is fetched."""
    if "://" not in place:
        return place
    import fsspec  # type: ignore[import-untyped]

    folder.mkdir(exist_ok=True)
    target = folder / PurePosixPath(place).name
    with fsspec.open(place, "rb") as source, target.open("wb") as copy:
        shutil.copyfileobj(source, copy)
    return str(target)

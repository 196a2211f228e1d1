"""One job where it is carried out, a flight's or a campaign's: on this machine or another; nothing of it raises."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any


def worked(flights: Sequence[str], vehicle: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The result of schema identification/1, or where `options` have a `model` (JSON) discrepancy/1, with `start_ns` of
    the first flight and `cost_s`; `error` where there is none. A campaign does without those of its flights that have
    no result alone.
    """
    from gcs.errors import GcsError
    from gcs.inspection.info import as_recordings
    from gcs.recording.reader import Recording
    from sim_vehicle.errors import SimVehicleError
    from sim_vehicle.vehicle.vehicle_file import load_vehicle
    from sysid.errors import SysidError

    begun, start_ns = time.monotonic(), 0
    try:
        with TemporaryDirectory(prefix="gcs-batch-") as name, ExitStack() as opened:
            folder = Path(name)
            file = load_vehicle(_here(vehicle, folder)).path
            job = partial(_result, vehicle=file, options=options, folder=folder)
            paths: list[Path] = []
            left_out: list[str] = []
            for place, flight in enumerate(flights):
                with _leaving_out(left_out, len(flights)):
                    here = _here(flight, folder / str(place))
                    (path,) = opened.enter_context(as_recordings([Path(here)]))
                    begin_ns = Recording(path).start_ns
                    start_ns = min(start_ns or begin_ns, begin_ns)
                    paths.append(path)
            if not paths:
                raise GcsError("; ".join(left_out))
            try:
                result = job(paths)
            except (GcsError, SysidError):
                # It names no flight that it might do without.
                usable = []
                for path in paths if len(paths) > 1 else ():
                    with _leaving_out(left_out, len(paths)):
                        job([path])
                        usable.append(path)
                if not 0 < len(usable) < len(paths):
                    raise
                result = job(usable)
        kept = {key: value for key, value in result.items() if key != "series"}
        kept["warnings"] = [*left_out, *result["warnings"]]
        return {**kept, "start_ns": start_ns, "cost_s": time.monotonic() - begun}
    except (GcsError, SysidError, SimVehicleError) as error:
        return _without(error, start_ns, begun)
    except (OSError, ImportError, MemoryError) as error:  # of this machine, or a store that is not there just now
        return {**_without(error, start_ns, begun), "transient": True}


@contextmanager
def _leaving_out(left_out: list[str], count: int) -> Iterator[None]:
    """What goes wrong with one of `count` flights is noted; of a single one it is the job's error."""
    from gcs.errors import GcsError
    from sysid.errors import SysidError

    try:
        yield
    except (GcsError, SysidError) as error:
        if count == 1:
            raise
        left_out.append(f"left out: {_words(error)}")


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

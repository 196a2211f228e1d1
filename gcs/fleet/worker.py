"""One flight's job where it is carried out: on this machine or another; nothing of it raises."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any


def worked(source: str, vehicle: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The result of schema identification/1, or where `options` have a `model` (JSON) discrepancy/1, with `start_ns` of
    the flight and `cost_s`; `error` where there is none.
    """
    from gcs.analysis.postflight import discrepancy, identify
    from gcs.errors import GcsError
    from gcs.inspection.info import as_recordings
    from gcs.recording.reader import Recording
    from sim_vehicle.errors import SimVehicleError
    from sim_vehicle.vehicle.vehicle_file import load_vehicle
    from sysid.errors import SysidError

    begun, start_ns = time.monotonic(), 0
    try:
        with TemporaryDirectory(prefix="gcs-batch-") as folder:
            flight, craft = _here(source, Path(folder)), _here(vehicle, Path(folder))
            with as_recordings([Path(flight)]) as paths:
                start_ns = Recording(paths[0]).start_ns
                file = load_vehicle(craft).path
                others = {key: value for key, value in options.items() if key != "model"}
                if "model" in options:
                    model = Path(folder) / "model.json"
                    model.write_text(json.dumps(options["model"]), encoding="utf-8")
                    result = discrepancy(paths, file, model, **others)
                else:
                    result = identify(paths, file, **others)
        found = {key: value for key, value in result.items() if key != "series"}
        return {**found, "start_ns": start_ns, "cost_s": time.monotonic() - begun}
    except (GcsError, SysidError, SimVehicleError) as error:
        return _without(error, start_ns, begun)
    except (OSError, ImportError, MemoryError) as error:  # of this machine, or a store that is not there just now
        return {**_without(error, start_ns, begun), "transient": True}


def _without(error: BaseException, start_ns: int, begun: float) -> dict[str, Any]:
    words = " ".join(str(error).split()) or type(error).__name__
    return {"error": words, "start_ns": start_ns, "cost_s": time.monotonic() - begun}


def _here(place: str, folder: Path) -> str:
    """A file of this machine: that of an address is fetched."""
    if "://" not in place:
        return place
    import fsspec  # type: ignore[import-untyped]

    target = folder / PurePosixPath(place).name
    with fsspec.open(place, "rb") as source, target.open("wb") as copy:
        shutil.copyfileobj(source, copy)
    return str(target)

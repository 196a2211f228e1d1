"""One estimation in a process of its own: an order on standard input, progress on standard output."""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path
from typing import Any

from gcs.errors import GcsError
from gcs.jobs.limits import stand_back
from gcs.portable import used
from gcs.text.jsontext import dumps
from gcs.text.sizes import size_text
from sim_vehicle.errors import SimVehicleError
from sysid.errors import SegmentError, SysidError


def report(**fields: object) -> None:
    """Report progress=0..1, log="a line", error="the reason", or nothing="why there is nothing to do"."""
    print(dumps(fields), flush=True)


def end_with_service() -> None:
    """Wait for the end of standard input: the service has stopped, nobody wants the result."""
    for _ in sys.stdin:
        pass
    os._exit(3)


def run(order: dict[str, Any]) -> dict[str, Any]:
    """Carry out one order (see `gcs.jobs.runner`); its result. Raises GcsError, SysidError, SimVehicleError."""
    from gcs.analysis import postflight

    recordings = [Path(path) for path in order["recordings"]]
    validate = [Path(path) for path in order["validate"]]
    vehicle = Path(order["vehicle"])
    models = {name: Path(path) for name, path in order["models"].items()}

    def progress(fraction: float, line: str) -> None:
        report(progress=fraction, log=line)

    if order["kind"] == "design":
        from gcs.design.planned import planned

        return planned(vehicle, models["model"], order["plan"], progress)
    if order["kind"] == "discrepancy":
        result = postflight.discrepancy(
            recordings,
            vehicle,
            models["model"],
            validate=validate,
            ruled_out=order["rule_out"],
            method=order["method"],
            start=order["start"],
            stop=order["stop"],
            system=order["system"],
            as_recorded=order["as_recorded"],
            progress=progress,
        )
    else:
        result = postflight.identify(
            recordings,
            vehicle,
            validate=validate,
            structure=models.get("structure"),
            prior=models.get("prior"),
            method=order["method"],
            start=order["start"],
            stop=order["stop"],
            system=order["system"],
            as_recorded=order["as_recorded"],
            progress=progress,
        )
    return dict(result)


def main() -> int:
    """Read one order, run it, leave the result where the order says. Exit code 1 for a named error."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    stand_back(order["memory_bytes"])
    try:
        return _carry_out(order)
    finally:
        cpu_s, peak_bytes = used()
        report(cost={"cpu_s": cpu_s, "peak_bytes": peak_bytes})


def _carry_out(order: dict[str, Any]) -> int:
    try:
        result = run(order)
    except (GcsError, SysidError, SimVehicleError) as error:
        ground = isinstance(error, SegmentError) and order["automatic"]
        for line in getattr(error, "__notes__", ()):
            report(log=f"warning: {line}")
        report(**{"nothing" if ground else "error": str(error)})
        return 1
    except MemoryError:
        most = size_text(order["memory_bytes"])
        report(error=f"it takes more memory than {most}, the most that a job may take; take a part of the flight")
        return 1
    Path(order["output"]).write_text(dumps(result), encoding="utf-8")
    report(progress=1.0)
    return 0


if __name__ == "__main__":
    sys.exit(main())

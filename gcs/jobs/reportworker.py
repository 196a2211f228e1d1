"""What is made of one result in a process of its own: asked as JSON on standard input, its text on standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

from gcs.analysis.aircraft import aircraft_of, well_formed
from gcs.errors import GcsError
from gcs.jobs.limits import NICENESS_WAITED_FOR, memory_limit, stand_back
from gcs.text.jsontext import dumps
from sim_vehicle.errors import SimVehicleError
from sysid.errors import SysidError


def _report(result: Any) -> str:
    from gcs.report.page import report

    return report(result)


def _tuning(result: Any, autopilot: str) -> str:
    from gcs.tuning.tune import tune

    return dumps(tune(result, autopilot))


def _margins(result: Any) -> str:
    from gcs.tuning.margins import margins

    return dumps(margins(result))


def _performance(result: Any, mass: float | None, altitude: float, temperature: float | None) -> str:
    from gcs.exports.exported import Exported
    from gcs.exports.performance import performance
    from sim_vehicle.model.model_file import model_from_json

    with well_formed(result):
        model = Exported(model_from_json(result["model"], "the result's model"), aircraft_of(result)[0])
        return dumps(performance(model, mass, altitude, temperature))


_MAKERS: dict[str, Callable[..., str]] = {
    "report": _report, "tuning": _tuning, "margins": _margins, "performance": _performance,
}  # fmt: skip


def main() -> int:
    """Write the text. Exit code 1 with the reason on standard error where the result does not give it."""
    stand_back(memory_limit(), NICENESS_WAITED_FOR)
    asked = json.load(sys.stdin)
    try:
        sys.stdout.write(_MAKERS[asked["make"]](asked["result"], **asked["settings"]))
    except (GcsError, SimVehicleError, SysidError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

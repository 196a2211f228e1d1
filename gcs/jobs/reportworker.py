"""What is made of one result in a process of its own: asked as JSON on standard input, its text on standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

from gcs.analysis.aircraft import aircraft_of, well_formed
from gcs.errors import GcsError
from gcs.exports.exported import Exported
from gcs.exports.performance import performance
from gcs.jobs.limits import NICENESS_WAITED_FOR, memory_limit, stand_back
from gcs.jobs.reports import NOT_GIVEN
from gcs.report.page import report
from gcs.text.jsontext import dumps
from gcs.tuning.margins import margins
from gcs.tuning.tune import tune
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.model_file import model_from_json
from sysid.errors import SysidError


def _tuning(result: Any, autopilot: str) -> str:
    return dumps(tune(result, autopilot))


def _margins(result: Any) -> str:
    return dumps(margins(result))


def _performance(
    result: Any, mass: float | None, altitude: float, temperature: float | None, battery: float | None
) -> str:
    with well_formed(result):
        model = Exported(model_from_json(result["model"], "the result's model"), aircraft_of(result)[0])
        return dumps(performance(model, mass, altitude, temperature, powered=result.get("battery"), battery=battery))


_MAKERS: dict[str, Callable[..., str]] = {
    "report": report, "tuning": _tuning, "margins": _margins, "performance": _performance,
}  # fmt: skip


def main() -> int:
    """Write the text, or the reason on standard error where the result does not give it."""
    stand_back(memory_limit(), NICENESS_WAITED_FOR)
    asked = json.load(sys.stdin)
    try:
        sys.stdout.write(_MAKERS[asked["make"]](asked["result"], **asked["settings"]))
    except (GcsError, SimVehicleError, SysidError) as error:
        print(error, file=sys.stderr)
        return NOT_GIVEN
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A form put into the text of a vehicle file in a process of its own: some texts take long, whatever their size."""

from __future__ import annotations

import json
import os
import sys
import threading
from typing import Any

from gcs import portable
from gcs.text.jsontext import dumps
from gcs.vehicles.document import Answers, BenchAnswer, ControlAnswer, ServoAnswer, with_answers
from sim_vehicle.errors import SimVehicleError


def main() -> int:
    """Read an order (`gcs.jobs.drafts`); the answer is the `text` with the form in it, or the `error` in words."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_service, daemon=True).start()
    portable.stand_back(order["niceness"])
    portable.limit_memory(order["memory_bytes"])
    try:
        answer = {"text": with_answers(order["text"], _answers(order["answers"]))}
    except SimVehicleError as error:
        answer = {"error": str(error)}
    except MemoryError:
        answer = {"error": "vehicle file: it takes too much memory to put the form into it; leave some of it out"}
    print(dumps(answer), flush=True)
    return 0


def _end_with_service() -> None:
    sys.stdin.read()
    os._exit(3)


def _answers(given: dict[str, Any]) -> Answers:
    """The answers, as `dataclasses.asdict` and JSON have left them."""
    controls = {
        name: ControlAnswer(tuple(_servo(servo) for servo in one["servos"]), one["signal"], one["guessed_to"])
        for name, one in given["controls"].items()
    }
    places = {name: (x, y, z) for name, (x, y, z) in given["places"].items()}
    bench = {
        name: BenchAnswer(one["source"], one["form"], one["unit"], tuple((a, b) for a, b in one["points"]))
        for name, one in given["bench"].items()
    }
    return Answers(given["name"], given["numbers"], controls, places, bench)


def _servo(given: dict[str, Any]) -> ServoAnswer:
    return ServoAnswer(given["servo"], tuple(given["pwm_us"]), tuple(given["travel"]), given["mix"])


if __name__ == "__main__":
    sys.exit(main())

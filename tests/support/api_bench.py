"""The application on a data folder of its own, for tests of its REST interface."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from traffic import SECOND, Vehicle, batch

from gcs.api import create_app
from gcs.catalogue.store import Catalogue
from gcs.jobs.runner import JobRunner
from gcs.links.opening import open_link
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation

START = 1_800_000_000 * SECOND
TOKEN = "correct-horse-battery"
WORKER = """
import json, sys
order = json.loads(sys.stdin.readline())
print(json.dumps({"progress": 0.5, "log": "half way"}), flush=True)
model = {"schema": "model/1", "name": "found", "coefficients": {"CL_0": {"value": 0.25}}, "effects": []}
json.dump({"schema": "identification/1", "flights": ["one"], "model": model}, open(order["output"], "w"))
"""


class Bench:
    """The application on a data folder of its own."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        settings = Settings(data=folder, vehicle="iitb-mav", max_upload_bytes=1_000_000)
        self.settings = replace(settings, **changes)
        self.catalogue = Catalogue(self.settings.database)
        # The station's clock stands still ahead of the flights, whose silence must not end them meanwhile.
        self.recorder = FlightRecorder(self.settings.flights, Dialect.load(), self.catalogue, silence_s=1000.0)
        self.link = open_link("udpin:127.0.0.1:0")
        self.station = RecordingStation([self.link], self.recorder, clock=lambda: START + 30 * SECOND)
        jobs = JobRunner(self.settings, self.catalogue, (sys.executable, "-c", WORKER))
        self.app = create_app(self.settings, self.catalogue, self.station, jobs)

    def record(self, system: int, seconds: int, start_ns: int) -> str:
        """A flight of ATTITUDE with a growing roll angle; its id."""
        vehicle = Vehicle(system)
        vehicle.boot_ms = 5000
        for second in range(seconds):
            frames = [vehicle.heartbeat(), vehicle.system_time()]
            for i in range(50):
                frames.append(vehicle.attitude(0.01 * (50 * second + i)))
                vehicle.boot_ms += 20
            self.recorder.feed("udpin:test", batch(frames, start_ns + second * SECOND))
        self.recorder.end_flights(start_ns + seconds * SECOND)
        return self.catalogue.flights()[0].id


def problem(answer: Any, status: int) -> str:
    """The sentence of an error, after checking its form."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == status
    assert body["detail"]
    assert "\n" not in body["detail"]
    return str(body["detail"])

"""The demonstration: simulator, UDP, recording, post-flight job and REST in real processes, then a hidden effect."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from gcs.analysis.results import discrepancy_text
from gcs.demo.truth import signal_errors
from gcs.errors import GcsError, JobError
from gcs.text.intervals import of_the_flight
from gcs.text.progress import Progress
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

VEHICLE = "iitb-mav"
# The pages of the identification and of the discrepancy analysis.
REPORT, REPORT_OF_EFFECT = "report.html", "report-effect.html"
_PATIENCE_S = 150.0
# A flight at less than this is not worth waiting for.
_SLOWEST = 1.0
# What is flown: to fit, and to judge by.
SERVICE_LOG = "service.log"
FIT, JUDGE = "elevator-3211,multisine", "elevator-doublet,aileron-doublet,rudder-doublet"


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Demo:
    """One run of the demonstration.

    folder: where everything is left. speed: flight time over wall time. hidden: effect of the second aircraft,
    NAME:KEY=VALUE.
    """

    def __init__(self, folder: Path, speed: float, seed: int, hidden: str) -> None:
        self.folder, self.speed, self.seed, self.hidden = folder, speed, seed, hidden
        self.udp, self.http = _free_port(socket.SOCK_DGRAM), _free_port(socket.SOCK_STREAM)
        self.url = f"http://127.0.0.1:{self.http}"

    def run(self) -> None:
        """Fly, identify, find the hidden effect, show what REST answers. Raises GcsError in one line."""
        began = time.monotonic()
        if (self.folder / "service").exists():
            shutil.rmtree(self.folder / "service")
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / SERVICE_LOG).open("w", encoding="utf-8") as log, self._service(log) as service:
            try:
                self._await_service(service)
                self._steps()
            finally:
                service.terminate()
                service.wait(timeout=20)
        print(f"\nDone in {time.monotonic() - began:.0f} s. Everything is in {self.folder}/; to look around:")
        print(
            f"  open {self.folder / REPORT} (the model), {self.folder / REPORT_OF_EFFECT} (the effect) in a browser, or"
        )
        print(
            f"  {Path(sys.argv[0])} serve --data {self.folder}/service --vehicle {VEHICLE}    "
            "then open the address it prints (/docs: the REST answers)"
        )

    def _steps(self) -> None:
        print(f"1. The paper's aircraft flies over UDP (a process of its own, {self.speed:g}x real time).")
        first = self._fly("flight-1", FIT, ["--taxi"])
        second = self._fly("flight-2", JUDGE, [])
        print("\n2. Identification of flight 1, judged on flight 2.")
        self._job(first, {"kind": "identify", "validate": [second]})
        result = self._get(f"/api/flights/{first}/identification")
        self._save("identification.json", result)
        self._table(result)
        print(f"\n3. Another aircraft, which hides an effect that the identified model lacks: {self.hidden}")
        third = self._fly("flight-3", FIT, ["--effect", self.hidden])
        fourth = self._fly("flight-4", JUDGE, ["--effect", self.hidden, "--set", "manoeuvre.amplitude=0.08"])
        model = next(entry["id"] for entry in self._get("/api/models") if entry["flight_id"] == first)
        self._job(third, {"kind": "discrepancy", "model": model, "validate": [fourth]})
        found = self._get(f"/api/flights/{third}/discrepancy")
        self._save("discrepancy.json", found)
        print(discrepancy_text(found))
        (self.folder / "repaired.tlog").unlink(missing_ok=True)
        repaired = self._save("model-with-effect.json", found["model"])
        self._run(["fly", "--model", str(repaired), "--manoeuvre", "cruise", "--duration", "5", "--record",
                   str(self.folder / "repaired.tlog")])  # fmt: skip
        print(f"The model with the effect is in {repaired}; sim-vehicle has flown it.")
        self._plots(result, found)
        self._reports(result, found)
        newest = self._get("/api/models")[0]
        print(f"\n4. REST answers: GET {self.url}/api/models/{newest['id']}")
        print("   " + json.dumps(self._get(f"/api/models/{newest['id']}"))[:200] + " …")
        print(f"   GET {self.url}/api/flights: {len(self._flights())} flights")

    def _service(self, log: Any) -> subprocess.Popen[bytes]:
        command = [
            sys.executable, "-m", "gcs", "serve", "--connect", f"udpin:127.0.0.1:{self.udp}", "--vehicle", VEHICLE,
            "--data", str(self.folder / "service"), "--port", str(self.http), "--silence", "4", "--no-identify",
        ]  # fmt: skip
        return subprocess.Popen(command, stdout=log, stderr=log)

    def _await_service(self, service: subprocess.Popen[bytes]) -> None:
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            if service.poll() is not None:
                raise GcsError(f"the service ended at once; its words are in {self.folder}/service.log")
            try:
                self._get("/api/health")
                return
            except (JobError, OSError):
                time.sleep(0.1)
        raise GcsError(f"the service does not answer on {self.url}; its words are in {self.folder}/service.log")

    def _run(self, arguments: list[str]) -> None:
        done = subprocess.run([sys.executable, "-m", "sim_vehicle", *arguments], stdout=subprocess.DEVNULL, check=False)
        if done.returncode != 0:
            raise GcsError(f"the simulator ended with code {done.returncode}")

    def _fly(self, name: str, manoeuvres: str, more: list[str]) -> str:
        """Fly over UDP; the id of the recorded flight."""
        before = {flight["id"] for flight in self._flights()}
        self.seed += 1
        print(f"   {name}: {manoeuvres} {' '.join(more)}".rstrip(), flush=True)
        self._run(["fly", "--vehicle", VEHICLE, "--manoeuvre", manoeuvres, "--seed", str(self.seed), "--out",
                   f"udpout:127.0.0.1:{self.udp}", "--speed", str(self.speed), "--truth",
                   str(self.folder / f"{name}.truth.json"), *more])  # fmt: skip
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            new = [flight for flight in self._flights() if flight["id"] not in before]
            if new and all(flight["state"] != "recording" for flight in new):
                if len(new) > 1:
                    return self._fly_slower(name, manoeuvres, more, len(new))
                return self._check_complete(str(new[0]["id"]))
            time.sleep(0.2)
        raise GcsError(
            f"{name} was flown but no recording appeared; the service's words are in {self.folder}/service.log"
        )

    def _fly_slower(self, name: str, manoeuvres: str, more: list[str], pieces: int) -> str:
        """The same flight again at half the speed: what holds the stream up may be another program's work."""
        what = f"{name} came in {pieces} pieces: this machine is busy, it held the stream up for seconds"
        if self.speed <= _SLOWEST:
            raise GcsError(f"{what}; run the demonstration when it has less to do")
        self.speed = max(self.speed / 2.0, _SLOWEST)
        self.seed -= 1
        print(f"      {what}; flown again at {self.speed:g}x", flush=True)
        return self._fly(name, manoeuvres, more)

    def _check_complete(self, flight: str) -> str:
        summary = self._get(f"/api/flights/{flight}")
        lost = sum(entry["lost"] for entry in summary.get("components", []))
        print(f"      recorded as {flight}: {summary['messages']} messages, {lost} lost by the sequence counters")
        return flight

    def _job(self, flight: str, request: dict[str, Any]) -> None:
        job = self._get(f"/api/flights/{flight}/jobs", request)
        with Progress() as progress:
            while job["state"] in ("queued", "running"):
                log = job.get("log") or [""]
                progress(job.get("progress") or 0.0, str(log[-1]))
                time.sleep(0.3)
                job = self._get(f"/api/jobs/{job['id']}")
        if job["state"] != "done":
            raise JobError(f"the {request['kind']} job failed: {job.get('error')}")

    def _flights(self) -> list[dict[str, Any]]:
        answer = self._get("/api/flights?limit=100")
        found: list[dict[str, Any]] = answer if isinstance(answer, list) else answer["flights"]
        return found

    def _get(self, path: str, body: dict[str, Any] | None = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, data, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                detail = error.read().decode(errors="replace")
            raise JobError(f"{path} answers {error.code}: {detail[:300]}") from None

    def _save(self, name: str, content: Any) -> Path:
        path = self.folder / name
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        return path

    def _table(self, result: dict[str, Any]) -> None:
        """Estimates beside the truth that the simulator flew."""
        truth = read_model(VEHICLE).values()
        flown = json.loads((self.folder / "flight-1.truth.json").read_text(encoding="utf-8"))["sensor_errors"]
        hidden = signal_errors(load_vehicle(VEHICLE), flown, result["sensor_errors"])
        print(f"   {'':<18}{'true':>11}{'estimate':>12}{'std error':>12}{'of flight':>12}{'off by':>10}")
        rows = [(name, truth.get(name, 0.0), entry) for name, entry in result["model"]["coefficients"].items()]
        rows += [(name, hidden[name], entry) for name, entry in result["sensor_errors"].items() if name in hidden]
        for name, true, entry in rows:
            if "refused" in entry:
                print(f"   {name:<18}{true:>11.5f}  refused: {entry['refused']}")
                continue
            value, std, own = entry["value"], entry["std"], of_the_flight(entry) or entry["std"]
            print(f"   {name:<18}{true:>11.5f}{value:>12.5f}{std:>12.5f}{own:>12.5f}{abs(value - true) / own:>8.1f}")
        print(
            "   Standard errors hold what a vehicle file is usually wrong by (mass 1 %, inertia and travel 5 %, density"
            " 2 %); here it is exact, and\n   errors are counted in those of the flight and its bench alone."
        )
        validation = result["validation"]
        scores = ", ".join(f"{axis} {entry['tic']:.3f}" for axis, entry in validation["outputs"].items())
        print(f"   on flight 2, Theil's inequality coefficient: {scores} ({validation['reason']})")
        if validation.get("outliers"):
            print(f"   {validation['outliers']}")

    def _plots(self, result: dict[str, Any], found: dict[str, Any]) -> None:
        from gcs.demo.plots import draw

        picture = self.folder / "demo.png"
        draw(result, read_model(VEHICLE).values(), found, picture)
        print(f"   A picture of both results is in {picture}")

    def _reports(self, result: dict[str, Any], found: dict[str, Any]) -> None:
        """Both results as pages, as gcs report makes them."""
        from gcs.report.page import report

        for name, one in ((REPORT, result), (REPORT_OF_EFFECT, found)):
            (self.folder / name).write_text(report(one), encoding="utf-8")
        print(f"   Reports to read and print are {self.folder / REPORT} and {self.folder / REPORT_OF_EFFECT}")

"""The service that a page under test is served by."""

from __future__ import annotations

import signal
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from patience import PATIENCE_S
from processes import start
from traffic import wait_until


@dataclass
class Ground:
    """The service on a port that stays its own when it is stopped and started again."""

    data: Path
    http: int
    udp: int
    token: str = ""
    options: tuple[str, ...] = ()
    process: subprocess.Popen[str] | None = field(default=None, repr=False)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.http}"

    def get(self, path: str) -> Any:
        return httpx.get(self.url + path, timeout=PATIENCE_S).raise_for_status().json()

    def start(self) -> None:
        command = ("serve", "--port", self.http, "--connect", f"udpin:127.0.0.1:{self.udp}", "--vehicle", "iitb-mav",
                   "--data", self.data, "--silence", 3, "--no-identify", *self.options)  # fmt: skip
        self.process = start("gcs", command, **({"GCS_TOKEN": self.token} if self.token else {}))
        assert self.process.stdout is not None
        said = self.process.stdout.readline()
        assert said.startswith("serving on "), said or self.process.communicate(timeout=PATIENCE_S)

    def wait_until_landed(self) -> None:
        """The flight before is over: what is asked for from here on is of the next one."""
        wait_until(lambda: self.get("/api/live")["flight"] is None)

    def stop(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0


def flight_with(ground: Ground, kind: str) -> str:
    """The demonstration's flight with a result of that kind: the oldest, before those that fly meanwhile."""
    return [str(model["flight_id"]) for model in ground.get("/api/models") if model["kind"] == kind][-1]

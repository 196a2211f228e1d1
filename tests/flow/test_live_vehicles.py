"""Several aircraft on one port: whom the live view follows."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from patience import PATIENCE_S
from processes import free_port, service, start
from rest import asked
from traffic import wait_until

FOR_LONG_S = 600  # they are ended when they have been seen, however busy the machine is


def told(url: str) -> dict[str, Any]:
    answer: dict[str, Any] = asked(f"{url}/api/live")
    return answer


def recording(url: str, count: int) -> list[str] | None:
    """The flights that are being recorded, once there are so many."""
    found: list[str] = asked(f"{url}/api/health")["recording"]
    return found if len(found) == count else None


def test_the_first_aircraft_is_followed_until_its_flight_ends_and_then_another(tmp_path: Path) -> None:
    port = free_port()
    to = f"udpout:127.0.0.1:{port}"
    options = ("--connect", f"udpin:127.0.0.1:{port}", "--vehicle", "iitb-mav", "--no-identify", "--data", tmp_path)
    with service(*options, "--silence", "2") as url, ExitStack() as flying:

        def fly(system: int, seconds: int) -> Any:
            aircraft = ("fly", "--manoeuvre", "multisine", "--duration", seconds, "--system", system, "--out", to)
            return flying.enter_context(start("sim-vehicle", aircraft))

        wait_until(lambda: told(url)["process"]["state"] == "running")
        first = fly(1, FOR_LONG_S)
        wait_until(lambda: (told(url)["time_s"] or 0.0) > 2.0 and told(url)["identification"])
        followed = told(url)["flight"]
        times = [told(url)["identification"]["time_s"]]

        def stays() -> None:
            now = told(url)
            assert now["flight"] == followed
            times.append(now["identification"]["time_s"])  # estimates go on, none begin anew

        second = fly(2, 6)
        wait_until(lambda: recording(url, 2))
        stays()
        second.communicate(timeout=PATIENCE_S)
        wait_until(lambda: recording(url, 1))  # the second one's flight has ended
        stays()
        since = time.monotonic()
        third = fly(3, FOR_LONG_S)
        wait_until(lambda: recording(url, 2))
        stays()
        assert times == sorted(times)
        first.terminate()
        first.communicate(timeout=PATIENCE_S)
        (left,) = wait_until(lambda: recording(url, 1))
        assert left != followed
        wait_until(lambda: told(url)["flight"] == left)
        wait_until(lambda: told(url)["signals"] and told(url)["identification"])
        assert told(url)["time_s"] < time.monotonic() - since  # the clock is the third one's
        begun = told(url)["time_s"]
        wait_until(lambda: told(url)["time_s"] > begun + 1.0)
        third.terminate()
        third.communicate(timeout=PATIENCE_S)

"""Forms put into vehicle files for the REST interface: in a process of its own, ended where it takes long."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from gcs.errors import BusyError, ServiceError, VehicleError
from gcs.jobs.limits import NICENESS_WAITED_FOR, memory_limit
from gcs.jobs.one_shot_process import AskedOnce
from gcs.settings import Settings
from gcs.vehicles.document import Answers
from sim_vehicle.errors import VehicleFileError

# What the largest file takes is a second.
_LONGEST_S = 5.0
# One is worked on, the others wait; each of them keeps a thread that others need.
_MOST_PLACES = 2


class Drafts:
    """Puts one form at a time into a text. `worker` is the command that does it, within `longest_s`."""

    def __init__(
        self,
        settings: Settings,
        worker: Sequence[str] = (sys.executable, "-m", "gcs.vehicles.formworker"),
        longest_s: float = _LONGEST_S,
    ) -> None:
        self._settings = settings
        self._writer = AskedOnce(worker, longest_s)
        self._places = threading.BoundedSemaphore(_MOST_PLACES)

    def filled(self, text: str, answers: Answers) -> str:
        """`gcs.vehicles.document.with_answers`.

        Raises VehicleFileError where that does or takes too long, BusyError where others wait for theirs, ServiceError
        when the service is being stopped.
        """
        if not self._places.acquire(blocking=False):
            raise BusyError("other aircraft are being described; ask again in a moment")
        order = {
            "text": text,
            "answers": asdict(answers),
            "niceness": NICENESS_WAITED_FOR,
            "memory_bytes": memory_limit(),
        }
        try:
            with TemporaryDirectory(prefix="draft-", dir=self._settings.data) as folder:
                return str(self._writer.ask(order, Path(folder), "the vehicle file", VehicleError)["text"])
        except VehicleError as error:
            raise VehicleFileError(str(error)) from error
        except OSError as error:
            reason = f"{self._settings.data}: {error.strerror or error}"
            raise ServiceError(f"{reason}; a form needs a little room there, a text alone none") from error
        finally:
            self._places.release()

    def close(self) -> None:
        """End what is being worked on; nothing more is taken."""
        self._writer.close()

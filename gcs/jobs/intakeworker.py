"""One upload made a recording in a process of its own: what a hostile file does to it does not reach the service."""

from __future__ import annotations

import json
import os
import resource
import sys
import threading
from dataclasses import asdict
from pathlib import Path

from gcs.catalogue.intake import describe
from gcs.errors import GcsError
from gcs.formats.conversion import import_file
from gcs.jobs.worker import NICENESS, end_with_service, report
from gcs.text.sizes import size_text
from sim_vehicle.errors import SimVehicleError

_FIRST_TO_END = "1000"


def _stand_back(memory_bytes: int) -> None:
    """Low priority, bounded memory, and the first to be ended where the machine has none left."""
    os.nice(NICENESS)
    # A recording that is mapped for reading does not count; what is allocated does.
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    if sys.platform == "linux":
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_END, encoding="ascii")


def main() -> int:
    """Read an order (`gcs.jobs.uploads`), write the recording; the answer is its `flight`, or the `error` in words."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    target = Path(order["target"])
    _stand_back(order["memory_bytes"])
    try:
        import_file(Path(order["source"]), target, order["ending"], name=order["name"])
        report(flight=asdict(describe([target], "", order["name"], "upload", "recording")))
    except (GcsError, SimVehicleError) as error:
        report(error=str(error))
    except MemoryError:
        report(error=f"it takes more memory to read than {size_text(order['memory_bytes'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

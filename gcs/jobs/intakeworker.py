"""One upload made a recording in a process of its own: what a hostile file does to it does not reach the service."""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import asdict
from pathlib import Path

from gcs.catalogue.intake import describe
from gcs.errors import GcsError
from gcs.formats.conversion import import_file
from gcs.jobs.limits import stand_back
from gcs.jobs.worker import end_with_service, report
from gcs.text.sizes import size_text
from sim_vehicle.errors import SimVehicleError


def main() -> int:
    """Read an order (`gcs.jobs.uploads`), write the recording; the answer is its `flight`, or the `error` in words."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    target = Path(order["target"])
    stand_back(order["memory_bytes"])
    try:
        columns = Path(order["columns"]) if order["columns"] else None
        import_file(Path(order["source"]), target, order["ending"], name=order["name"], columns=columns)
        report(flight=asdict(describe([target], "", order["name"], "upload", "recording")))
    except (GcsError, SimVehicleError) as error:
        report(error=str(error))
    except MemoryError:
        report(error=f"it takes more memory to read than {size_text(order['memory_bytes'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

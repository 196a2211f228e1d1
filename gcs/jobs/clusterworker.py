"""One estimation on a worker of a Dask cluster: the order of `gcs.jobs.worker`, and its words, passed on both ways.

Run by the service as `python -m gcs.jobs.clusterworker tcp://HOST:PORT`. The worker reads the recordings itself, by the
names that the station knows them by, and runs the job in a process of its own, which ends where nobody waits for it any
more.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import uuid
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.jobs.worker import end_with_service, report
from gcs.text.jsontext import dumps

# How often the station says that it still waits, and after what silence a worker no longer believes it, s.
_EVERY_S, _GONE_S = 2.0, 20.0


def carried_out(order: dict[str, Any], topic: str) -> tuple[int, list[str], str, str]:
    """Carry out an order on this worker: exit code, what it said of its end, last line of standard error, and the
    result as JSON or nothing.

    topic: under which its progress goes to the station, and that the station waits to it.
    """
    from distributed import Variable, get_client, get_worker

    worker, waits = get_worker(), Variable(topic, client=get_client())  # type: ignore[no-untyped-call]
    with TemporaryDirectory(prefix="gcs-job-") as folder:
        output, errors = Path(folder) / "result.json", Path(folder) / "errors"
        with errors.open("w") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-m", "gcs.jobs.worker"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, text=True,
            )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None

        def watch() -> None:
            """Closing its input ends the process."""
            said, silent_s = None, 0.0
            while process.poll() is None and silent_s < _GONE_S:
                over.wait(_EVERY_S)
                try:
                    now = waits.get(timeout=_EVERY_S)  # type: ignore[no-untyped-call]
                except (TimeoutError, OSError):
                    now = said
                silent_s = 0.0 if now != said else silent_s + _EVERY_S
                said = now
            process.kill()

        over, last = threading.Event(), list[str]()
        threading.Thread(target=watch, daemon=True).start()
        try:
            process.stdin.write(dumps({**order, "output": str(output)}) + "\n")
            process.stdin.flush()
            for line in process.stdout:
                # Events may be overtaken by the result.
                if "progress" in line or "log" in line:
                    worker.log_event(topic, line)
                else:
                    last.append(line)
            code = process.wait()
        except BrokenPipeError:  # it died at its start; exit code and last words say why
            code = process.wait()
        finally:
            process.kill()
            over.set()
        lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return code, last, lines[-1] if lines else "", output.read_text(encoding="utf-8") if output.exists() else ""


def main() -> int:
    """Read one order, have it carried out, leave the result where the order says. Exit code 1 for a named error."""
    from distributed import Client, KilledWorker, Variable

    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    address, topic = sys.argv[1], f"gcs-job-{uuid.uuid4()}"
    try:
        client = Client(address, timeout="10s", set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        report(error=f"no scheduler answers at {address} ({error}); start one, or serve without --scheduler")
        return 1
    with client:
        waits = Variable(topic, client=client)  # type: ignore[no-untyped-call]
        client.subscribe_topic(topic, lambda event: print(event[1], end="", flush=True))  # type: ignore[no-untyped-call]
        over = threading.Event()

        def wait_on() -> None:
            count = 0
            while not over.wait(_EVERY_S if count else 0.0):
                count += 1
                waits.set(count)  # type: ignore[no-untyped-call]

        threading.Thread(target=wait_on, daemon=True).start()
        if not client.scheduler_info()["workers"]:
            report(log=f"waiting for a worker of {address}")
        future = client.submit(carried_out, order, topic, pure=False, retries=2)
        try:
            code, last, words, result = future.result()
        except KilledWorker:
            report(error="several workers were lost over it; do they have enough memory?")
            return 1
        except FileNotFoundError as error:
            report(error=f"the worker does not see the station's files: {error.filename}")
            return 1
        finally:
            over.set()
            waits.delete()  # type: ignore[no-untyped-call]
        client.unsubscribe_topic(topic)  # type: ignore[no-untyped-call]
    print(*last, sep="", end="", flush=True)
    if code == 0:
        Path(order["output"]).write_text(result, encoding="utf-8")
    elif words:
        print(words, file=sys.stderr)
    return code


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    # The cluster's threads are nobody's business any more.
    os._exit(code if code >= 0 else 1)

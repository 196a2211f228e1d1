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
import time
import uuid
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.errors import in_words
from gcs.jobs.limits import memory_limit
from gcs.jobs.runner import last_words
from gcs.jobs.worker import end_with_service, report
from gcs.text.jsontext import dumps

# How often the station says that it still waits, and after what silence a worker no longer believes it, s.
_EVERY_S, _GONE_S = 2.0, 20.0
# A cluster without a worker for so long is none, s.
_NO_WORKER_S = 60.0


def carried_out(order: dict[str, Any], topic: str) -> tuple[int, list[str], str, str]:
    """Carry out an order on this worker: exit code, what it said of its end, why it failed, and the result as JSON or
    nothing.

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
            said, heard = None, time.monotonic()
            while process.poll() is None and time.monotonic() - heard < _GONE_S:
                over.wait(_EVERY_S)
                try:
                    now = waits.get(timeout=_EVERY_S)  # type: ignore[no-untyped-call]
                except Exception:  # whatever becomes of the connection, nobody is heard
                    now = said
                heard = heard if now == said else time.monotonic()
                said = now
            process.kill()

        over, last = threading.Event(), list[str]()
        threading.Thread(target=watch, daemon=True).start()
        try:
            own = {"output": str(output), "memory_bytes": memory_limit()}
            process.stdin.write(dumps({**order, **own}) + "\n")
            process.stdin.flush()
            for line in process.stdout:
                # Events may be overtaken by the result.
                if _ends(line):
                    last.append(line)
                else:
                    worker.log_event(topic, line)
            code = process.wait()
        except BrokenPipeError:  # it died at its start; exit code and last words say why
            code = process.wait()
        finally:
            process.kill()
            over.set()
        why = "" if code == 0 else last_words(code, errors)
        return code, last, why, output.read_text(encoding="utf-8") if output.exists() else ""


def _ends(line: str) -> bool:
    """Whether a line says what became of the job, or what it cost."""
    try:
        said = json.loads(line)
    except json.JSONDecodeError:  # a library that prints
        return False
    return isinstance(said, dict) and bool({"error", "nothing", "cost"} & said.keys())


def main() -> int:
    """Read one order, have it carried out, leave the result where the order says. Exit code 1 for a named error."""
    from distributed import Client, KilledWorker

    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    address, topic = sys.argv[1], f"gcs-job-{uuid.uuid4()}"
    try:
        client = Client(address, timeout="10s", set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        report(error=f"no scheduler answers at {address} ({error}); start one, or serve without --scheduler")
        return 1
    with client:
        try:
            code, last, why, result = _asked(client, order, topic)
        except TimeoutError:
            report(error=f"no worker of {address} is there; start one, or serve without --scheduler")
            return 1
        except KilledWorker:
            report(error="several workers were lost over it; do they have enough memory?")
            return 1
        except Exception as error:  # of whatever the worker is, or the network
            report(error=f"the cluster at {address} could not do it: {in_words(error)}")
            return 1
    print(*last, sep="", end="", flush=True)
    if code == 0:
        Path(order["output"]).write_text(result, encoding="utf-8")
    elif not any("error" in line or "nothing" in line for line in last):
        report(error=why)
    return code


def _asked(client: Any, order: dict[str, Any], topic: str) -> tuple[int, list[str], str, str]:
    """What a worker made of an order. Raises TimeoutError where there is none."""
    from distributed import Variable

    client.wait_for_workers(1, timeout=_NO_WORKER_S)
    waits, over = Variable(topic, client=client), threading.Event()  # type: ignore[no-untyped-call]
    client.subscribe_topic(topic, lambda event: print(event[1], end="", flush=True))

    def wait_on() -> None:
        count = 0
        while not over.wait(_EVERY_S if count else 0.0):
            count += 1
            waits.set(count)  # type: ignore[no-untyped-call]

    threading.Thread(target=wait_on, daemon=True).start()
    try:
        found: tuple[int, list[str], str, str] = client.submit(
            carried_out, order, topic, pure=False, retries=2
        ).result()
    finally:
        over.set()
    waits.delete()  # type: ignore[no-untyped-call]
    client.unsubscribe_topic(topic)
    return found


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    # The cluster's threads are nobody's business any more.
    os._exit(code if code >= 0 else 1)

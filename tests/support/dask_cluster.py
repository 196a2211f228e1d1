"""A Dask scheduler and its workers, as processes of their own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from network_namespaces import Machine
from processes import free_port


@contextmanager
def cluster(count: int, apart: Sequence[Machine] = ()) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The scheduler's address, and so many workers of one thread each that have loaded what identifies.

    apart: the machines on which the workers run; this one without.
    """
    from distributed import Client

    address = f"tcp://127.0.0.1:{free_port()}"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    port = address.rpartition(":")[2]
    if apart:  # no other network reaches it
        address = f"tcp://{apart[0].gateway}:{port}"
    scheduler = subprocess.Popen([*dask, "scheduler", "--host", address, "--no-dashboard"], **quiet)
    options = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
    commands = [[*dask, "worker", address, *options]] * count
    if apart:
        commands = [[*one.command, *dask, "worker", address, "--host", one.address, *options] for one in apart[:count]]
    workers = [subprocess.Popen(command, **quiet) for command in commands]
    try:
        with Client(address, timeout="60s") as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(count, timeout=60)
            # Imports and compiled loops are the worker's, not the flight's.
            client.run(lambda: __import__("sysid.identify") and None)
        yield address, workers
    finally:
        for one in (*workers, scheduler):
            one.kill()
            one.wait()

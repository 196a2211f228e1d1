"""All jobs of a batch: those that are not done yet, where there is room for them; what is done stays done."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from gcs.errors import SettingsError
from gcs.fleet.orders import Order
from gcs.fleet.worker import identified
from gcs.text.files import write_whole
from gcs.text.jsontext import dumps

Progress = Callable[[float, str], None]
# Times that a job is begun again whose worker was lost.
_TRIES = 3


@contextmanager
def executor(workers: int | None, scheduler: str | None) -> Iterator[Executor]:
    """Where jobs run: processes of this machine, or the workers of a Dask scheduler.

    Raises SettingsError where the scheduler is not there, or Dask is not installed.
    """
    if scheduler is None:
        with ProcessPoolExecutor(workers or os.cpu_count() or 1, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise SettingsError("--scheduler needs Dask: install the extra 'fleet'") from None
    try:
        client = Client(scheduler, timeout="10s")  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise SettingsError(f"--scheduler {scheduler}: no scheduler answers there ({error})") from None
    with client:
        yield client.get_executor(pure=False, retries=_TRIES)  # type: ignore[no-untyped-call]


def run(orders: Sequence[Order], folder: Path, pool: Executor, progress: Progress) -> list[dict[str, Any]]:
    """The result of each order, in their order. folder: keeps them, and what is there already is not done again."""
    results: dict[str, dict[str, Any]] = {}
    folder.mkdir(parents=True, exist_ok=True)
    left = []
    for order in orders:
        kept = _kept(folder / f"{order.key}.json")
        if kept is None:
            left.append(order)
        else:
            results[order.key] = kept
    done = len(results)
    progress(done / len(orders), f"{done} of {len(orders)} flights were done before" if done else "starting")
    for tries in range(_TRIES):
        lost = []
        waiting: dict[Future[dict[str, Any]], Order] = {}
        try:
            waiting = {pool.submit(identified, one.source, one.vehicle, one.options): one for one in left}
            for future in as_completed(waiting):
                order = waiting.pop(future)
                try:
                    result = future.result()
                except (BrokenProcessPool, CancelledError):
                    lost.append(order)
                    continue
                except Exception as error:  # whatever a flight makes of a worker, the others go on
                    result = {"error": f"{type(error).__name__}: {error}", "start_ns": 0, "cost_s": 0.0}
                write_whole(folder / f"{order.key}.json", dumps(result))
                results[order.key] = result
                progress(
                    len(results) / len(orders), f"{len(results)} of {len(orders)} flights; {_words(order, result)}"
                )
        except BrokenProcessPool:
            lost += list(waiting.values())
        left = lost
        if not left or tries == _TRIES - 1 or isinstance(pool, ProcessPoolExecutor):
            break
    for order in left:
        results[order.key] = {"error": "its worker was lost; run the batch again", "start_ns": 0, "cost_s": 0.0}
    return [results[order.key] for order in orders]


def _kept(path: Path) -> dict[str, Any] | None:
    """A result of an earlier run; None for what is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _words(order: Order, result: dict[str, Any]) -> str:
    name = Path(order.source).name
    return f"{name}: {result['error']}" if "error" in result else f"{name}: {result['quality']['verdict']}"

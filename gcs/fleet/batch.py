"""All jobs of a batch: those that are not done yet, where there is room for them; what is done stays done."""

from __future__ import annotations

import json
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from gcs.errors import SettingsError
from gcs.fleet.orders import Order
from gcs.fleet.worker import worked
from gcs.text.files import write_whole
from gcs.text.jsontext import dumps

Progress = Callable[[float, str], None]
Result = dict[str, Any]
_LOST = "its worker ended without a word, as one does that takes more memory than there is"
# Orders under way on a cluster: enough for its workers never to wait for one.
_ON_CLUSTER = 1000


@dataclass(frozen=True)
class Places:
    """Where jobs are done. made: an executor of so many workers, None for all; width: jobs under way at once."""

    made: Callable[[int | None], Executor]
    width: int


@contextmanager
def places(workers: int | None, scheduler: str | None) -> Iterator[Places]:
    """Processes of this machine, or the workers of a Dask scheduler.

    Raises SettingsError where the scheduler is not there, or Dask is not installed.
    """
    if scheduler is None:
        count = workers or os.cpu_count() or 1
        # Spawned, so that no thread of this process is half copied; Ctrl-C is this process's to answer.
        context = get_context("spawn")
        yield Places(lambda most: ProcessPoolExecutor(most or count, context, _undisturbed), count)
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
        yield Places(lambda most: client.get_executor(pure=False), _ON_CLUSTER)  # type: ignore[no-untyped-call]


def _undisturbed() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run(orders: Sequence[Order], folder: Path, where: Places, progress: Progress) -> list[Result]:
    """The result of each order, in their order. folder: keeps them, and what is there already is not done again.

    Where a worker is lost those that were under way are done once more, one by one: one that loses its worker again is
    without a result, and the others go on.
    """
    batch = _Batch(orders, folder, progress)
    queue = deque(order for order in orders if order.key not in batch.results)
    while queue:
        for suspect in batch.work(where.made(None), queue, where.width):
            if batch.work(where.made(1), deque([suspect]), 1):
                batch.keep(suspect, _without(_LOST), final=False)
    return [batch.results[order.key] for order in orders]


class _Batch:
    """What is done."""

    def __init__(self, orders: Sequence[Order], folder: Path, progress: Progress) -> None:
        self._count, self._folder, self._progress = len(orders), folder, progress
        self.results: dict[str, Result] = {}
        folder.mkdir(parents=True, exist_ok=True)
        for order in orders:
            if (kept := _kept(self._place(order))) is not None:
                self.results[order.key] = kept
        done = len(self.results)
        progress(done / self._count, f"{done} of {self._count} were done before" if done else "starting")

    def work(self, pool: Executor, queue: deque[Order], width: int) -> list[Order]:
        """Do what is queued, as far as the workers last; those that were under way when one was lost."""
        waiting: dict[Future[Result], Order] = {}
        others = active_children()  # a pool starts its processes with the first order
        try:
            while queue or waiting:
                while queue and len(waiting) < width:
                    order = queue.popleft()
                    waiting[_submitted(pool, order)] = order
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    order = waiting.pop(future)
                    try:
                        self.keep(order, future.result(), final=True)
                    except BrokenExecutor:
                        return [order, *waiting.values()]
                    except Exception as error:  # whatever a flight makes of a worker, the others go on
                        # Dask has lost several workers over it.
                        is_lost = isinstance(error, CancelledError) or type(error).__name__ == "KilledWorker"
                        self.keep(
                            order, _without(_LOST if is_lost else f"{type(error).__name__}: {error}"), final=False
                        )
        except BaseException:
            for future in waiting:
                future.cancel()
            _end(pool, others)
            raise
        finally:
            pool.shutdown(wait=False)
        return []

    def keep(self, order: Order, result: Result, *, final: bool) -> None:
        """Take a result. final: whether another run would find the same, so that it stays."""
        if final and not result.get("transient"):
            write_whole(self._place(order), dumps(result))
        self.results[order.key] = result
        done = len(self.results)
        self._progress(done / self._count, f"{done} of {self._count}; {_words(order, result)}")

    def _place(self, order: Order) -> Path:
        return self._folder / f"{order.key}.json"


def _submitted(pool: Executor, order: Order) -> Future[Result]:
    """The promise of a result; of a pool that has just lost a worker, one that says so."""
    try:
        return pool.submit(worked, order.flights, order.vehicle, order.options)
    except BrokenExecutor as error:
        lost: Future[Result] = Future()
        lost.set_exception(error)
        return lost


def _without(why: str) -> Result:
    return {"error": why, "start_ns": 0, "cost_s": 0.0}


def _end(pool: Executor, others: Sequence[BaseProcess]) -> None:
    """End the processes that work, if they are of this machine. others: were there before them, and stay."""
    if isinstance(pool, ProcessPoolExecutor):
        for process in active_children():
            if process not in others:
                process.terminate()


def _kept(path: Path) -> Result | None:
    """A result of an earlier run; None for what is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _words(order: Order, result: Result) -> str:
    name = Path(order.source).name
    return f"{name}: {result['error']}" if "error" in result else f"{name}: {result['quality']['verdict']}"

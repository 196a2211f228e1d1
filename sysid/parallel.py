"""Work side by side: compiled loops let go of the interpreter's lock."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import local
from typing import Any, TypeVar

Result = TypeVar("Result")

_POOL = ThreadPoolExecutor(max_workers=2, thread_name_prefix="records")
_HERE = local()
_SWITCH_S = 2e-4


def side_by_side(function: Callable[..., Result], *arguments: Iterable[Any]) -> list[Result]:
    """What `function` gives for each set of arguments, in their order.

    Called from within itself it works one after the other: a thread that waits for its own pool waits for ever.
    """
    every = list(zip(*arguments, strict=True))
    if getattr(_HERE, "working", False):
        return [function(*each) for each in every]

    def work(*each: Any) -> Result:
        _HERE.working = True
        return function(*each)

    jobs = [_POOL.submit(work, *each) for each in every]
    return [job.result() for job in jobs]


@contextmanager
def begun(function: Callable[[], Result]) -> Iterator[Future[Result]]:
    """What `function` will give, worked on beside what the block does; a block that fails leaves it to its end.

    The lock changes hands more often within: a thread that comes back from a compiled loop would else wait 5 ms for it.
    """
    before = sys.getswitchinterval()
    aside = ThreadPoolExecutor(max_workers=1, thread_name_prefix="aside")
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield aside.submit(function)
    finally:
        aside.shutdown(wait=False)
        sys.setswitchinterval(before)

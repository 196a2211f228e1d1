"""Work side by side: compiled loops let go of the interpreter's lock."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import local
from typing import Any, TypeVar, cast

Result = TypeVar("Result")

_POOL = ThreadPoolExecutor(max_workers=1, thread_name_prefix="records")
_HERE = local()
_SWITCH_S = 2e-4


def side_by_side(function: Callable[..., Result], *arguments: Iterable[Any]) -> list[Result]:
    """What `function` gives for each set of arguments, in their order, on two processors.

    The caller's thread takes part, and does a single piece of work alone: what is handed over is in the wrong
    processor's cache. Called from within itself it works one after the other: a thread that waits for its own pool
    waits for ever. Raises the first error in the order of the arguments.
    """
    every = list(zip(*arguments, strict=True))
    if len(every) == 1 or getattr(_HERE, "working", False):
        return [function(*each) for each in every]
    found: list[Result | None] = [None] * len(every)
    errors: dict[int, BaseException] = {}
    places = iter(range(len(every)))  # its steps are taken under the interpreter's lock, one by one

    def work() -> None:
        _HERE.working = True
        try:
            for place in places:
                try:
                    found[place] = function(*every[place])
                except BaseException as error:
                    errors[place] = error
                    return
        finally:
            _HERE.working = False

    other = _POOL.submit(work)
    work()
    if not other.cancel():  # begun, if the pool was free
        other.result()
    if errors:
        raise errors[min(errors)]
    return cast(list[Result], found)


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

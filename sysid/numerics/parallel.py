"""Work side by side: compiled loops let go of the interpreter's lock."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from threading import Lock, local
from typing import Any, TypeVar, cast

Result = TypeVar("Result")

_POOL = ThreadPoolExecutor(max_workers=1, thread_name_prefix="records")
_HERE = local()
_SWITCH_S = 2e-4  # s between two looks of threads for another's turn (sys.setswitchinterval)
# The interval as it was found, then one entry for each who wants it short.
_USERS: list[float] = []
_USERS_LOCK = Lock()


def side_by_side(function: Callable[..., Result], *arguments: Iterable[Any]) -> list[Result]:
    """What `function` gives for each set of arguments, in their order, on two processors.

    The caller's thread takes part, and does a single piece of work alone: what is handed over is in the wrong
    processor's cache. Called from within itself it works one after the other: a thread that waits for its own pool
    waits for ever. After an error nothing more is begun; of several the first in the order of the arguments is raised,
    but what ends the program, as an interrupt does, before all.
    """
    every = list(zip(*arguments, strict=True))
    if len(every) == 1 or getattr(_HERE, "working", False):
        return [function(*each) for each in every]
    found: list[Result | None] = [None] * len(every)
    errors: dict[int, BaseException] = {}
    places = iter(range(len(every)))  # its steps are taken under the interpreter's lock, one by one

    def end() -> None:
        for _ in places:
            pass

    def work() -> None:
        _HERE.working = True
        try:
            for place in places:
                try:
                    found[place] = function(*every[place])
                except BaseException as error:
                    errors[place] = error
                    end()
        finally:
            _HERE.working = False

    # numpy's handling of overflows and the like goes with the context.
    other = _POOL.submit(copy_context().run, work)
    try:
        work()
        if not other.cancel():  # begun, if the pool was free
            other.result()
    finally:
        end()
    if errors:
        raise min(errors.items(), key=lambda item: (isinstance(item[1], Exception), item[0]))[1]
    return cast(list[Result], found)


@contextmanager
def begun(function: Callable[[], Result]) -> Iterator[Future[Result]]:
    """What `function` will give, worked on beside what the block does; a block that fails leaves it to its end.

    The lock changes hands more often within: a thread that comes back from a compiled loop would else wait 5 ms for it.
    """
    aside = ThreadPoolExecutor(max_workers=1, thread_name_prefix="aside")
    with _switching_often():
        try:
            yield aside.submit(copy_context().run, function)
        finally:
            aside.shutdown(wait=False)


@contextmanager
def _switching_often() -> Iterator[None]:
    """The lock's interval is the whole process's: the last of several users sets it back."""
    with _USERS_LOCK:
        if not _USERS:
            _USERS.append(sys.getswitchinterval())
            sys.setswitchinterval(_SWITCH_S)
        _USERS.append(_SWITCH_S)
    try:
        yield
    finally:
        with _USERS_LOCK:
            _USERS.pop()
            if len(_USERS) == 1:
                sys.setswitchinterval(_USERS.pop())

"""A process beside the live one for work that takes longer than a turn: functions in, promises of results out.

It is one that this process starts when there is the first work, and that ends when its standard input does, so that
nothing is left behind whichever way this one ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any, Self, TypeVar

from gcs import portable

Result = TypeVar("Result")
# What is reported at once comes first where both want the processor.
_NICENESS = 5


class _Forked:
    """A child that has loaded what this process has; of this process while it has one thread."""

    def __init__(self) -> None:
        orders, stdin = os.pipe()
        stdout, answers = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.dup2(orders, 0)
            os.dup2(answers, 1)
            for one in (orders, stdin, stdout, answers):
                os.close(one)
            try:
                main()
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        os.close(orders)
        os.close(answers)
        self.stdin, self.stdout = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(BrokenPipeError):
            self.stdin.close()
        self.stdout.close()
        os.waitpid(self._pid, 0)

    def kill(self) -> None:
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)


class SecondProcess:
    """Runs one function after the other. Functions, arguments and results are pickled.

    forked: the first process is begun now, as a copy of this one, which has no threads yet; others take longer to load.
    """

    def __init__(self, forked: bool = False) -> None:
        self._child: _Forked | subprocess.Popen[bytes] | None = _Forked() if forked else None
        self._waiting = ThreadPoolExecutor(1, "second-process")
        self._closed = False

    def submit(self, function: Callable[..., Result], /, *arguments: object) -> Future[Result]:
        """The promise of a result. A process that ended instead of answering gives EOFError, the next work a new one.

        What the function raises is raised by the promise.
        """
        return self._waiting.submit(self._run, function, arguments)

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._closed = True
        child = self._child
        if child is not None:
            child.kill()
        self._waiting.shutdown(cancel_futures=True)
        self._end()

    def _run(self, function: Callable[..., Any], arguments: tuple[object, ...]) -> Any:
        if self._closed:
            raise EOFError("closed")
        if self._child is None:
            command = [sys.executable, "-m", "gcs.live.second_process"]
            self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        try:
            pickle.dump((function, arguments), self._child.stdin)
            self._child.stdin.flush()
            result, error = pickle.load(self._child.stdout)
        except (EOFError, OSError) as lost:
            self._end()
            raise EOFError("the process ended before it answered") from lost
        if error is not None:
            raise error
        return result

    def _end(self) -> None:
        """End the process, if there is one, and close its pipes."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            with suppress(BrokenPipeError), child:
                pass


def _read(orders: queue.SimpleQueue[tuple[Callable[..., Any], tuple[object, ...]]]) -> None:
    """Take orders until standard input ends: then nobody wants what is being worked on, and the process ends."""
    with (
        suppress(Exception),
        open(0, "rb", closefd=False) as given,
    ):  # one that cannot be read too: who asked sees the end
        while True:
            orders.put(pickle.load(given))
    os._exit(0)


def main() -> None:
    """Work until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    portable.stand_back(_NICENESS)
    from sysid.numerics.threads import one_thread  # not for whoever starts this process: it loads scipy

    one_thread()
    answers, sys.stdout = open(1, "wb", closefd=False), sys.stderr  # noqa: SIM115  # what libraries print is no answer
    orders: queue.SimpleQueue[tuple[Callable[..., Any], tuple[object, ...]]] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(orders,), daemon=True).start()
    while True:
        function, arguments = orders.get()
        answer: tuple[Any, Exception | None]
        try:
            answer = (function(*arguments), None)
        except Exception as error:  # given to who asked, whatever it is
            answer = (None, error)
        pickle.dump(answer, answers)
        answers.flush()


if __name__ == "__main__":
    main()

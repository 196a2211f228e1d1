"""Programs of this package in processes of their own that begin at once: forked from one that has loaded everything.

Loading numba, scipy and our own modules takes a second on a fast machine, and ten on a small one; an upload alone needs
two such processes. The first program that is begun starts the process that all others are forked from
(`multiprocessing`'s forkserver). It ends with this one, and is started again when it was killed. Where there is none, a
program loads everything itself.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import connection, forkserver, process
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any, Self

from gcs.errors import ServiceError, in_words

_log = logging.getLogger(__name__)

# What the programs load, so that none of them has to.
_LOADED = (
    "gcs.jobs.alone",
    "gcs.cli",
    "gcs.analysis.postflight",
    "gcs.jobs.intakeworker",
    "gcs.jobs.reportworker",
    "gcs.jobs.viewworker",
    "gcs.jobs.worker",
    "gcs.live.worker",
    "sysid.identification.posterior_method",
    "gcs.vehicles.formworker",
    "gcs.jobs.compiled",
)
# From the end of a process to its exit code, s.
_CODE_S = 5.0
# Of a process whose exit code nobody knows.
_NO_CODE = 255
# Between two looks whether somebody still waits for a process, s.
_LOOK_S = 0.05
STOPPED = "the service is being stopped; ask again when it is back"

_starting, _ending = threading.Lock(), threading.Event()


class Program:
    """A module's main() as `subprocess.Popen` runs it, with a pipe to its standard input.

    module, arguments: what `python -m` would be given. stdout: a file's descriptor, or None for a pipe. stderr: one, or
    None for this process's own. text: whether the pipes are of text. environment: all variables that it has. Raises
    OSError or EOFError where it cannot be forked, ServiceError behind `begin_no_more`.
    """

    def __init__(
        self, module: str, arguments: Sequence[str], stdout: int | None, stderr: int | None, text: bool,
        environment: Mapping[str, str],
    ) -> None:  # fmt: skip
        mode, encoding = ("", "utf-8") if text else ("b", None)
        read, write = os.pipe()
        given = [Connection(read, writable=False)]
        self.stdin: IO[Any] = os.fdopen(write, f"w{mode}", encoding=encoding)
        self.stdout: IO[Any] | None = None
        if stdout is None:
            read, write = os.pipe()
            self.stdout = os.fdopen(read, f"r{mode}", encoding=encoding)
            given.append(Connection(write, readable=False))
        else:
            given.append(Connection(os.dup(stdout), readable=False))
        given.append(Connection(os.dup(2 if stderr is None else stderr), readable=False))
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_LOADED))
        self._process = context.Process(
            target=_work, args=(module, list(arguments), dict(environment), given), daemon=True
        )
        try:
            with _starting:
                _refuse_when_ending()
                self._process.start()
                # Whatever is begun next would ask it for its exit code, which comes once.
                process._children.discard(self._process)  # type: ignore[attr-defined]
        except (OSError, EOFError, ServiceError):
            self.close()
            raise
        finally:
            for one in given:
                one.close()
        self._code: int | None = None
        self._asking = threading.Lock()
        # Its number may be another process's once it has ended: what it is forked from has waited for it.
        self._handle: int | None = None
        try:
            self._handle = os.pidfd_open(self.pid)
        except ProcessLookupError:
            pass  # it has ended already
        except OSError:  # as under an old seccomp profile
            self._process.kill()
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
        self.wait()

    @property
    def pid(self) -> int:
        """Of the process."""
        return int(self._process.pid or 0)

    def poll(self) -> int | None:
        """Its exit code, negative for a signal; None while it runs."""
        with self._asking:
            if self._code is None and (self._handle is None or select.select([self._handle], [], [], 0.0)[0]):
                connection.wait([self._process.sentinel], _CODE_S)
                code = self._process.exitcode
                self._code = _NO_CODE if code is None else code
                if self._handle is not None:
                    os.close(self._handle)
                    self._handle = None
            return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has ended. Raises subprocess.TimeoutExpired."""
        with self._asking:
            # One's own: another thread may close the other one meanwhile.
            handle = None if self._handle is None else os.dup(self._handle)
        if handle is not None:
            try:
                ended = select.select([handle], [], [], timeout)[0]
            finally:
                os.close(handle)
            if not ended:
                raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return self.poll() or 0

    def kill(self) -> None:
        """End it at once."""
        self._signal(signal.SIGKILL)

    def terminate(self) -> None:
        """Ask it to end."""
        self._signal(signal.SIGTERM)

    def close(self) -> None:
        """Close the pipes."""
        for pipe in (self.stdin, self.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):  # closing writes what a dead program did not take
                    pipe.close()

    def _signal(self, number: int) -> None:
        with self._asking, suppress(ProcessLookupError):
            if self._handle is not None:
                signal.pidfd_send_signal(self._handle, number)


def begin(
    command: Sequence[str], stdout: int | None = None, stderr: int | None = None, *, text: bool = True,
    variables: Mapping[str, str] | None = None,
) -> Program | subprocess.Popen[Any]:  # fmt: skip
    """Begin a command with a pipe to its standard input; `python -m` of what is loaded already as a `Program`.

    variables: of its environment, beside those of this process. It imports the same packages as this process, installed
    or not, and its text is UTF-8 whatever the locale. Raises ServiceError behind `begin_no_more`.
    """
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    own = {**os.environ, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8", **(variables or {})}
    if tuple(command[:2]) == (sys.executable, "-m") and command[2] in _LOADED and _can_fork():
        try:
            return Program(command[2], command[3:], stdout, stderr, text, own)
        except (OSError, EOFError) as error:
            _refuse_when_ending()
            _log.warning("%s cannot be forked and loads everything itself: %s", command[2], in_words(error))
    _refuse_when_ending()
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE if stdout is None else stdout, stderr=stderr, text=text,
        encoding="utf-8" if text else None, env=own,
    )  # fmt: skip


def begin_no_more() -> None:
    """Have nothing begin from now on, nor anybody wait for it: loading takes long on a busy machine, a stop must not.

    What has begun goes on.
    """
    _ending.set()
    while not _starting.acquire(timeout=_LOOK_S):
        loading = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
        if loading is not None:
            with suppress(ProcessLookupError):
                os.kill(loading, signal.SIGKILL)
    _starting.release()


def _refuse_when_ending() -> None:
    if _ending.is_set():
        raise ServiceError(STOPPED)


def _can_fork() -> bool:
    return hasattr(os, "pidfd_open") and "forkserver" in multiprocessing.get_all_start_methods()


def _work(module: str, arguments: list[str], environment: dict[str, str], given: list[Connection]) -> None:
    """What the forked process does: the module's main() on the pipes that it was given."""
    for place, one in enumerate(given):
        os.dup2(one.fileno(), place)
        one.close()
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False)  # noqa: SIM115
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    main = import_module(module).main
    try:
        code = main(arguments) if arguments else main()
        sys.stdout.flush()
    except BrokenPipeError:  # the service has ended meanwhile: nobody reads what is left to say, here or at the exit
        os._exit(_NO_CODE)
    sys.exit(code)

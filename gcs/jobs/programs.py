"""Programs of this package in processes of their own that begin at once: forked from one that has loaded everything.

Loading numba, scipy and our own modules takes a second on a fast machine, and ten on a small one; an upload alone needs
two such processes. The first program that is begun starts the process that all others are forked from
(`multiprocessing`'s forkserver). It ends with this one, and is started again when it was killed.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import connection, forkserver
from multiprocessing.connection import Connection
from typing import IO, Any, Self

# What the programs load, so that none of them has to.
_LOADED = (
    "gcs.cli",
    "gcs.analysis.postflight",
    "gcs.jobs.intakeworker",
    "gcs.jobs.reportworker",
    "gcs.jobs.viewworker",
    "gcs.jobs.worker",
    "gcs.live.worker",
    "sysid.identification.posterior_method",
    "gcs.jobs.compiled",
)
# A process that has threads cannot be forked safely, and these are matrix libraries'.
_NO_THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_context = multiprocessing.get_context("forkserver")
_starting = threading.Lock()


class Program:
    """A module's main() as `subprocess.Popen` runs it, with a pipe to its standard input.

    module, arguments: what `python -m` would be given. stdout: a file's descriptor, or None for a pipe. stderr: one, or
    None for this process's own. text: whether the pipes are of text. environment: all variables that it has.
    """

    def __init__(
        self, module: str, arguments: Sequence[str], stdout: int | None, stderr: int | None, text: bool,
        environment: Mapping[str, str],
    ) -> None:  # fmt: skip
        read, write = os.pipe()
        given = [Connection(read, writable=False)]
        self.stdin: IO[Any] = os.fdopen(write, "w" if text else "wb")
        self.stdout: IO[Any] | None = None
        if stdout is None:
            read, stdout = os.pipe()
            self.stdout = os.fdopen(read, "r" if text else "rb")
            given.append(Connection(stdout, readable=False))
        else:
            given.append(Connection(os.dup(stdout), readable=False))
        given.append(Connection(os.dup(2 if stderr is None else stderr), readable=False))
        self._process = _context.Process(
            target=_work, args=(module, list(arguments), dict(environment), given), daemon=True
        )
        self._code = threading.Lock()
        with _starting:
            _ensure_running()
            self._process.start()
        for one in given:
            one.close()

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
        with self._code:  # the code comes through a pipe, once
            return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has ended. Raises subprocess.TimeoutExpired."""
        connection.wait([self._process.sentinel], timeout)
        code = self.poll()
        if code is None:
            raise subprocess.TimeoutExpired(str(self._process.name), timeout or 0.0)
        return code

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()

    def terminate(self) -> None:
        """Ask it to end."""
        self._process.terminate()

    def close(self) -> None:
        """Close the pipes."""
        for pipe in (self.stdin, self.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):  # closing writes what a dead program did not take
                    pipe.close()


def begin(
    command: Sequence[str], stdout: int | None = None, stderr: int | None = None, *, text: bool = True,
    environment: Mapping[str, str] | None = None,
) -> Program | subprocess.Popen[Any]:  # fmt: skip
    """Begin a command with a pipe to its standard input; `python -m` of what is loaded already as a `Program`."""
    own = dict(os.environ) if environment is None else dict(environment)
    if tuple(command[:2]) == (sys.executable, "-m") and command[2] in _LOADED:
        return Program(command[2], command[3:], stdout, stderr, text, own)
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE if stdout is None else stdout, stderr=stderr, text=text,
        env=own,
    )  # fmt: skip


def _ensure_running() -> None:
    """Start what programs are forked from, where it does not run."""
    _context.set_forkserver_preload(list(_LOADED))
    before = {name: os.environ.get(name) for name in _NO_THREADS}
    os.environ.update(_NO_THREADS)
    try:
        forkserver.ensure_running()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(module: str, arguments: list[str], environment: dict[str, str], given: list[Connection]) -> None:
    """What the forked process does: the module's main() on the pipes that it was given."""
    for place, one in enumerate(given):
        os.dup2(one.fileno(), place)
        one.close()
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", buffering=1, closefd=False)  # noqa: SIM115
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    main = import_module(module).main
    code = main(arguments) if arguments else main()
    sys.stdout.flush()
    sys.exit(code)

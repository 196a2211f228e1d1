"""The commands as users run them: those that last in processes of their own, the others at once in this one."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from pathlib import Path

from patience import PATIENCE_S
from traffic import wait_until

from gcs.cli import main as gcs_main
from gcs.errors import RecordingError
from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main as sim_vehicle_main

#: What a vehicle says only because the station asks it for its time.
ANSWERS = "/TIMESYNC"


def start(
    program: str, arguments: Sequence[object], descriptors: int | None = None, **environment: str
) -> subprocess.Popen[str]:
    """`gcs` or `sim-vehicle` of this environment; descriptors: how many it may have. environment: variables to set."""
    inherited = {name: value for name, value in os.environ.items() if name != "GCS_TOKEN"}
    fewer = [] if descriptors is None else ["sh", "-c", f'ulimit -n {descriptors}; exec "$0" "$@"']
    return subprocess.Popen(
        [*fewer, str(Path(sys.executable).with_name(program)), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**inherited, **environment},
    )


def run(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """A finished command: its exit code and what it printed.

    In this process, which has loaded everything: a process of its own takes two seconds to begin, whatever it does.
    """
    main = {"gcs": gcs_main, "sim-vehicle": sim_vehicle_main}[program]
    given = [str(one) for one in arguments]
    token = os.environ.pop("GCS_TOKEN", None)
    with TextIOWrapper(BytesIO(), write_through=True) as out, TextIOWrapper(BytesIO(), write_through=True) as error:
        try:
            with redirect_stdout(out), redirect_stderr(error):
                code = main(given)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(bool(ended.code))
        finally:
            if token is not None:
                os.environ["GCS_TOKEN"] = token
        printed = [stream.buffer.getvalue().decode() for stream in (out, error)]  # type: ignore[attr-defined]
    return subprocess.CompletedProcess([program, *given], code, *printed)


def run_apart(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """The same in a process of its own."""
    process = start(program, arguments)
    with process:
        out, error = process.communicate(timeout=PATIENCE_S)
    return subprocess.CompletedProcess(process.args, process.returncode, out, error)


def free_port(*kinds: socket.SocketKind) -> int:
    """A port of this machine that nobody uses now, for any of `kinds`; without any, neither by UDP nor by TCP."""
    first, *others = kinds or (socket.SOCK_STREAM, socket.SOCK_DGRAM)
    for _ in range(100):
        with ExitStack() as probes:
            probe = probes.enter_context(socket.socket(socket.AF_INET, first))
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
            try:
                for kind in others:
                    probes.enter_context(socket.socket(socket.AF_INET, kind)).bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise AssertionError("no port is free")


def messages_on_disk(path: Path) -> int:
    """Messages in a recording that may still be growing, answers to the station's own questions not counted."""
    try:
        return sum(count for topic, count in Recording(path).counts().items() if not topic.endswith(ANSWERS))
    except RecordingError:
        return 0


@contextmanager
def recording_station(url: str, path: Path, expected: int) -> Iterator[None]:
    """`gcs record` in a process of its own, ready to receive; ended once `expected` messages are on disk."""
    process = start("gcs", ["record", "--connect", url, "-o", path])
    with process:
        try:
            wait_until(lambda: path.exists() or process.poll() is not None)
            assert process.poll() is None, process.communicate()[1]
            yield
            wait_until(lambda: messages_on_disk(path) >= expected)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=PATIENCE_S)
            assert process.returncode == 0, error
        finally:
            if process.poll() is None:
                process.kill()


@contextmanager
def service(*arguments: object, descriptors: int | None = None, **environment: str) -> Iterator[str]:
    """`gcs serve` on a free port: its URL. It is told to stop at the end, and must then end well."""
    process = start("gcs", ["serve", "--port", "0", *arguments], descriptors, **environment)
    with process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("serving on "), process.communicate()[1]
            yield line.split()[-1]
            process.terminate()
            process.communicate(timeout=PATIENCE_S)
            assert process.returncode == 0
        finally:
            if process.poll() is None:
                process.kill()

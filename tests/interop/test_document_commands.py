"""Every command of the pages, run as a reader would: page by page, in an empty folder, through a shell."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import dataflash
import pytest
import ulog_writer
from doc_commands import PAGES, ROOT, Block, blocks
from processes import free_port, run, start
from serial_line import serial_line

TIMEOUT_S = 900.0
DEVICE = "/dev/ttyUSB0"
READ = [page for page in PAGES if any(block.way in ("run", "background") for block in blocks(page))]


def flights(folder: Path) -> None:
    """What "flight.mcap", "other.mcap" and "mine.toml" of a page stand for."""
    shutil.copy(ROOT / "tests" / "flow" / "data" / "multisine.mcap", folder / "flight.mcap")
    done = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 9, "--record", folder / "other.mcap")
    assert done.returncode == 0, done.stderr
    for path in (ROOT / "sim_vehicle" / "vehicles").glob("iitb-mav*"):
        shutil.copy(path, folder / path.name.replace("iitb-mav.toml", "mine.toml"))
    (folder / "key.bin").write_bytes(bytes(range(32)))


def repository(folder: Path) -> None:
    """For pages whose commands name files of the repository."""
    (folder / "sim_vehicle").symlink_to(ROOT / "sim_vehicle")


def dataflash_log(folder: Path) -> None:
    (folder / "00000042.bin").write_bytes(dataflash.a_log().data)


def ulog(folder: Path) -> None:
    (folder / "flight.ulg").write_bytes(ulog_writer.a_log().bytes())


#: What a reader of the page has at hand.
AT_HAND: dict[str, Callable[[Path], None]] = {
    "links.md": flights,
    "report.md": flights,
    "vehicles.md": repository,
    "ardupilot.md": dataflash_log,
    "px4.md": ulog,
}


@contextmanager
def board() -> Iterator[str]:
    """The device of a serial line at whose other end the simulated aircraft stands still, waiting to be armed."""
    stopping = threading.Event()
    with serial_line() as (vehicle_end, station_end):

        def send() -> None:
            while not stopping.is_set():
                arguments = ["fly", "--taxi", "--wait-arm", "--out", f"{vehicle_end},921600"]
                with start("sim-vehicle", arguments) as process:
                    while process.poll() is None:
                        if stopping.wait(0.2):
                            process.terminate()
                            process.wait()

        sender = threading.Thread(target=send)
        sender.start()
        try:
            yield station_end
        finally:
            stopping.set()
            sender.join()


def script(page: list[Block]) -> str:
    """One shell script of all blocks; it prints a line in front of each block's output."""
    lines = ["set -eu", "PIDS=()"]
    for number, block in enumerate(page):
        lines.append(f"printf '\\n@@ {number}\\n'")
        if block.way == "run":
            assert block.language == "sh", f"{block.name}: commands with prompts have a test of their own"
            lines.append(block.text)
        elif block.way == "background":
            log = f"background-{number}.log"
            lines += [f"{block.text.strip()} > {log} 2>&1 &", "PIDS+=($!)"]
            lines.append(f'until grep -q "serving on" {log}; do kill -0 "${{PIDS[-1]}}"; sleep 0.2; done')
    lines.append("printf '\\n@@ end\\n'")
    lines.append('for PID in "${PIDS[@]}"; do kill -INT "$PID"; wait "$PID"; done')
    return "\n".join(lines) + "\n"


@pytest.mark.timeout(TIMEOUT_S)
@pytest.mark.parametrize("page", READ, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_commands_of_a_page_do_what_it_says(page: Path, tmp_path: Path) -> None:
    found = [block for block in blocks(page) if block.way in ("run", "background")]
    text = script(found)
    if page.name in AT_HAND:
        AT_HAND[page.name](tmp_path)
    with ExitStack() as stack:
        if DEVICE in text:
            text = text.replace(DEVICE, stack.enter_context(board()))
        text = text.replace("14550", str(free_port())).replace("5761", str(free_port(socket.SOCK_STREAM)))
        http = str(free_port(socket.SOCK_STREAM))
        text = (
            text.replace("--port 8000", "")
            .replace("gcs serve", f"gcs serve --port {http}")
            .replace(":8000", f":{http}")
        )
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path}
        done = subprocess.run(
            ["bash", "-c", text], cwd=tmp_path, env=environment, text=True, check=False, timeout=TIMEOUT_S,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
    logs = "".join(log.read_text(encoding="utf-8") for log in sorted(tmp_path.glob("background-*.log")))
    assert done.returncode == 0, done.stdout + logs
    printed = dict(re.findall(r"^@@ (\d+)\n(.*?)(?=^@@ )", done.stdout, re.MULTILINE | re.DOTALL))
    for number, block in enumerate(found):
        for line in block.shown:
            assert line.strip() in printed[str(number)], f"{block.name} does not print {line!r}"

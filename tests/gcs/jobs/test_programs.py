"""Programs forked from a process that has loaded them: as `python -m` runs them, and gone with who began them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import forkserver
from pathlib import Path

import pytest
from patience import PATIENCE_S
from traffic import wait_until

from gcs.jobs.programs import STOPPED, Program, begin

REPORT = (sys.executable, "-m", "gcs.jobs.reportworker")
WORKER = (sys.executable, "-m", "gcs.jobs.worker")


def gone(pid: int) -> bool:
    """Whether a process has ended, waited for by its parent or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def test_a_program_reads_answers_and_ends_as_python_would_run_it(tmp_path: Path) -> None:
    answers, errors = tmp_path / "answers", tmp_path / "errors"
    with answers.open("w") as stdout, errors.open("w") as stderr:
        program = begin(REPORT, stdout.fileno(), stderr.fileno())
        assert isinstance(program, Program)
        with program:
            program.stdin.write(json.dumps({"schema": "identification/1"}))
    apart = subprocess.run(
        REPORT, input='{"schema": "identification/1"}', capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (program.poll(), answers.read_text(), errors.read_text().splitlines()[-1]) == (
        apart.returncode, apart.stdout, apart.stderr.splitlines()[-1],
    )  # fmt: skip


def test_what_it_says_comes_through_its_pipe_and_its_cost_last() -> None:
    order = {"memory_bytes": 2_000_000_000, "automatic": False, "recordings": [], "validate": [], "vehicle": "none"}
    with begin(WORKER) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        program.stdin.write(json.dumps({**order, "kind": "identify", "models": {}}) + "\n")
        program.stdin.flush()
        said = [json.loads(line) for line in program.stdout]
    assert program.poll() == 1
    assert said[-1]["cost"]["peak_bytes"] > 0


def test_one_that_is_killed_says_by_which_signal_and_one_that_lasts_is_not_waited_for() -> None:
    with begin(WORKER) as program:
        assert program.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            program.wait(0.01)
        program.kill()
        assert program.wait(PATIENCE_S) == -signal.SIGKILL
        assert program.poll() == -signal.SIGKILL


def test_the_process_that_they_are_forked_from_is_begun_again_when_it_was_killed() -> None:
    for _ in range(2):
        with begin(REPORT) as program:
            pass
        assert program.poll() == 1  # nothing is no result
        before = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: gone(before))  # noqa: B023


def test_exit_codes_are_their_own_though_many_end_at_once() -> None:
    def codes(_: int) -> list[int]:
        found = []
        for _ in range(25):
            with begin(REPORT) as program:
                pass
            found.append(program.poll())
        return found

    with ThreadPoolExecutor(4) as pool:
        assert {code for found in pool.map(codes, range(4)) for code in found} == {1}


def test_one_can_be_ended_though_what_it_was_forked_from_is_gone() -> None:
    with begin(WORKER) as program:
        before = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: gone(before))
        assert program.poll() is None
        program.kill()
        assert program.wait(PATIENCE_S) == 255
        assert gone(program.pid)


def test_where_none_can_be_forked_a_program_loads_everything_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def lost(self: object) -> None:
        raise EOFError("unexpected EOF")

    monkeypatch.setattr("multiprocessing.context.ForkServerProcess.start", lost)
    with begin(REPORT) as program:
        assert isinstance(program, subprocess.Popen)
        program.communicate("", timeout=PATIENCE_S)
    assert program.returncode == 1
    assert "gcs.jobs.reportworker cannot be forked and loads everything itself" in caplog.text


def test_nothing_outlives_a_service_that_is_killed() -> None:
    script = (
        "import sys; from gcs.jobs.programs import begin; from multiprocessing import forkserver\n"
        "program = begin((sys.executable, '-m', 'gcs.jobs.worker'))\n"
        "print(program.pid, forkserver._forkserver._forkserver_pid, flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as service:
        assert service.stdout is not None
        pids = [int(word) for word in service.stdout.readline().split()]
        assert not any(map(gone, pids))
        service.kill()
    wait_until(lambda: all(map(gone, pids)))


def test_one_whose_reader_is_gone_ends_without_a_word(tmp_path: Path) -> None:
    errors = tmp_path / "errors"
    with errors.open("w") as stderr, begin(WORKER, None, stderr.fileno()) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        program.stdout.close()
        order = {"memory_bytes": 2_000_000_000, "automatic": False, "recordings": [], "validate": [], "vehicle": "none"}
        program.stdin.write(json.dumps({**order, "kind": "identify", "models": {}}) + "\n")
        program.stdin.flush()
        assert program.wait(PATIENCE_S) == 255
    assert errors.read_text() == ""


def test_nobody_waits_for_what_is_loaded_once_no_more_is_to_begin(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "begun")
    (tmp_path / "endless.py").write_text("import time; open('begun', 'w').close(); time.sleep(1e6)")
    script = (
        "import sys; from concurrent.futures import ThreadPoolExecutor; from gcs.jobs import programs\n"
        "programs._LOADED = ('endless', 'gcs.jobs.worker')\n"
        "def begin(number):\n"
        "    try:\n"
        "        programs.begin((sys.executable, '-m', 'gcs.jobs.worker'))\n"
        "    except Exception as error:\n"
        "        return str(error)\n"
        "with ThreadPoolExecutor(3) as pool:\n"
        "    waiting = pool.map(begin, range(3))\n"
        "    open('begun').close()\n"
        "    programs.begin_no_more()\n"
        "    print(*waiting, begin(4), sep='\\n')\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines() == 4 * [STOPPED], done.stderr
    assert done.stderr == ""

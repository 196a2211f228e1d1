"""Work beside the live process: results and errors come back, and nothing outlives who asked."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.jobs.programs import begin
from gcs.live.second_process import SecondProcess

pytestmark = pytest.mark.whole_flight


def test_results_and_errors_come_back_from_another_process() -> None:
    second = SecondProcess()
    try:
        there = second.submit(os.getpid).result(60.0)
        assert there != os.getpid()
        assert second.submit(divmod, 17, 5).result(60.0) == (3, 2)
        with pytest.raises(ValueError, match="invalid literal"):
            second.submit(int, "seven").result(60.0)
        assert second.submit(os.getpid).result(60.0) == there
    finally:
        second.close()
    with pytest.raises(ProcessLookupError):
        os.kill(there, 0)


def test_one_that_dies_is_told_and_the_next_work_has_a_new_one() -> None:
    second = SecondProcess()
    try:
        with pytest.raises(EOFError):
            second.submit(os._exit, 3).result(60.0)
        assert second.submit(divmod, 7, 2).result(60.0) == (3, 1)
    finally:
        second.close()


def test_closing_does_not_wait_for_work() -> None:
    second = SecondProcess()
    second.submit(os.getpid).result(60.0)
    lost = second.submit(time.sleep, 600.0)
    time.sleep(0.2)
    second.close()
    with pytest.raises(EOFError):
        lost.result(60.0)


@pytest.mark.parametrize(
    "at_work", ["", "second.submit(time.sleep, 600.0)\ntime.sleep(0.5)\n"], ids=["idle", "at-work"]
)
def test_it_ends_with_the_process_that_asked(at_work: str) -> None:
    text = (
        "import os, time\nfrom gcs.live.second_process import SecondProcess\nsecond = SecondProcess()\n"
        f"print(second.submit(os.getpid).result(60.0), flush=True)\n{at_work}os._exit(1)\n"
    )
    asked = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=120, check=False)
    there = int(asked.stdout)
    for _ in range(200):
        try:
            os.kill(there, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("it is still there")


def test_one_that_is_forked_is_there_at_once_and_works_as_any_other() -> None:
    text = (
        "import os\nfrom gcs.live.second_process import SecondProcess\nsecond = SecondProcess(forked=True)\n"
        "print('not an answer')\n"
        "there = second.submit(os.getpid).result(60.0)\n"
        "assert second.submit(os.getppid).result(60.0) == os.getpid()\n"
        "assert second.submit(divmod, 17, 5).result(60.0) == (3, 2)\n"
        "try:\n    second.submit(os._exit, 3).result(60.0)\nexcept EOFError:\n    pass\n"
        "other = second.submit(os.getpid).result(60.0)\n"
        "assert other != there\nsecond.close()\nprint('done')\n"
    )
    ran = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=120, check=False)
    assert ran.stdout.split("\n")[-2] == "done", ran.stderr
    assert ran.stderr == ""


def test_the_live_process_has_one_that_is_forked() -> None:
    command = (sys.executable, "-m", "gcs.live.worker", "ardupilotmega", "iitb-mav")
    with begin(command, text=False) as worker:
        assert worker.stdout is not None
        assert b'"ready"' in worker.stdout.readline()
        children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text(encoding="ascii").split()
        (child,) = children
        assert Path(f"/proc/{child}/cmdline").read_bytes() == Path(f"/proc/{worker.pid}/cmdline").read_bytes()
        time.sleep(1.0)  # what it was given first, a loop compiled, would have ended it
        assert Path(f"/proc/{child}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
        worker.kill()

"""Work beside the live process: results and errors come back, and nothing outlives who asked."""

import os
import subprocess
import sys
import time

import pytest

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

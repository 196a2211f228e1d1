"""The library leaves the host's matrix library as it found it."""

import subprocess
import sys

SCRIPT = """
from threadpoolctl import threadpool_info
import numpy, scipy.linalg
def threads():
    return [entry["num_threads"] for entry in threadpool_info() if entry["user_api"] == "blas"]
before = threads()
import flightmodel, sysid.identify, sysid.discrepancy
flightmodel.identify, flightmodel.Flight
assert threads() == before, (before, threads())
from sysid.numerics.threads import single_threaded
@single_threaded
def inside():
    return threads()
assert set(inside()) == {1}
assert threads() == before
print(len(before), max(before))
"""


def test_import_and_analyses_leave_the_number_of_threads_alone() -> None:
    environment = {"OPENBLAS_NUM_THREADS": "2", "PATH": "/usr/bin"}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False,
        env={**environment, "PYTHONPATH": ":".join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    count, most = map(int, done.stdout.split())
    assert count >= 1
    assert most == 2

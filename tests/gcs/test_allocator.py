"""Memory that was given back: measured in a process of its own, with the C library's own account."""

import subprocess
import sys

# Arrays of growing size are taken and given back while small ones that stay are made between them.
PROGRAM = """
import sys
import numpy as np
from gcs.allocator import give_memory_back
if sys.argv[1] == "set":
    assert give_memory_back()
def resident():
    return int(next(line for line in open("/proc/self/status") if line.startswith("RssAnon")).split()[1])
kept = []
np.ones(30_000_000 // 8)  # by default blocks up to this size come from the heap from here on
before = resident()
for turn in range(40):
    large = [np.ones(1_000_000 // 8) for _ in range(20)]
    kept.append([bytes(50_000) for _ in range(2)])
    del large
print(resident() - before)
"""


def grown_kb(how: str) -> int:
    done = subprocess.run([sys.executable, "-c", PROGRAM, how], capture_output=True, text=True, timeout=120, check=True)
    return int(done.stdout)


def test_large_arrays_that_were_given_back_are_no_memory_of_the_process() -> None:
    kept_kb = 40 * 2 * 50_000 / 1024
    assert grown_kb("set") < kept_kb + 3000
    assert grown_kb("default") > kept_kb + 10_000  # what would be held otherwise

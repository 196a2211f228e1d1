"""What only POSIX has is not needed to import anything; without it the rest works on."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.whole_flight

# Every module of ours, with POSIX's own refused to them (libraries bring their own for each system).
SCRIPT = """
import builtins, importlib, os, pkgutil
POSIX = {"fcntl", "termios", "resource", "pwd", "grp", "pty", "tty", "syslog", "curses", "readline"}
OURS = ("sim_vehicle", "sysid", "gcs", "flightmodel")
real = builtins.__import__
def guarded(name, globals=None, locals=None, fromlist=(), level=0):
    if name in POSIX and (globals or {}).get("__name__", "").split(".")[0] in OURS:
        raise ImportError(name + " is not on this system")
    return real(name, globals, locals, fromlist, level)
builtins.__import__ = guarded
real_module = importlib.import_module
def asked(name, package=None):
    if name in POSIX:
        raise ImportError(name + " is not on this system")
    return real_module(name, package)
importlib.import_module = asked
count = 0
for package in OURS:
    found = importlib.import_module(package)
    for module in pkgutil.walk_packages(found.__path__, package + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
            count += 1
from gcs import portable
for name in ("nice", "sysconf", "fstatvfs"):
    delattr(os, name)
portable.stand_back(5)
portable.limit_memory(1 << 40)
cpu_s, peak = portable.used()
assert cpu_s > 0.0 and peak is None
assert portable.installed_memory() > 0
assert portable.open_files(1000) == 1000
with open(os.devnull, "rb") as file:
    assert portable.free_bytes(file, __import__("pathlib").Path(os.devnull)) is not None
print(count)
"""


def test_nothing_that_only_posix_has_is_needed_for_import() -> None:
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout.split()[-1]) > 500

"""The first identification compiles in other processes what it will need."""

import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from simulated import fly_mav

from sysid.identification import compile_ahead
from sysid.identification.compile_ahead import CompileAhead

pytestmark = pytest.mark.whole_flight

# Names of functions that an identification compiles, rather than finds on disk, after the shares were compiled.
_LATE = """
    import pickle, sys
    from numba.core.dispatcher import Dispatcher
    from sim_vehicle.vehicle.vehicle_file import load_vehicle
    from sysid.identification.compile_ahead import SHARES
    from sysid.identify import identify

    def compiled():
        loops = {
            entry for name, module in list(sys.modules.items()) if name.startswith(("sysid.", "sim_vehicle."))
            for entry in vars(module).values() if isinstance(entry, Dispatcher)
        }
        return {(loop.py_func.__qualname__, signature) for loop in loops for signature in loop.stats.cache_misses}

    for share in SHARES.values():
        for job in share:
            job()
    before = compiled()
    with open(sys.argv[1], "rb") as file:
        identify([pickle.load(file)], load_vehicle("iitb-mav"), method="oe")
    print(" ".join(sorted({name for name, _ in compiled() - before})))
"""


def test_an_identification_compiles_nothing_beyond_the_shares(tmp_path: Path) -> None:
    flight = tmp_path / "flight.pickle"
    flight.write_bytes(pickle.dumps(fly_mav("multisine", 3, duration=10.0)[0]))
    command = [sys.executable, "-c", textwrap.dedent(_LATE), str(flight)]
    told = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ).stdout.splitlines()
    assert told[0] == ""


def test_processes_compile_once_and_leave_a_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / "compiled"
    monkeypatch.setattr(compile_ahead, "compiled_mark", lambda: mark)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with CompileAhead() as first:
        assert first
        first.wait()
    assert mark.exists()
    with CompileAhead() as second:
        assert not second
        second.wait()


def test_what_is_under_way_ends_with_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / "compiled"
    monkeypatch.setattr(compile_ahead, "compiled_mark", lambda: mark)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with pytest.raises(KeyboardInterrupt), CompileAhead() as compiling:
        raise KeyboardInterrupt
    assert not compiling
    assert not mark.exists()


def test_one_processor_compiles_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "compiled_mark", lambda: tmp_path / "compiled")
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert not CompileAhead()

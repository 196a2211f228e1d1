"""Compilation: the arithmetic of numpy, and a cache that follows the sources."""

from __future__ import annotations

import importlib.util
import math
import threading
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sim_vehicle.effects.sensor import ramp_lag
from sim_vehicle.effects.stall import separated_share
from sim_vehicle.jit import jit


@jit
def _quotient(a: float, b: float) -> float:
    return a / b


def test_division_by_nothing_is_numpys_not_pythons() -> None:
    assert _quotient(1.0, 0.0) == math.inf
    assert math.isnan(_quotient(0.0, 0.0))


def test_a_compiled_function_keeps_its_name_and_its_source() -> None:
    assert ramp_lag.__name__ == "ramp_lag"
    assert "exact" in (ramp_lag.__doc__ or "")
    plain = ramp_lag.py_func  # type: ignore[attr-defined]
    assert ramp_lag(0.1, 0.3, 0.05, 0.02, 0.04) == pytest.approx(plain(0.1, 0.3, 0.05, 0.02, 0.04), rel=1e-15)


def test_threads_that_call_the_same_function_get_the_same_numbers() -> None:
    alphas = np.linspace(-0.5, 0.5, 2000)
    wanted = [separated_share(float(a), 0.2, 50.0) for a in alphas]
    found: list[list[float]] = [[], []]

    def work(index: int) -> None:
        found[index] = [separated_share(float(a), 0.2, 50.0) for a in alphas]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [wanted, wanted]


def tree(folder: Path) -> Path:
    """A small copy of the packages: the real jit.py, one compiled module and one that is not."""
    source = Path(importlib.util.find_spec("sim_vehicle.jit").origin or "")  # type: ignore[union-attr]
    package = folder / "sim_vehicle"
    package.mkdir(parents=True)
    (package / "jit.py").write_bytes(source.read_bytes())
    (package / "loop.py").write_text("from sim_vehicle.jit import jit\n")
    (package / "prose.py").write_text("TEXT = 1\n")
    return package


def fresh(package: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """That copy's jit module; numba's own setting is left alone."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package))
    spec = importlib.util.spec_from_file_location("another_jit", package / "jit.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_cache_follows_every_compiled_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tree(tmp_path)
    before = fresh(package, monkeypatch)._cache_folder()
    assert fresh(package, monkeypatch)._cache_folder() == before
    (package / "prose.py").write_text("TEXT = 2\n")
    assert fresh(package, monkeypatch)._cache_folder() == before
    (package / "loop.py").write_text("from sim_vehicle.jit import jit  # changed\n")
    assert fresh(package, monkeypatch)._cache_folder() != before


def test_the_cache_lies_where_the_user_keeps_caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tree(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert fresh(package, monkeypatch)._cache_folder().is_relative_to(tmp_path / "caches" / "flight-model")

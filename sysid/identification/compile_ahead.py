"""The first identification of an installation compiles its loops on two processors instead of one.

The loops are compiled where they are first called, one after the other, which takes a minute. Their machine code is
kept on disk, so other processes can make it: each runs a small part of an identification on made-up numbers.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np

from sim_vehicle.constants import STANDARD_GRAVITY
from sim_vehicle.jit import compiled_mark
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import compatibility
from sysid.numerics.normal_equations import add_squares, gram
from sysid.problem.coefficient_residuals import known_propulsion
from sysid.problem.free_parameters import coefficient
from sysid.problem.free_run import Fixed
from sysid.problem.predictor import Predictor
from sysid.signal_check.kinematic_relations import integrate
from sysid.signals.flight import FlightData
from sysid.signals.record import OUTPUTS, Record

_SAMPLES, _INTERVAL_S, _SPEED, _PITCH, _GRAVITY = 100, 0.02, 15.0, 0.05, STANDARD_GRAVITY
_VEHICLE = "iitb-mav"
_LONGEST_S = 600.0  # no machine needs so long; another process that hangs is ended


def _predictor() -> Predictor:
    """A short flight without any excitation."""
    flat = flatten(load_vehicle(_VEHICLE), read_model(_VEHICLE))
    n = _SAMPLES
    record = Record(
        "compilation", _INTERVAL_S, _INTERVAL_S * np.arange(n, dtype=np.float64), 0, np.zeros((n, 4)),
        np.full(n, 1.0), np.full(n, 1.2), np.zeros((n, len(OUTPUTS))), np.zeros((0, 9)),
    )  # fmt: skip
    return Predictor(flat, [coefficient(name) for name in flat.names], [record])


def _states() -> Array:
    return np.array([_SPEED, 0.0, _SPEED * _PITCH, 0.0, 0.0, 0.0, 0.0, _PITCH, 0.0])


def _simulate() -> None:
    predictor = _predictor()
    predictor.outputs(0, predictor.flat, {}, _states())
    known_propulsion(predictor.records[0], Fixed(predictor.flat, {}), np.full(_SAMPLES, _SPEED))


def _differentiate() -> None:
    predictor = _predictor()
    theta = np.concatenate((predictor.flat.C, _states()))
    S = predictor.derivatives(0, theta, _states(), np.zeros((_SAMPLES, len(OUTPUTS))))
    outputs = np.arange(len(OUTPUTS))
    residual = np.zeros((_SAMPLES, outputs.size))
    gram(S, residual, outputs, np.ones(outputs.size))
    add_squares(residual, np.zeros(outputs.size), np.zeros(outputs.size, dtype=np.int64))


def _reconstruct() -> None:
    """Data compatibility of straight flight."""
    noise = np.random.default_rng(0).normal(0.0, 1e-3, (15, _SAMPLES))
    level = {
        "ax": _GRAVITY * _PITCH, "ay": 0.0, "az": -_GRAVITY, "p": 0.0, "q": 0.0, "r": 0.0, "airspeed": _SPEED,
        "alpha": _PITCH, "beta": 0.0, "phi": 0.0, "theta": _PITCH, "psi": 0.0, "vn": _SPEED, "ve": 0.0, "vd": 0.0,
    }  # fmt: skip
    columns = {name: value + one for (name, value), one in zip(level.items(), noise, strict=True)}
    integrate(noise, _INTERVAL_S, np.empty_like(noise))
    compatibility(FlightData("compilation", _INTERVAL_S, _INTERVAL_S * np.arange(_SAMPLES, dtype=np.float64), columns))


# What one process compiles, in two shares of about the same size.
SHARES: dict[str, tuple[Callable[[], None], ...]] = {
    "derivatives": (_differentiate,),
    "filter": (_reconstruct, _simulate),
}


class CompileAhead:
    """Compilation under way in other processes, where nothing has been compiled yet and there is a second processor."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[bytes]] = []
        if compiled_mark().exists() or (os.cpu_count() or 1) < 2:
            return
        root = str(Path(__file__).resolve().parent.parent.parent)
        path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        quiet = subprocess.DEVNULL
        try:
            for share in SHARES:
                command = [sys.executable, "-m", "sysid.identification.compile_ahead", share]
                environment = {**os.environ, "PYTHONPATH": path}
                self._running.append(
                    subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, env=environment)
                )
        except OSError:
            # No interpreter to start another process with: this one compiles what it needs.
            self.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __bool__(self) -> bool:
        return bool(self._running)

    def wait(self) -> None:
        """Until all is compiled. What another process could not compile, this one compiles when it needs it."""
        try:
            codes = [process.wait(_LONGEST_S) for process in self._running]
        except subprocess.TimeoutExpired:
            self.stop()
            return
        if codes and not any(codes):
            # A cache that cannot be written has nothing to mark.
            with suppress(OSError):
                compiled_mark().parent.mkdir(parents=True, exist_ok=True)
                compiled_mark().touch()
        self._running.clear()

    def stop(self) -> None:
        """End what is under way."""
        for process in self._running:
            process.terminate()
            process.wait()
        self._running.clear()


def main(share: str) -> None:
    """Compile one of SHARES."""
    # The compiler makes millions of objects that live long, and no garbage in cycles that matters.
    gc.disable()
    for job in SHARES[share]:
        job()


if __name__ == "__main__":
    main(sys.argv[1])

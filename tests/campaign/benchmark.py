"""Short flights of aircraft that the default structure only nearly is: do the bars hold?

Run: make campaign NAME=benchmark

JSBSim's flights (tests/support/short_windows.py) with sensors of the reference paper's Table II, cut into windows of 4
to 9 s: each identified by itself, and the four of a flight together. Modes: "linear", "drag" (squares of sideslip and
aileron), "slipstream" (over elevator and rudder, drag as well), "stall" (smooth, drag as well). Printed: how many
intervals of 95 % hold, the root mean square of errors over standard errors, the farthest, the method that `auto` took,
and the bars of the four together over what their own information adds up to.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from jsbsim_flight import fly, measure
from resumable import resumable
from short_windows import BEGINS_S, MODES, WINDOWS, aircraft_of, part_of, truth_of, window_of

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.errors import SysidError
from sysid.identification.result_model import unique_refusals
from sysid.identify import Identification, identify
from sysid.signals.flight import FlightSignals

SECONDS, DRAWN, SEEDS = 30.0, 7, 5
TOGETHER = "together"
Line = dict[str, Any]


def flown(mode: str, seed: int) -> Line:
    """What is said of the windows of a flight: length -> method, and coefficient -> value, standard error, truth."""
    aircraft = aircraft_of(mode, seed % DRAWN + 1)
    with tempfile.TemporaryDirectory() as folder:
        flight = fly(Path(folder), aircraft, seed, SECONDS)
    signals = measure(flight, seed, f"{mode}-{seed}")[0]
    windows, line = [], {}
    for length, begin in WINDOWS:
        window = window_of(signals, begin, begin + length, f"{mode}-{seed}-{length:g}")
        truth = truth_of(part_of(flight, begin, begin + length), aircraft, mode)
        line[f"{length:g} s"] = _answer([window], aircraft.vehicle, truth)
        windows.append(window)
    line[TOGETHER] = _answer(windows, aircraft.vehicle, truth_of(part_of(flight, BEGINS_S, SECONDS), aircraft, mode))
    return {"answers": line}


def _answer(flights: Sequence[FlightSignals], vehicle: Vehicle, truth: Mapping[str, float]) -> Line:
    try:
        found = identify(flights, vehicle, systematic=False)
    except SysidError as error:
        return {"method": f"refused: {error}", "estimates": {}}
    refused = {one.name for one in unique_refusals(found.refused, found.sensor_errors)}
    estimates = {
        name: (one.value, one.std, truth[name])
        for name, one in found.model.coefficients.items()
        if name in truth and name not in refused and one.value is not None and one.std
    }
    return {"method": _method(found), "estimates": estimates}


def _method(found: Identification) -> str:
    if found.posterior is not None:
        return "map"
    return "ee" if found.likeliest is None else found.likeliest.method


def report(lines: Sequence[Line]) -> None:
    """The table, in markdown."""
    print("| mode | windows | hold | rms of errors over bars | farthest | method |")
    print("|---|---|---|---|---|---|")
    for mode in dict.fromkeys(line["family"] for line in lines):
        own = [line["answers"] for line in lines if line["family"] == mode]
        for length in own[0]:
            answers = [one[length] for one in own]
            z = np.array([(value - true) / std for value, std, true in _estimates(answers)])
            held, most, rms = np.mean(np.abs(z) < 1.96), np.max(np.abs(z)), np.sqrt(np.mean(z**2))
            methods = ", ".join(f"{name} {count}" for name, count in Counter(one["method"] for one in answers).items())
            print(f"| {mode} | {length} | {held:.1%} of {z.size} | {rms:.2f} | {most:.1f} | {methods} |")
        print(f"| {mode} | bars {TOGETHER}, over those by the windows' own added up | {_shrunk(own):.2f} | | | |")


def _estimates(answers: Iterable[Line]) -> list[tuple[float, float, float]]:
    return [one for answer in answers for one in answer["estimates"].values()]


def _shrunk(flights: Sequence[Line]) -> float:
    """Median of the bar of the four windows together over that of as many that know as much: one over the root of the
    sum of 1 / std^2.
    """
    ratios = []
    for one in flights:
        alone = [answer["estimates"] for length, answer in one.items() if length != TOGETHER]
        for name, (_, std, _) in one[TOGETHER]["estimates"].items():
            stds = np.array([each[name][1] for each in alone if name in each])
            if stds.size == len(alone):
                ratios.append(std * np.sqrt(np.sum(stds**-2.0)))
    return float(np.median(ratios))


if __name__ == "__main__":
    resumable("benchmark", __doc__, MODES, SEEDS, flown, report)

"""A user's own file passes mypy in strict mode, and a wrong use in it is found."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.whole_flight

RIGHT = """
import numpy as np

from flightmodel import Aircraft, Flight, coefficients, identify, least_squares, simulate

time = np.arange(0.0, 10.0, 0.02)
flight = Flight.from_frame({"time_s": time, "alpha_deg": np.sin(time)}, units={"alpha": "deg"})
aircraft = Aircraft.estimate(span=1.27, mass=1.96)


def model() -> dict[str, float]:
    result = identify(flight, aircraft, validate_on=[flight], progress=False)
    flown = simulate(result, aircraft, flight)
    c = coefficients(flight, aircraft)
    fit = least_squares(c["Cm"], {"alpha": c["alpha"]})
    return {**result.values, **flown.rms, **fit.values}
"""
WRONG = """
from flightmodel import Aircraft, identify

identify("flight.csv", Aircraft.estimate(span="1.27", mass=1.96))
"""


def test_a_user_s_file_is_checked_against_our_types(tmp_path: Path) -> None:
    files = [tmp_path / "right.py", tmp_path / "wrong.py"]
    for path, text in zip(files, (RIGHT, WRONG), strict=True):
        path.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--no-error-summary"]
    done = subprocess.run(
        [*command, "--cache-dir", str(tmp_path / "cache"), *map(str, files)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = [[line for line in done.stdout.splitlines() if path.name in line] for path in files]
    assert [len(lines) for lines in found] == [0, 2], done.stdout + done.stderr

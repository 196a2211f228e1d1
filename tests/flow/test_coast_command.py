"""`gcs coast` from a recording to its page, and what it says of wrong use."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from processes import run

pytestmark = pytest.mark.whole_flight

WAYS = ("--model", "iitb-mav", "--vehicle", "iitb-mav")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("coast") / "flight.mcap"
    wind = ("--effect", "steady_wind:north=5,east=2")
    done = run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--duration", 70, *wind, "--record", path)
    assert done.returncode == 0, done.stderr
    return path


def test_a_flight_goes_on_without_gps_and_the_page_shows_it(recording: Path, tmp_path: Path) -> None:
    result, page = tmp_path / "coast.json", tmp_path / "coast.html"
    done = run("gcs", "coast", recording, *WAYS, "--without", "gps:30", "-o", result)
    assert done.returncode == 0, done.stderr
    assert "30 s without GPS from 40 s on" in done.stdout
    assert "within its 95 % ellipse" in done.stdout
    found = json.loads(result.read_text())
    assert found["schema"] == "coast/1"
    assert found["wind"] == pytest.approx([5.0, 2.0], abs=0.7)
    last = {name: np.array(values[-1]) for name, values in found["series"].items()}
    assert np.hypot(*(last["model"] - last["aircraft"])) == pytest.approx(found["drift"], abs=0.01)
    # The ellipse's axes are those of the covariance.
    major, minor = np.sqrt(5.991 * np.linalg.eigvalsh(last["covariance"])[::-1])
    assert (found["ellipse"]["semi_major"], found["ellipse"]["semi_minor"]) == pytest.approx((major, minor), rel=1e-3)
    done = run("gcs", "report", result, "-o", page)
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "east, m" in text


@pytest.mark.parametrize(
    ("without", "more", "code", "words"),
    [
        ("gps:x", (), 2, "give gps: and the seconds, from 5 to 600, as gps:60"),
        ("baro:60", (), 2, "give gps: and the seconds"),
        ("gps:65", (), 1, "65 s from 5 s on, and 20 s before, are not in it"),
        ("gps:10", ("--at", 500), 1, "are not in it; take less, or another beginning"),
    ],
)
def test_what_cannot_be_flown_is_one_line(
    recording: Path, without: str, more: tuple[object, ...], code: int, words: str
) -> None:
    done = run("gcs", "coast", recording, *WAYS, "--without", without, *more)
    assert done.returncode == code
    assert words in done.stderr.splitlines()[-1]
    assert done.stdout == ""

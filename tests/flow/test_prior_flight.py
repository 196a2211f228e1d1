"""A short flight with one surface and a prior of the aircraft's sizes: a whole model, whose bars hold the truth."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from processes import run

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES
from sysid.problem.model_structure import default_structure

# Sizes of a tail and a fin that are usual on a wing of that size; nobody has published them.
TAIL = "tail_area = 0.077\ntail_arm = 0.66\nfin_area = 0.035\nfin_arm = 0.7"
# Terms of the published model that the linear structure does not have.
LINEAR = [one for name in ("CD_CL", "CD_de", "CL_alphadot") for one in ("--set", f"{name}=0")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("prior")
    text = (VEHICLES / "ultrastick25e.toml").read_text(encoding="utf-8")
    (place / "mine.toml").write_text(text.replace("c = 0.25\n", f"c = 0.25\n{TAIL}\n"), encoding="utf-8")
    flown = ("--vehicle", "ultrastick25e", "--manoeuvre", "elevator-3211", "--seed", 3, *LINEAR)
    for command in (
        ("sim-vehicle", "fly", *flown, "--record", place / "flight.mcap"),
        ("gcs", "prior", place / "mine.toml", "--from", "geometry", "-o", place / "prior.json"),
    ):
        done = run(*command)
        assert done.returncode == 0, done.stderr
    return place


@pytest.mark.parametrize("method", ["auto", "map"])
def test_an_elevator_alone_gives_the_whole_aircraft(folder: Path, method: str) -> None:
    result = folder / f"{method}.json"
    given = ("--vehicle", folder / "mine.toml", "--prior", folder / "prior.json", "--method", method)
    done = run("gcs", "identify", folder / "flight.mcap", *given, "-o", result)
    assert done.returncode == 0, done.stderr
    found = json.loads(result.read_text())["model"]["coefficients"]
    assert set(found) == set(default_structure(("de", "da", "dr")))
    truth, before = read_model("ultrastick25e").values(), read_model(folder / "prior.json").coefficients
    off = {name: abs(one["value"] - truth.get(name, 0.0)) / one["std"] for name, one in found.items()}
    assert max(off.values()) < 3.0, off
    assert sum(share < 1.96 for share in off.values()) >= 0.9 * len(off), off
    # The flight has sharpened what the elevator moves, and left the rest as it was.
    assert all(
        found[name]["std"] < 0.3 * (before[name].std or 0.0) for name in ("CL_alpha", "Cm_alpha", "Cm_de", "Cm_q")
    )
    assert {name for name in before if found[name]["value"] == pytest.approx(before[name].value)} >= {
        name for name in before if name.startswith(("CY", "Cl_", "Cn"))
    }

"""Flights that JSBSim flew, logged in whole microseconds, against the coefficients that flew them."""

from __future__ import annotations

import json
import lzma
from pathlib import Path
from typing import Any

import pytest
from own_bars import own_bar

from gcs.cli import main

FLIGHTS = Path(__file__).parents[1] / "data" / "flights"
# Standard errors that an estimate may be off by: of some 25 numbers a flight none is beyond, but for one in 15 flights.
MOST = 3.0


def without(log: bytes, begin_s: float, end_s: float) -> bytes:
    """A .tlog without what came in a span of time: stamps of 8 bytes, in microseconds, each before a frame."""
    kept, place, first = [], 0, None
    while place < len(log):
        stamp = int.from_bytes(log[place : place + 8], "big")
        first = stamp if first is None else first
        end = place + 8 + 12 + log[place + 9] + 13 * (log[place + 10] & 1)
        if not begin_s <= (stamp - first) / 1e6 < end_s:
            kept.append(log[place:end])
        place = end
    return b"".join(kept)


def identified(name: str, method: str, folder: Path, lost_s: tuple[float, float] | None = None) -> dict[str, Any]:
    """The result of `gcs identify` of a flight. lost_s: a span of which nothing came."""
    place = FLIGHTS / name
    log, result = folder / "flight.tlog", folder / "result.json"
    content = lzma.decompress((place / "flight.tlog.xz").read_bytes())
    log.write_bytes(without(content, *lost_s) if lost_s else content)
    vehicle = str(place / "vehicle.toml")
    assert main(["identify", str(log), "--vehicle", vehicle, "--method", method, "-o", str(result), "--quiet"]) == 0
    found: dict[str, Any] = json.loads(result.read_text())
    return found


def misses(name: str, result: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Coefficient -> how far it is off, in standard errors and as a share of the truth."""
    truth = json.loads((FLIGHTS / name / "truth.json").read_text())["coefficients"]
    return {
        one: (
            (entry["value"] - truth[one]) / own_bar(entry),
            abs(entry["value"] / truth[one] - 1.0) if truth[one] else 0.0,
        )
        for one, entry in result["model"]["coefficients"].items()
        if "value" in entry and one in truth
    }


@pytest.mark.parametrize("name", ["commands-ideal-servo", "multisine", "stall-manoeuvres"])
def test_every_bar_holds_by_the_default(name: str, tmp_path: Path) -> None:
    result = identified(name, "auto", tmp_path)
    off = misses(name, result)
    assert len(off) >= 20
    assert max(abs(z) for z, _ in off.values()) < MOST, off
    # Of a surface that moved by less than a fifth of a degree as well.
    assert {"Cl_da", "Cl_p", "Cm_de"} <= off.keys()
    assert all(one["value"] >= 0.0 for one in result["nuisances"] if one["name"] == "servo_delay")


@pytest.mark.parametrize("lost_s", [None, (20.0, 20.82)])
def test_rounded_commands_make_no_lag_of_an_ideal_servo(lost_s: tuple[float, float] | None, tmp_path: Path) -> None:
    result = identified("commands-ideal-servo", "map", tmp_path, lost_s)
    off = misses("commands-ideal-servo", result)
    assert max(off[one][1] for one in ("Cm_alpha", "Cm_q", "Cm_de")) < 0.03
    assert max(abs(z) for z, _ in off.values()) < MOST, off
    lags = [one for one in result["nuisances"] if one["name"] == "servo_lag"]
    assert all(one["value"] < 0.02 for one in lags)


def test_positions_go_with_their_own_samples_in_equation_error(tmp_path: Path) -> None:
    off = misses("multisine", identified("multisine", "ee", tmp_path))
    assert (
        max(off[one][1] for one in ("Cl_beta", "Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r")) < 0.02
    )


def test_the_right_effect_is_named_alone_though_smooth_terms_gain_hundreds_beside_it(tmp_path: Path) -> None:
    place = FLIGHTS / "propwash-hidden"
    logs = [tmp_path / f"{name}.tlog" for name in ("flight", "other")]
    for log in logs:
        log.write_bytes(lzma.decompress((place / f"{log.name}.xz").read_bytes()))
    out = tmp_path / "found.json"
    given = ["--vehicle", str(place / "vehicle.toml"), "--model", str(place / "baseline.json"), "-o", str(out)]
    part = ["--from", "20", "--to", "50"]
    assert main(["discrepancy", str(logs[0]), "--validate", str(logs[1]), *given, *part, "--quiet"]) == 0
    found = json.loads(out.read_text())
    assert found["verdict"] == "missing_effect"
    assert [one["name"] for one in found["effects"]] == [json.loads((place / "truth.json").read_text())["right_name"]]
    assert found["complete"] is False
    assert 0.0 < sum(one["share"] for one in found["left"]) < 0.1
    assert found["nearest"] is None
    gap = found["gap"]["validation"]
    for output in ("V", "q", "theta", "az"):
        assert gap["before"][output] > 1.5 * gap["noise_floor"][output], output
        assert gap["after"][output] < 1.25 * gap["noise_floor"][output], output

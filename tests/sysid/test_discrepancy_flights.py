"""Several flights in one comparison, of which each tells what its sensors can."""

from __future__ import annotations

from dataclasses import replace

from simulated import fly_mav

from sim_vehicle.model import read_model
from sim_vehicle.vehicle import load_vehicle
from sysid.discrepancy import discrepancy


def test_lagging_vanes_are_named_where_another_flight_has_none() -> None:
    vehicle = load_vehicle("iitb-mav")
    flown = [fly_mav("multisine", seed, duration=10.0, effects=("vane_lag:tau=0.1",))[0] for seed in (5, 6)]
    kept = {name: signal for name, signal in flown[1].signals.items() if name not in ("alpha", "beta")}
    found = discrepancy([flown[0], replace(flown[1], signals=kept)], vehicle, read_model("iitb-mav"))
    assert [one["name"] for one in found["effects"]] == ["vane_lag"], found["reasons"]
    tau = found["effects"][0]["parameters"]["tau"]
    assert abs(tau["value"] - 0.1) < 4.0 * tau["std"]
    assert tau["std"] < 0.005

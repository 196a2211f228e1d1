"""Windows of a second or two, several together: a flight in a hall, snippets around manoeuvres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import field_flight
from short_windows import window_of
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightSignals

VEHICLE = load_vehicle("iitb-mav")
TRUTH = read_model("iitb-mav").values()


def windows(flight: FlightSignals, length_s: float, pause_s: float, begin_s: float, most: int) -> list[FlightSignals]:
    """A flight cut into flights of their own."""
    end_s = float(flight.signals["q"].time_s[-1])
    starts = np.arange(begin_s, end_s - length_s, length_s + pause_s)[:most]
    return [window_of(flight, start, start + length_s, f"window {i}") for i, start in enumerate(starts)]


@pytest.mark.parametrize(("length_s", "method"), [(0.9, "map"), (1.5, "auto")])
def test_windows_of_a_calm_flight_give_its_coefficients(length_s: float, method: str) -> None:
    flight = fly_mav("multisine", 81, duration=30.0)[0]
    found = identify(windows(flight, length_s, 0.6, 5.0, 14), VEHICLE, method=method)
    refused = {one.name for one in found.refused}
    known = {name: one for name, one in found.model.coefficients.items() if name not in refused and name in TRUTH}
    assert len(known) >= 15
    off = {name: abs(one.value - TRUTH[name]) / one.std for name, one in known.items() if one.value and one.std}
    assert max(off.values()) < 3.0, off
    assert abs(found.model.coefficients["Cm_alpha"].value / TRUTH["Cm_alpha"] - 1.0) < 0.05
    # What one window did not move another did; and two seconds show no sensor's scale.
    assert not any("did not move" in one.sentence for one in found.quality.reasons)
    assert found.mistakes == ()


def test_noise_of_windows_in_gusts_is_of_one_kind(tmp_path: Path) -> None:
    """Of spectra by two seconds alone roll came out at 0.4 of what it is, by up to seven of its bars."""
    flown = field_flight("rough", 63, tmp_path)
    found = identify(windows(flown.signals, 2.0, 0.7, 2.0, 12), flown.vehicle, method="map")
    for name in ("Cl_p", "Cl_da", "Cn_beta", "Cn_dr", "Cm_q"):
        one, truth = found.model.coefficients[name], float(np.mean(flown.truth[name]))
        assert one.std is not None
        assert abs(one.value - truth) < 3.0 * one.std, name
        assert abs(one.value / truth - 1.0) < 0.4, name


def test_a_window_too_short_is_left_out_and_named() -> None:
    flight = fly_mav("multisine", 82, duration=30.0)[0]
    whole = windows(flight, 3.0, 0.5, 5.0, 4)
    found = identify([*whole, window_of(flight, 20.0, 20.5, "half a second")], VEHICLE, method="map")
    assert any(line.startswith("left out: half a second") for line in found.warnings)


def test_flights_of_one_name_are_held_apart() -> None:
    flight = fly_mav("multisine", 83, duration=30.0)[0]
    cuts = [replace(one, name="flight") for one in windows(flight, 4.0, 0.5, 5.0, 4)]
    found = identify(cuts, VEHICLE, method="map", systematic=False)
    assert [one.data.name for one in found.flights] == ["flight", "flight (2)", "flight (3)", "flight (4)"]
    assert {len(one.values) for one in found.repeatability.values()} <= {3, 4}
    assert "Cm_alpha" in found.repeatability

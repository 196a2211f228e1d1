"""What results give: tables, frames, pictures, files, notebooks; and simulation, discrepancy and design from them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flightmodel import Aircraft, Flight, FlightModelError, Identification, design, discrepancy, identify, simulate
from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

pytestmark = pytest.mark.whole_flight


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return Aircraft.read("ultrastick25e")


@pytest.fixture(scope="module")
def flight(recording: Path, aircraft: Aircraft) -> Flight:
    return Flight.read(recording, aircraft)


@pytest.fixture(scope="module")
def result(identified: Identification) -> Identification:
    return identified


def test_an_identification_is_a_table_a_frame_a_picture_and_files(result: Identification, tmp_path: Path) -> None:
    frame = result.to_frame()
    assert list(frame.columns) == ["value", "std", "low", "high", "refused"]
    assert frame.loc["Cm_alpha", "value"] == result.values["Cm_alpha"]
    assert "Cm_alpha" in str(result)
    assert "<table>" in result._repr_html_()
    result.plot().savefig(tmp_path / "a.png")
    result.save(tmp_path / "a.json")
    result.save_model(tmp_path / "m.json")
    result.report(tmp_path / "a.html")
    assert json.loads((tmp_path / "a.json").read_text())["schema"] == "identification/1"
    assert read_model(tmp_path / "m.json").values() == result.values
    assert "<html" in (tmp_path / "a.html").read_text()
    assert (tmp_path / "a.png").stat().st_size > 20_000


def test_a_result_fits_a_screen_and_has_what_engineers_ask_of_it(result: Identification) -> None:
    shown = str(result).splitlines()
    assert len(shown) <= 40
    assert max(map(len, shown)) <= 100
    assert {str(one["name"]) for one in result.modes} >= {"short period", "Dutch roll"}
    assert np.array(result.state_space["A"]).shape == (len(result.state_space["states"]),) * 2
    pitch, unit = result.dimensional["M_alpha"], result.dimensional["M_alpha"]["unit"]
    # By hand: the moment of the mean dynamic pressure over Iyy.
    system, aircraft = result.state_space, load_vehicle("ultrastick25e")
    pressure = 0.5 * system["air_density"] * system["airspeed"] ** 2
    moment = pressure * aircraft.geometry.S * aircraft.geometry.c / aircraft.mass.Iyy
    assert pitch["value"] == pytest.approx(moment * result.values["Cm_alpha"], rel=0.01)
    assert unit == "1/s^2"
    assert pitch["std"] / abs(pitch["value"]) < 0.5 * result.stds["Cm_alpha"] / abs(result.values["Cm_alpha"])
    names, covariance = result.covariance
    assert covariance.shape == (len(names),) * 2
    assert np.sqrt(np.diag(covariance)) == pytest.approx([result.stds[name] for name in names])
    assert np.linalg.eigvalsh(covariance / np.outer(*2 * [np.sqrt(np.diag(covariance))])).min() > -1e-9


def test_a_flight_with_a_dead_pitot_is_identified_and_simulated(flight: Flight, aircraft: Aircraft) -> None:
    signals = flight.signals.signals
    dead = replace(signals["airspeed"], values=np.zeros_like(signals["airspeed"].values))
    without = replace(flight, signals=replace(flight.signals, signals={**signals, "airspeed": dead}))
    found = identify(without, aircraft, progress=False)
    assert any("GPS velocity" in line for line in found.warnings)
    assert simulate(found, aircraft, without, restart_s=5.0).tic["q"] < 0.2


def test_what_is_no_flight_no_aircraft_or_no_model_is_said_in_a_line(flight: Flight, aircraft: Aircraft) -> None:
    wrong: list[tuple[object, object, str]] = [
        (aircraft, flight, "the flight comes first, then the aircraft"),
        (flight, "ultrastick25e", "a str is no aircraft: make one with Aircraft.read"),
        (flight, None, "a NoneType is no aircraft"),
        ("flight.mcap", aircraft, "a str is no flight"),
        (None, aircraft, "a NoneType is no flight"),
        ([flight, 3], aircraft, "a int is no flight"),
    ]
    for one, other, words in wrong:
        with pytest.raises(FlightModelError, match=words):
            identify(one, other, progress=False)  # type: ignore[arg-type]
    with pytest.raises(FlightModelError, match="a int is no model"):
        discrepancy(flight, aircraft, 3, progress=False)  # type: ignore[arg-type]
    with pytest.raises(FlightModelError, match="a float is no aircraft"):
        design(1.0, "ultrastick25e", progress=False)  # type: ignore[arg-type]


def test_a_coefficient_that_is_refused_begins_at_the_mean_of_its_estimate() -> None:
    model = read_model("ultrastick25e")
    refused = {"Cm_0": Coefficient(None, refused="not told", mean=0.03), "Cm_q": Coefficient(None, refused="not told")}
    starts = replace(model, coefficients={**model.coefficients, **refused}).with_starts().values()
    assert (starts["Cm_0"], starts["Cm_q"]) == (0.03, 0.0)
    assert starts["CL_alpha"] == model.values()["CL_alpha"]


def test_a_model_is_flown_with_the_flight_s_inputs(
    result: Identification, flight: Flight, aircraft: Aircraft, tmp_path: Path
) -> None:
    found = simulate(result, aircraft, flight, restart_s=5.0)
    assert found.rms["q"] < 0.01
    assert max(found.tic.values()) < 0.2
    wrong = simulate(result.model.with_coefficient("Cm_alpha", -0.2), aircraft, flight, restart_s=5.0)
    assert wrong.rms["alpha"] > 2.0 * found.rms["alpha"]
    whole = simulate(result, aircraft, flight)
    assert whole.time_s.size - found.time_s.size in (0, 1)  # a last sample begins no simulation of its own
    assert list(found.to_frame().columns.levels[0]) == ["measured", "simulated"]
    found.plot().savefig(tmp_path / "a.png")
    with pytest.raises(FlightModelError, match="restart_s is 0"):
        simulate(result, aircraft, flight, restart_s=0.0)


def test_a_design_says_what_the_next_flight_will_tell(
    result: Identification, aircraft: Aircraft, tmp_path: Path
) -> None:
    found = design(aircraft, result, duration_s=20.0, progress=False)
    assert 0.0 < found.stds["Cm_alpha"] < 0.05
    assert "multisine" in found.table()
    found.save(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["schema"] == "plan/1"


def test_nothing_is_missing_from_the_model_that_was_flown(flight: Flight, aircraft: Aircraft, tmp_path: Path) -> None:
    found = discrepancy(flight, aircraft, "ultrastick25e", progress=False)
    assert found.verdict == "none"
    assert found.effects == {}
    assert found.sentence in str(found)
    assert found.sentence in found._repr_html_()
    found.plot().savefig(tmp_path / "a.png")
    assert found.model.values().keys() == read_model("ultrastick25e").values().keys()


def test_a_flight_is_a_frame_and_a_picture(flight: Flight, tmp_path: Path) -> None:
    frame = flight.to_frame(["alpha", "vn"])
    assert frame.index.name == "time_s"
    assert np.isfinite(frame["alpha"]).sum() > 5 * np.isfinite(frame["vn"]).sum() > 0
    flight.plot(["alpha", "q"]).savefig(tmp_path / "a.png")
    time_s, alpha = flight["alpha"]
    assert time_s.shape == alpha.shape
    assert "<table>" in flight._repr_html_()
    with pytest.raises(FlightModelError, match="no signal gamma; it has"):
        flight["gamma"]

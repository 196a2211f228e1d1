"""Endurance and range by a power balance: closed forms, and a flight with a motor and propeller of a wind tunnel."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from electric_drive import Drive, with_battery
from simulated import fly_mav

from gcs.cli import main
from gcs.errors import SettingsError
from gcs.exports.electric_flight import LevelFlight, balance_of, electric_figures
from gcs.text.jsontext import dumps
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import VEHICLES, load_vehicle
from sysid.identification.result_file import result_json
from sysid.identify import identify

WEIGHT, AREA, RHO = 19.6, 0.4, 1.2
FLOWN = read_model("iitb-mav").with_coefficient("CL_q", 3.0).with_coefficient("Cm_q", -6.0)


def level(wrong: float = 1.0, weight: float = WEIGHT, rho: float = RHO) -> LevelFlight:
    """Of a parabolic polar, CD = 0.03 + 0.06 CL^2, times an error."""
    speed = np.linspace(8.0, 30.0, 6000)
    pressure = 0.5 * rho * speed**2 * AREA
    drag = wrong * pressure * (0.03 + 0.06 * (weight / pressure) ** 2)
    return LevelFlight(speed, drag, weight, WEIGHT, rho)


def windows(share: float, rest: float, scatter: float = 0.0) -> dict[str, object]:
    """Steady flight of that aircraft whose battery's power gets into thrust times airspeed by one share."""
    g = np.random.default_rng(2)
    found = []
    for speed, load, gained in (
        (12.0, 1.0, 0.0),
        (15.0, 1.1, 0.8),
        (18.0, 1.0, -0.5),
        (14.0, 0.95, 2.0),
        (16.0, 1.0, 0.3),
    ):
        pressure = 0.5 * RHO * speed**2 * AREA
        drag = pressure * (0.03 + 0.06 * (load * WEIGHT / pressure) ** 2)
        power = (drag * speed + WEIGHT * gained) / share * (1.0 + scatter * g.standard_normal()) + rest
        found.append({"airspeed": speed, "air_density": RHO, "load": load, "power": power, "gained": gained})
    return {"rest": rest, "windows": 4 * found}


def test_least_power_and_least_energy_are_those_of_the_textbook() -> None:
    """Anderson, Aircraft Performance and Design, 5.6: CD_0 = k CL^2 for the farthest, a third of it for the longest."""
    balance = balance_of(windows(0.5, 0.0), None)
    assert not isinstance(balance, str)
    found = electric_figures(balance, level(), (0.0, 0.0), 50.0)
    assert found["drive_efficiency"][0] == pytest.approx(0.5, abs=1e-6)
    for name, best in (
        ("min_battery_power_speed", np.sqrt(3.0 * 0.03 / 0.06)),
        ("min_energy_speed", np.sqrt(0.03 / 0.06)),
    ):
        assert found[name][0] == pytest.approx(np.sqrt(2.0 * WEIGHT / (RHO * AREA * best)), rel=2e-3)
    # At best glide D / W is 2 sqrt(CD_0 k); half of the energy gets there.
    farthest = 50.0 * 3600.0 * 0.5 / (WEIGHT * 2.0 * np.sqrt(0.03 * 0.06)) / 1000.0
    assert found["range"][0] == pytest.approx(farthest, rel=1e-3)
    assert found["min_energy_per_km"][0] == pytest.approx(50.0 / farthest, rel=1e-3)


def test_what_else_takes_power_shortens_the_flight_and_the_drag_s_own_error_cancels() -> None:
    figures = []
    for rest, wrong in ((0.0, 1.0), (10.0, 1.0), (10.0, 1.2)):
        balance = balance_of(windows(0.5, rest), None)
        assert not isinstance(balance, str)
        figures.append(electric_figures(balance, level(wrong), (0.0, 0.0), 50.0))
    assert figures[1]["min_battery_power"][0] == pytest.approx(figures[0]["min_battery_power"][0] + 10.0, rel=1e-6)
    # With a fifth more drag, wrongly, a fifth more of the power is found in the air, but for what was gained.
    assert figures[2]["min_battery_power"][0] == pytest.approx(figures[1]["min_battery_power"][0], rel=0.04)
    assert figures[2]["drive_efficiency"][0] > 1.1 * figures[1]["drive_efficiency"][0]


def test_with_another_mass_in_thinner_air_the_efficiency_stays() -> None:
    balance = balance_of(windows(0.5, 0.0), None)
    assert not isinstance(balance, str)
    found = electric_figures(balance, level(weight=1.4 * WEIGHT, rho=0.8 * RHO), (0.0, 0.0), 50.0)
    assert found["drive_efficiency"][0] == pytest.approx(0.5, abs=1e-5)
    best = np.sqrt(2.0 * 1.4 * WEIGHT / (0.8 * RHO * AREA * np.sqrt(0.03 / 0.06)))
    assert found["min_energy_speed"][0] == pytest.approx(best, rel=2e-3)


@pytest.mark.parametrize(("found", "words"), [
    (None, "log its voltage and current"), ({"rest": 0.0, "windows": []}, "in 0 steady half seconds"),
])  # fmt: skip
def test_without_a_balance_nothing_is_said(found: dict[str, object] | None, words: str) -> None:
    said = balance_of(found, None)
    assert isinstance(said, str)
    assert words in said


def test_a_balance_that_is_none_is_refused_in_a_line() -> None:
    with pytest.raises(SettingsError, match="make it again with gcs identify"):
        balance_of({"rest": 0.0, "windows": 30 * [{"airspeed": 12.0}]}, None)


@pytest.mark.whole_flight
def test_a_battery_lasts_as_long_as_the_sheet_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = Drive("10x4.7", kv=95.0, resistance=0.07)
    craft = load_vehicle("iitb-mav")
    assert craft.propulsion is not None
    # Slowly, so that what costs least lies within the speeds that the sheet looks at.
    craft = replace(craft, flight=replace(craft.flight, airspeed=12.5))
    signals, flight = fly_mav("multisine,throttle-step", 71, model=FLOWN, vehicle=craft, max_step=0.005)
    truth = flight.truth
    given = {"time_s": flight.time_s, "thrust": truth["thrust"], "airspeed": truth["V"], "rho": truth["rho"]}
    signals = with_battery(signals, drive, given, 5.0, 71)
    printed = Propulsion(line=craft.propulsion.line, diameter=drive.diameter, pitch=0.119, tau=0.1)
    result = result_json(identify([signals], replace(craft, propulsion=printed)))
    (tmp_path / "result.json").write_text(dumps(result), encoding="utf-8")
    text = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")
    begin = text.index("[propulsion]")
    end = text.index("\n[", begin + 1)
    text = (
        f"{text[:begin]}[propulsion]\nline = [0.1, 0.0, 0.0]\ndiameter = {drive.diameter}\npitch = 0.119\n{text[end:]}"
    )
    (tmp_path / "mine.toml").write_text(text[: text.index("[calibration")], encoding="utf-8")
    asked = ["performance", str(tmp_path / "result.json"), "--vehicle", str(tmp_path / "mine.toml")]
    assert main([*asked, "--battery", "40", "--json"]) == 0
    sheet = json.loads(capsys.readouterr().out)
    # Level flight of the aircraft that was flown, by its own coefficients, and what the drive takes for it.
    values, size = FLOWN.values(), craft.geometry
    speed = np.linspace(9.5, 22.0, 2000)
    lift = craft.mass.mass * 9.80665 / (0.5 * sheet["air_density"] * speed**2 * size.S)
    # Thrust that points up by the angle of attack carries some of the weight.
    pressure = 0.5 * sheet["air_density"] * speed**2 * size.S
    for _ in range(50):
        alpha = (lift - values["CL_0"]) / values["CL_alpha"]
        drag = pressure * (values["CD_0"] + values["CD_k"] * lift**2)
        lift = (craft.mass.mass * 9.80665 - drag * np.tan(alpha)) / pressure
    drag = drag / np.cos(alpha)
    power = drive.power(drag, speed, np.full(speed.size, sheet["air_density"])) + drive.electronics
    wanted = {"endurance": 40.0 * 60.0 / power.min(), "range": 40.0 / np.min(power / speed / 3.6)}
    for name, value in wanted.items():
        entry = sheet["figures"][name]
        assert abs(entry["value"] / value - 1.0) < 0.10, name
        low, high = entry["interval"]
        assert low < value < high, name
    assert 0.5 < sheet["figures"]["drive_efficiency"]["value"] < 0.95
    assert main([*asked, "--battery", "40", "-o", str(tmp_path / "sheet.json")]) == 0
    assert main(["report", str(tmp_path / "sheet.json"), "-o", str(tmp_path / "sheet.html")]) == 0
    page = (tmp_path / "sheet.html").read_text(encoding="utf-8")
    assert "How it performs: iitb-mav" in page
    assert page.count("<svg") == 2
    assert "farthest, still air" in page
    capsys.readouterr()
    assert main([*asked]) == 0
    said = capsys.readouterr().out
    assert "least power of the battery" in said
    assert "give what the battery holds in Wh" in said
    assert main([*asked, "--battery", "-3"]) == 2
    assert "battery -3: give the energy that it holds in Wh" in capsys.readouterr().err

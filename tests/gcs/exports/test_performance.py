"""The performance sheet against closed forms of a parabolic polar, and what it refuses."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.cli import main
from gcs.errors import ExportError, SettingsError
from gcs.exports.exported import Exported
from gcs.exports.performance import performance, performance_text
from sim_vehicle.effects import parse_effect
from sim_vehicle.model.model_file import Coefficient, Correlation, Model, read_model
from sim_vehicle.physics.atmosphere import density
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import load_vehicle

CD_0, K, G = 0.03, 0.06, 9.80665
THRUST = 2.0


def parabolic(std: float = 0.0) -> Exported:
    """An aircraft whose elevator lifts nothing: its trimmed polar is CD_0 + k CL^2. std: share of CD_0 and k."""
    vehicle = load_vehicle("iitb-mav")
    vehicle = replace(vehicle, propulsion=Propulsion(max_thrust=THRUST))
    values = {"CL_0": 0.2, "CL_alpha": 4.0, "CD_0": CD_0, "CD_k": K, "Cm_0": 0.0, "Cm_alpha": -0.5, "Cm_de": 1.2}
    entries = {
        name: Coefficient(value, std * value or None if name[:2] == "CD" else None) for name, value in values.items()
    }
    known = Correlation(("CD_0", "CD_k"), ((1.0, 0.0), (0.0, 1.0))) if std else None
    return Exported(Model("parabola", entries, validity={"airspeed": (7.0, 24.0)}, correlation=known), vehicle)


def test_glide_sink_and_speed_are_the_closed_forms() -> None:
    model = parabolic()
    found = performance(model, altitude=500.0)["figures"]
    rho = float(density(np.array(500.0)))
    loading = 2.0 * model.vehicle.mass.mass * G / (rho * model.vehicle.geometry.S)
    ratio = 1.0 / (2.0 * math.sqrt(CD_0 * K))
    assert found["best_glide_ratio"]["value"] == pytest.approx(ratio, rel=2e-3)
    # The lift of a glide is the weight's part across the path.
    glide = math.sqrt(loading / math.sqrt(CD_0 / K) * math.cos(math.atan(1.0 / ratio)))
    assert found["best_glide_speed"]["value"] == pytest.approx(glide, rel=5e-3)
    lift = math.sqrt(3.0 * CD_0 / K)
    sink = math.sqrt(loading / lift) * 4.0 * CD_0 / lift
    assert found["min_sink"]["value"] == pytest.approx(sink, rel=0.01)
    # Thrust is drag: a quadratic in the dynamic pressure.
    area, weight = model.vehicle.geometry.S, model.vehicle.mass.mass * G
    pressure = (THRUST + math.sqrt(THRUST**2 - 4.0 * CD_0 * K * weight**2)) / (2.0 * CD_0 * area)
    assert found["max_speed"]["value"] == pytest.approx(math.sqrt(2.0 * pressure / rho), rel=0.01)
    assert "no stall" in found["stall_speed"]["refused"]
    assert not any("interval" in entry for entry in found.values())


def test_a_hot_day_is_a_thinner_air() -> None:
    """The gas law: at 40 degrees Celsius, pressure as it is, speeds grow by the root of the temperatures' ratio."""
    model = parabolic()
    usual, hot = performance(model), performance(model, temperature=40.0)
    assert performance(model, temperature=15.0)["air_density"] == pytest.approx(usual["air_density"])
    assert hot["air_density"] / usual["air_density"] == pytest.approx(288.15 / 313.15)
    speeds = [one["figures"]["best_glide_speed"]["value"] for one in (usual, hot)]
    assert speeds[1] / speeds[0] == pytest.approx(math.sqrt(313.15 / 288.15), rel=5e-3)


def test_intervals_are_the_errors_of_the_polar_carried_on() -> None:
    found = performance(parabolic(std=0.05))["figures"]["best_glide_ratio"]
    # 1 / (2 sqrt(CD_0 k)): half of each share.
    assert found["std"] / found["value"] == pytest.approx(0.05 / math.sqrt(2.0), rel=0.2)
    low, high = found["interval"]
    assert low < found["value"] < high


def test_what_was_not_flown_and_what_is_not_known_is_said() -> None:
    model = parabolic()
    narrow = replace(model, model=replace(model.model, validity={"airspeed": (15.0, 16.0)}))
    found = performance(narrow)
    assert "beyond which the model is not asked" in found["figures"]["min_sink"]["refused"]
    assert [row["extrapolated"] for row in found["speeds"]].count(False) < 6
    silent = performance(replace(model, vehicle=replace(model.vehicle, propulsion=None)))
    assert "full throttle is not known" in silent["figures"]["max_climb"]["refused"]
    assert "beyond" in performance_text(found)
    for wrong in ({"mass": 0.0}, {"mass": math.nan}, {"altitude": 1e6}, {"temperature": 313.15}):
        with pytest.raises(SettingsError):
            performance(model, **wrong)


def test_a_stall_that_is_not_reached_and_a_drag_that_is_not_known_give_no_number() -> None:
    model = parabolic()
    effect, values = parse_effect("stall:alpha_stall=0.5")
    stalls = replace(model, model=replace(model.model.with_effect(effect, values), validity={"airspeed": (18.0, 20.0)}))
    assert "is not reached" in performance(stalls)["figures"]["stall_speed"]["refused"]
    entries = {n: e for n, e in model.model.coefficients.items() if n[:2] != "CD"}
    with pytest.raises(ExportError, match="no drag"):
        performance(replace(model, model=replace(model.model, coefficients=entries)))


def test_the_command_prints_the_sheet(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["performance", "iitb-mav", "--vehicle", "iitb-mav", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    truth = read_model("iitb-mav").values()
    assert found["schema"] == "performance/1"
    assert found["figures"]["best_glide_ratio"]["value"] == pytest.approx(
        1.0 / (2.0 * math.sqrt(truth["CD_0"] * truth["CD_k"])), rel=0.01
    )
    assert main(["performance", "iitb-mav", "--vehicle", "iitb-mav", "--mass", "-1"]) == 2
    assert "give the mass in kg" in capsys.readouterr().err

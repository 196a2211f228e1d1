"""The model for Gazebo: its file as a parser reads it, and the equations of its AdvancedLiftDrag system.

These are written from the system's own source (gz-sim, advanced_lift_drag), not from the exporter.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from export_flights import craft

from gcs.errors import ExportError
from gcs.exports import gazebo
from gcs.exports.exported import Exported
from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle


def written(folder: Path, model: Model, vehicle: Vehicle) -> tuple[ElementTree.Element, list[str]]:
    notes = gazebo.write(Exported(model, vehicle), folder)
    root = ElementTree.parse(folder / "model.sdf").getroot()
    found = root.find("model")
    assert found is not None
    return found, notes


def numbers(model: ElementTree.Element) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Elements of the system, and those of each control surface."""
    system = model.find("plugin[@name='gz::sim::systems::AdvancedLiftDrag']")
    assert system is not None
    plain = {one.tag: float(one.text or "") for one in system if len(one) == 0 and one.tag not in
             ("forward", "upward", "cp", "link_name")}  # fmt: skip
    surfaces = {}
    for one in system.findall("control_surface"):
        entries = {each.tag: each.text or "" for each in one}
        name = entries.pop("name")
        surfaces[name] = {tag: float(text) for tag, text in entries.items()}
    return plain, surfaces


def gazebo_loads(
    e: dict[str, float], surfaces: dict[str, dict[str, float]], motion: np.ndarray, joints: dict[str, float]
) -> np.ndarray:
    """Forces, N, and moments, N m, in body axes x forward, y right, z down, of u v w p q r."""
    u, v, w, p, q, r = motion
    in_plane = np.hypot(u, w)
    alpha, beta = np.arctan2(w, u), np.arctan2(v, u)
    span, chord = np.sqrt(e["area"] * e["AR"]), e["mac"]
    half_density_speed = 0.5 * e["air_density"] * in_plane
    pressure = half_density_speed * in_plane
    by_surface = {
        axis: sum(np.degrees(joints[name]) * s[f"{axis}_ctrl"] * s["direction"] for name, s in surfaces.items())
        for axis in ("CL", "CD", "CY", "Cell", "Cem", "Cen")
    }

    def get(name: str) -> float:
        return e.get(name, 0.0)

    def with_rates(axis: str, still: float) -> float:
        rates = get(f"{axis}p") * p * span / 2 + get(f"{axis}q") * q * chord / 2 + get(f"{axis}r") * r * span / 2
        return float(still * pressure + rates * half_density_speed)

    CL = get("CL0") + get("CLa") * alpha + get("CLb") * beta + by_surface["CL"]
    CD = get("CD0") + CL**2 / (np.pi * e["AR"] * e["eff"]) + by_surface["CD"]
    lift, drag = e["area"] * with_rates("CL", CL), e["area"] * with_rates("CD", CD)
    side = e["area"] * with_rates("CY", get("CYa") * alpha + get("CYb") * beta + by_surface["CY"])
    turning = {
        axis: with_rates(axis, get(f"{axis}0") * (axis == "Cem") + get(f"{axis}a") * alpha + get(f"{axis}b") * beta
                         + by_surface[axis])
        for axis in ("Cell", "Cem", "Cen")
    }  # fmt: skip
    return np.array([
        lift * np.sin(alpha) - drag * np.cos(alpha), side, -lift * np.cos(alpha) - drag * np.sin(alpha),
        e["area"] * span * turning["Cell"], e["area"] * chord * turning["Cem"], e["area"] * span * turning["Cen"],
    ])  # fmt: skip


def test_its_equations_give_the_model_s_forces_and_moments(tmp_path: Path) -> None:
    """In straight flow; with sideslip its angle and dynamic pressure are other ones, as documented."""
    vehicle, model = craft("iitb-mav")
    bare = replace(
        model, coefficients={n: c for n, c in model.coefficients.items() if n not in ("CL_alpha2", "Cm_alpha_de")}
    )
    # What it can hold beyond a usual model's terms.
    for name, value in {
        "CL_q": 4.0,
        "CD_q": 0.1,
        "CD_de": 0.02,
        "CY_alpha": 0.01,
        "CL_p": 0.03,
        "Cm_r": -0.2,
        "CD_k": 0.06,
    }.items():
        bare = bare.with_coefficient(name, value)
    for gone in ("CD_CL", "CY_0", "Cl_0", "Cn_0"):
        bare = replace(bare, coefficients={n: c for n, c in bare.coefficients.items() if n != gone})
    found, notes = written(tmp_path / "a", bare, vehicle)
    assert not [note for note in notes if "no element" in note]
    elements, surfaces = numbers(found)
    plant = Plant(vehicle, bare)
    places = {name: OUTPUTS.index(name) for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn")}
    S, b, c = vehicle.geometry.S, vehicle.geometry.b, vehicle.geometry.c
    generator = np.random.default_rng(5)
    for _ in range(1000):
        alpha, speed = generator.uniform(-0.2, 0.35), generator.uniform(8.0, 30.0)
        rates = generator.uniform(-2.0, 2.0, 3)
        angles = generator.uniform(-0.4, 0.4, 3)
        x = np.zeros(14)
        x[2], x[3], x[5], x[6:10], x[10:13] = (
            -100.0, speed * np.cos(alpha), speed * np.sin(alpha), quaternion(0, 0, 0), rates,
        )  # fmt: skip
        state = plant.state_at(x, np.array([*angles, 0.0]), np.array([*angles, 0.0]))
        shown = plant.outputs(state)
        CL, CD, CY, Cl, Cm, Cn = (shown[places[name]] for name in places)
        qS = 0.5 * 1.18 * speed**2 * S
        ours = qS * np.array([
            CL * np.sin(alpha) - CD * np.cos(alpha), CY, -CL * np.cos(alpha) - CD * np.sin(alpha),
            b * Cl, c * Cm, b * Cn,
        ])  # fmt: skip
        joints = dict(zip(("elevator_joint", "aileron_joint", "rudder_joint"), angles, strict=True))
        # There induced drag is that of the lift at rest, without rates.
        still = CL - bare.values()["CL_q"] * rates[1] * c / 2 / speed - bare.values()["CL_p"] * rates[0] * b / 2 / speed
        less = qS * bare.values()["CD_k"] * (CL**2 - still**2)
        ours[0] += less * np.cos(alpha)
        ours[2] += less * np.sin(alpha)
        theirs = gazebo_loads(elements, surfaces, np.array([x[3], 0.0, x[5], *rates]), joints)
        assert np.allclose(theirs, ours, rtol=1e-9, atol=1e-9 * qS)


def test_the_file_is_an_aircraft_and_says_what_is_left_out(tmp_path: Path) -> None:
    vehicle, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    late, values = parse_effect("mass_error:scale=0.1")
    found, notes = written(tmp_path / "a", model.with_effect(late, values), vehicle)
    names = [one.get("name") for one in found.findall("link")]
    assert names == ["base_link", "elevator", "aileron", "rudder", "propeller"]
    parts = {name: found.find(f"link[@name='base_link']/inertial/{name}") for name in ("mass", "inertia/ixz")}
    told = {name: float(one.text or "") for name, one in parts.items() if one is not None}
    assert told == {"mass": 1.1 * vehicle.mass.mass, "inertia/ixz": vehicle.mass.Ixz}
    joints = {one.get("name") for one in found.findall("joint")}
    _, surfaces = numbers(found)
    assert set(surfaces) < joints
    assert any("CL_alphadot" in note for note in notes)
    assert "no element for" in (tmp_path / "a" / "model.sdf").read_text()
    config = ElementTree.parse(tmp_path / "a" / "model.config").getroot()
    assert config.findtext("sdf") == "model.sdf"


def test_an_effect_that_it_cannot_hold_ends_it(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="Gazebo does not hold the effect stall"):
        gazebo.write(Exported(read_model("aerosonde"), load_vehicle("aerosonde")), tmp_path / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="cannot be written"):
        gazebo.write(Exported(read_model("iitb-mav"), load_vehicle("iitb-mav")), tmp_path / "file" / "b")

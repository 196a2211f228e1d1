"""A model that Gazebo flies: FOLDER/model.sdf and FOLDER/model.config, aerodynamics by its AdvancedLiftDrag system.

Links are in Gazebo's axes, x forward, y left, z up; the system counts angles, rates and coefficients as we do, beside
that sideslip is atan(v / u) and dynamic pressure that of the motion in the plane of symmetry (source: its
implementation, gz-sim, src/systems/advanced_lift_drag). Control derivatives are per degree there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from gcs.errors import ExportError
from gcs.exports.exported import AXES_AND_SIGNS, Exported, require_new
from gcs.exports.xml_folder import file_name, travel_of, write_folder
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle

EFFECTS_HELD = frozenset({"inertia_error", "mass_error"})
# The names that the system gives to axes, and to what a coefficient goes with.
_AXES = {"CL": "CL", "CD": "CD", "CY": "CY", "Cl": "Cell", "Cm": "Cem", "Cn": "Cen"}
_BY = {"alpha": "a", "beta": "b", "p": "p", "q": "q", "r": "r"}
# What it has no element for.
_NONE = frozenset({"CD_alpha", "CD_beta", "CY_0", "Cl_0", "Cn_0"})
_JOINTS = {"de": "elevator", "da": "aileron", "dr": "rudder"}
# Beyond any angle, rad: the system's own stall, whose sharpness is fixed, is never reached.
_NO_STALL = math.pi
# An efficiency by which lift costs no drag.
_NO_INDUCED_DRAG = 1e9
_SURFACE_KG, _SURFACE_KG_M2 = 1e-3, 1e-6

_Node = ElementTree.Element


def write(model: Exported, folder: Path) -> list[str]:
    """Write the model's folder. Returns what the form does not hold, a line each.

    Raises ExportError where the folder exists, or the model has an effect that Gazebo cannot be given so.
    """
    require_new(folder)
    effects = model.effects_flown("Gazebo", EFFECTS_HELD)
    name = file_name(model.vehicle)
    held, lost = _elements(model)
    notes = [
        *model.left_out,
        *([f"no element for {', '.join(lost)}"] if lost else []),
        "thrust by the throttle: a thrust in N is commanded on the topic of the propeller's joint",
        "no ground contact",
    ]
    sdf = ElementTree.Element("sdf", version="1.9")
    remark = f" {model.title}. {AXES_AND_SIGNS} Left out: {'; '.join(notes)}. ".replace("--", "- -")
    sdf.append(ElementTree.Comment(remark))
    sdf.append(_model(model.vehicle, name, effects, held))
    config = ElementTree.Element("model")
    _text(config, "name", name)
    _text(config, "version", "1.0")
    ElementTree.SubElement(config, "sdf", version="1.9").text = "model.sdf"
    _text(config, "description", f"{model.title}.")
    write_folder(folder, {"model.sdf": sdf, "model.config": config})
    return notes


def _elements(model: Exported) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Elements of the system ("") and of each control surface, and the coefficients that there is none for."""
    joints = _joints_of(model.vehicle)
    found: dict[str, dict[str, float]] = {"": {}, **{surface: {} for surface in joints}}
    lost = []
    geometry = model.vehicle.geometry
    for name, value in model.model.flown().items():
        axis, _, by = name.partition("_")
        if name in _NONE:
            lost.append(name)
        elif by == "0":
            found[""][f"{_AXES[axis]}0"] = value
        elif by in _BY:
            found[""][f"{_AXES[axis]}{_BY[by]}"] = value
        elif by in joints:
            found[by][f"{_AXES[axis]}_ctrl"] = math.radians(value)
        elif name == "CD_k" and value > 0.0:
            found[""]["eff"] = geometry.S / (math.pi * geometry.b**2 * value)
        else:
            lost.append(name)
    found[""].setdefault("eff", _NO_INDUCED_DRAG)
    return found, lost


def _joints_of(vehicle: Vehicle) -> dict[str, str]:
    """Factor of the model -> name of its joint."""
    return {**_JOINTS, **{name: name for name in vehicle.named_controls}}


def _model(
    vehicle: Vehicle, name: str, effects: Mapping[str, Mapping[str, float]], held: Mapping[str, Mapping[str, float]]
) -> _Node:
    geometry, propulsion = vehicle.geometry, vehicle.propulsion
    model = ElementTree.Element("model", name=name)
    base = ElementTree.SubElement(model, "link", name="base_link")
    base.append(_inertial(vehicle, effects))
    joints = _joints_of(vehicle)
    for surface, joint in joints.items():
        if joint in vehicle.controls:
            model.append(_light_link(joint))
            control = vehicle.controls[joint]
            model.append(_joint(joint, (0.0, 1.0, 0.0), *travel_of(control)))
            model.append(_position_controller(joint))
        elif held[surface]:
            raise ExportError(f"{vehicle.path}: has no {joint}, which the model's coefficients by {surface} are of")
    if propulsion is not None:
        x, y, z = propulsion.line
        model.append(_light_link("propeller", (x, -y, -z)))
        tilt = propulsion.inclination
        model.append(_joint("propeller", (math.cos(tilt), 0.0, math.sin(tilt)), -1e16, 1e16))
        thruster = _plugin("gz-sim-thruster-system", "gz::sim::systems::Thruster")
        _text(thruster, "joint_name", "propeller_joint")
        for tag in ("thrust_coefficient", "fluid_density", "propeller_diameter"):
            _text(thruster, tag, "1.0")
        # By forces on its joint a propeller that weighs next to nothing would never come to rest.
        _text(thruster, "velocity_control", "true")
        model.append(thruster)
    lift = _plugin("gz-sim-advanced-lift-drag-system", "gz::sim::systems::AdvancedLiftDrag")
    density = vehicle.environment.air_density or SEA_LEVEL_DENSITY
    sizes = {"area": geometry.S, "AR": geometry.b**2 / geometry.S, "mac": geometry.c, "air_density": density}
    for tag, value in {**sizes, "alpha_stall": _NO_STALL, **held[""]}.items():
        _text(lift, tag, repr(float(value)))
    for tag, text in (("forward", "1 0 0"), ("upward", "0 0 1"), ("cp", "0 0 0"), ("link_name", "base_link")):
        _text(lift, tag, text)
    flown = [surface for surface in joints if joints[surface] in vehicle.controls]
    _text(lift, "num_ctrl_surfaces", str(len(flown)))
    for surface in flown:
        node = ElementTree.SubElement(lift, "control_surface")
        _text(node, "name", f"{joints[surface]}_joint")
        _text(node, "direction", "1")
        for axis in ("CD", "CY", "CL", "Cell", "Cem", "Cen"):
            _text(node, f"{axis}_ctrl", repr(held[surface].get(f"{axis}_ctrl", 0.0)))
    model.append(lift)
    return model


def _inertial(vehicle: Vehicle, effects: Mapping[str, Mapping[str, float]]) -> _Node:
    """Mass and the tensor in Gazebo's axes: its element in x and z is minus the integral of x z, and z is up there, so
    that it is the Ixz of ours.
    """
    mass = vehicle.mass
    turned = 1.0 + effects.get("inertia_error", {}).get("scale", 0.0)
    node = ElementTree.Element("inertial")
    _text(node, "mass", repr(mass.mass * (1.0 + effects.get("mass_error", {}).get("scale", 0.0))))
    tensor = ElementTree.SubElement(node, "inertia")
    entries = {"ixx": mass.Ixx, "ixy": 0.0, "ixz": mass.Ixz, "iyy": mass.Iyy, "iyz": 0.0, "izz": mass.Izz}
    for tag, value in entries.items():
        _text(tensor, tag, repr(turned * value))
    return node


def _light_link(name: str, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> _Node:
    """A link that weighs next to nothing: what it stands for is in the aircraft's own mass."""
    node = ElementTree.Element("link", name=name)
    _text(node, "pose", f"{' '.join(repr(one + 0.0) for one in place)} 0 0 0")
    inertial = ElementTree.SubElement(node, "inertial")
    _text(inertial, "mass", repr(_SURFACE_KG))
    tensor = ElementTree.SubElement(inertial, "inertia")
    for tag in ("ixx", "iyy", "izz"):
        _text(tensor, tag, repr(_SURFACE_KG_M2))
    return node


def _joint(name: str, axis: tuple[float, float, float], low: float, high: float) -> _Node:
    node = ElementTree.Element("joint", name=f"{name}_joint", type="revolute")
    _text(node, "parent", "base_link")
    _text(node, "child", name)
    turning = ElementTree.SubElement(node, "axis")
    _text(turning, "xyz", " ".join(repr(one) for one in axis))
    limit = ElementTree.SubElement(turning, "limit")
    _text(limit, "lower", repr(low))
    _text(limit, "upper", repr(high))
    return node


def _position_controller(name: str) -> _Node:
    node = _plugin("gz-sim-joint-position-controller-system", "gz::sim::systems::JointPositionController")
    _text(node, "joint_name", f"{name}_joint")
    _text(node, "use_velocity_commands", "true")
    return node


def _plugin(filename: str, name: str) -> _Node:
    return ElementTree.Element("plugin", filename=filename, name=name)


def _text(node: _Node, tag: str, text: str) -> None:
    ElementTree.SubElement(node, tag).text = text

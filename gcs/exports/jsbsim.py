"""An aircraft that JSBSim flies: FOLDER/aircraft/NAME/NAME.xml, and FOLDER/flat.xml, an earth without curvature.
FlightGear, whose flight model JSBSim is, finds it by NAME-set.xml beside the former.

Forces act in body axes at AERORP, which is put at the centre of gravity; moments are about that point, as ours.
Deflections come from `fcs/elevator-cmd-norm`, `fcs/aileron-cmd-norm` and `fcs/rudder-cmd-norm`, of a control of another
name from `fcs/gcs/NAME-cmd-norm` (-1 to 1 over the travel of the vehicle file, positive as the vehicle file counts),
thrust from `fcs/throttle-cmd-norm` (0 to 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gcs.errors import ExportError
from gcs.exports.exported import AXES_AND_SIGNS, Exported, require_new
from gcs.exports.xml_folder import USUAL_TRAVEL, file_name, travel_of, write_folder
from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.model.aerodynamic_terms import AXES, Term, parse_term
from sim_vehicle.vehicle.propulsion import Curve, Polynomial, rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle

NAME = "jsbsim"
EFFECTS_HELD = frozenset(
    {
        *("actuator_lag", "cg_shift", "elastic_tail", "inertia_error", "mass_error", "motor_lag", "propwash_elevator"),
        *("reynolds_drag", "stall", "thrust_line_offset", "thrust_scale", "thrust_speed_loss"),
    }
)
_OF_THRUST = frozenset({"motor_lag", "propwash_elevator", "thrust_line_offset", "thrust_scale", "thrust_speed_loss"})
_FT = 0.3048
_POUND_FORCE = 0.45359237 * STANDARD_GRAVITY  # N
_SLUG = _POUND_FORCE / _FT  # kg
# JSBSim takes weights in pounds and divides them by this (FGJSBBase::slugtolb).
_POUNDS_IN_SLUG = 32.174049
# A radius of the earth by which a flight is flat, m.
_FLAT_RADIUS = 6.371e8
# Points of a propeller's curve: JSBSim joins those of a table by straight lines.
_CURVE_POINTS = 201
_SURFACES = {
    "de": ("elevator", "fcs/elevator-pos-rad"), "da": ("aileron", "fcs/left-aileron-pos-rad"),
    "dr": ("rudder", "fcs/rudder-pos-rad"),
}  # fmt: skip
_THROTTLE, _MOTOR, _THRUST = "fcs/throttle-cmd-norm", "fcs/motor-norm", "aero/gcs/thrust-lbs"
_ALPHA, _AIRSPEED, _QBAR = "aero/alpha-rad", "velocities/vt-fps", "aero/qbar-psf"
_SLOWEST = 1e-3  # revolutions a second, of a propeller at rest

_Node = ElementTree.Element


def write(model: Exported, folder: Path) -> list[str]:
    """Write the aircraft; `folder` becomes JSBSim's root. Returns what the form does not hold, a line each.

    Raises ExportError where the folder exists, or the model has an effect that JSBSim cannot be given so.
    """
    require_new(folder)
    effects = model.effects_flown("JSBSim", EFFECTS_HELD)
    name = file_name(model.vehicle)
    notes = [*model.left_out, *_assumed(model, effects), "no ground contact: JSBSim cannot roll or land it"]
    tree = _aircraft(model, name, effects, notes)
    place = f"aircraft/{name}/{name}"
    trees = {f"{place}.xml": tree, f"{place}-set.xml": _of_flightgear(model, name), "flat.xml": _planet(model.vehicle)}
    write_folder(folder, trees)
    return notes


def _assumed(model: Exported, effects: dict[str, dict[str, float]]) -> list[str]:
    """What the vehicle file lacks, and what stands for it. Raises ExportError where nothing can."""
    vehicle = model.vehicle
    if vehicle.propulsion is None:
        if needing := sorted(_OF_THRUST & effects.keys()):
            raise ExportError(f"{vehicle.path}: has no [propulsion], which the effect {needing[0]} is of")
        notes = ["no thrust: the vehicle file has no [propulsion]"]
    elif not vehicle.propulsion.by_throttle:
        raise ExportError(
            f"{vehicle.path}: nothing gives thrust by the throttle; give max_thrust, or max_rpm beside CT"
        )
    else:
        notes = []
    named = _places(vehicle).values()
    bare = [one for one, _ in named if one in vehicle.controls and not vehicle.controls[one].servos]
    return [*notes, *([f"travel of {', '.join(bare)} is not given: {USUAL_TRAVEL} rad assumed"] if bare else [])]


def _aircraft(model: Exported, name: str, effects: dict[str, dict[str, float]], notes: Sequence[str]) -> _Node:
    vehicle, geometry = model.vehicle, model.vehicle.geometry
    root = ElementTree.Element("fdm_config", name=name, version="2.0", release="BETA")
    head = ElementTree.SubElement(root, "fileheader")
    ElementTree.SubElement(head, "author").text = "gcs export-model"
    bars = "; ".join(
        f"{key} {entry.value:.6g}{'' if entry.std is None else f' +- {entry.std:.2g}'}"
        for key, entry in model.estimates.items()
    )
    ElementTree.SubElement(
        head, "description"
    ).text = f"{model.title}. {AXES_AND_SIGNS} Estimates (one standard error): {bars}."
    for note in notes:
        ElementTree.SubElement(head, "note").text = note
    metrics = ElementTree.SubElement(root, "metrics")
    for tag, unit, size in (("wingarea", "M2", geometry.S), ("wingspan", "M", geometry.b), ("chord", "M", geometry.c)):
        ElementTree.SubElement(metrics, tag, unit=unit).text = repr(size)
    metrics.append(_place("AERORP", (0.0, 0.0, 0.0)))
    root.append(_mass(vehicle, effects))
    ElementTree.SubElement(root, "ground_reactions")
    root.append(_thrust_force(vehicle, effects))
    ElementTree.SubElement(root, "propulsion")
    root.append(_controls(vehicle, effects))
    root.append(_aerodynamics(model, effects))
    return root


def _planet(vehicle: Vehicle) -> _Node:
    """The earth that the model was identified on, for load_planet: flat, at rest, gravity as in the vehicle file."""
    radius, gravity = _FLAT_RADIUS / _FT, vehicle.environment.gravity / _FT
    node = ElementTree.Element("planet", name="flat")
    for tag, unit, value in (
        ("equatorial_radius", "FT", radius), ("polar_radius", "FT", radius), ("rotation_rate", "RAD/SEC", 0.0),
        ("GM", "FT3/SEC2", gravity * radius**2),
    ):  # fmt: skip
        ElementTree.SubElement(node, tag, unit=unit).text = repr(value)
    ElementTree.SubElement(node, "J2").text = "0.0"
    return node


def _of_flightgear(model: Exported, name: str) -> _Node:
    """What FlightGear asks for of an aircraft: who it is, which flight model, which file."""
    node = ElementTree.Element("PropertyList")
    sim = ElementTree.SubElement(node, "sim")
    for tag, content in (("description", model.title), ("flight-model", "jsb"), ("aero", name)):
        ElementTree.SubElement(sim, tag).text = content
    return node


def _mass(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> _Node:
    """With this attribute JSBSim's ixz is the integral of x z over the mass, as ours is."""
    mass = vehicle.mass
    turned = 1.0 + effects.get("inertia_error", {}).get("scale", 0.0)
    heavier = 1.0 + effects.get("mass_error", {}).get("scale", 0.0)
    node = ElementTree.Element("mass_balance", negated_crossproduct_inertia="false")
    inertia = {"ixx": mass.Ixx, "iyy": mass.Iyy, "izz": mass.Izz, "ixy": 0.0, "ixz": mass.Ixz, "iyz": 0.0}
    for tag, value in inertia.items():
        ElementTree.SubElement(node, tag, unit="SLUG*FT2").text = repr(turned * value / (_SLUG * _FT**2))
    ElementTree.SubElement(node, "emptywt", unit="LBS").text = repr(heavier * mass.mass / _SLUG * _POUNDS_IN_SLUG)
    # A centre of gravity that is shifted is elsewhere than where the coefficients' moments are about.
    node.append(_place("CG", (effects.get("cg_shift", {}).get("x", 0.0), 0.0, 0.0)))
    return node


def _place(name: str, xyz: tuple[float, float, float]) -> _Node:
    """A place of body axes, m, in JSBSim's structural ones: x aft, z up."""
    node = ElementTree.Element("location", {"unit": "M"} | ({"name": name} if name else {}))
    for tag, value in zip("xyz", (-xyz[0], xyz[1], -xyz[2]), strict=True):
        ElementTree.SubElement(node, tag).text = repr(value + 0.0)
    return node


def _thrust_force(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> _Node:
    node = ElementTree.Element("external_reactions")
    if vehicle.propulsion is None:
        return node
    line, tilt = vehicle.propulsion.line, vehicle.propulsion.inclination
    # A pitching moment of z_T times the thrust is that of a line so much lower.
    lower = effects.get("thrust_line_offset", {}).get("z_T", 0.0) / math.cos(tilt)
    force = ElementTree.SubElement(node, "force", name="thrust", frame="BODY")
    function = ElementTree.SubElement(force, "function")
    function.append(_sum(_property(_THRUST), _value(0.0)))
    force.append(_place("", (line[0], line[1], line[2] + lower)))
    direction = ElementTree.SubElement(force, "direction")
    for tag, value in zip("xyz", (math.cos(tilt), 0.0, -math.sin(tilt)), strict=True):
        ElementTree.SubElement(direction, tag).text = repr(value + 0.0)
    return node


def _controls(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> _Node:
    """Commands to deflections, with lags where the model has them; throttle to thrust."""
    node = ElementTree.Element("flight_control", name="surfaces and thrust")
    for declared in (_THROTTLE, _MOTOR):
        node.append(_declared(declared))
    channel = ElementTree.SubElement(node, "channel", name="controls")
    lag = effects.get("actuator_lag", {}).get("tau")
    for name in vehicle.named_controls:
        node.insert(0, _declared(_command_of(name)))
    for name, output in _places(vehicle).values():
        if name not in vehicle.controls:
            continue
        low, high = travel_of(vehicle.controls[name])
        scale = ElementTree.SubElement(channel, "aerosurface_scale", name=f"{name} travel")
        ElementTree.SubElement(scale, "input").text = _command_of(name)
        travel = ElementTree.SubElement(scale, "range")
        ElementTree.SubElement(travel, "min").text, ElementTree.SubElement(travel, "max").text = repr(low), repr(high)
        if lag and name not in vehicle.named_controls:
            ElementTree.SubElement(scale, "output").text = f"fcs/{name}-set-rad"
            state = f"fcs/{name}-servo-rad"
            node.insert(0, _declared(state))
            channel.append(_lag(f"{name} servo", f"fcs/{name}-set-rad", state, lag))
            channel.append(_computed(f"{name} position", output, _property(state)))
        else:
            ElementTree.SubElement(scale, "output").text = output
    tau = vehicle.propulsion.tau if vehicle.propulsion else 0.0
    tau = effects.get("motor_lag", {}).get("tau", tau)
    if tau:
        channel.append(_lag("motor", _THROTTLE, _MOTOR, tau))
    else:
        channel.append(_computed("motor", _MOTOR, _property(_THROTTLE)))
    return node


def _places(vehicle: Vehicle) -> dict[str, tuple[str, str]]:
    """Factor of the model -> the control's name, and the property that its deflection is."""
    return {**_SURFACES, **{name: (name, f"fcs/gcs/{name}-pos-rad") for name in vehicle.named_controls}}


def _command_of(name: str) -> str:
    """Property of a control's command, -1 to 1; JSBSim itself has those of three."""
    own = any(name == control for control, _ in _SURFACES.values())
    return f"fcs/{name}-cmd-norm" if own else f"fcs/gcs/{name}-cmd-norm"


def _lag(name: str, source: str, output: str, tau: float) -> _Node:
    """A lag of the first order, exact for an input that is held over a step.

    Its state is a property, which can be set, so that a flight may begin in steady flight; JSBSim's own lag_filter
    begins at 0.
    """
    share = _difference(_value(1.0), _one("exp", _product(_value(-1.0 / tau), _property("simulation/dt"))))
    moved = _product(share, _difference(_property(source), _property(output)))
    return _computed(name, output, _sum(_property(output), moved))


def _declared(name: str) -> _Node:
    """A property that is kept over a reset."""
    node = ElementTree.Element("property", value="0.0", persistent="true")
    node.text = name
    return node


def _computed(name: str, output: str, value: _Node) -> _Node:
    node = ElementTree.Element("fcs_function", name=name)
    function = ElementTree.SubElement(node, "function")
    function.append(_sum(value, _value(0.0)))
    ElementTree.SubElement(node, "output").text = output
    return node


def _thrust(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> _Node:
    """Thrust in pounds: by the propeller's curve where there is one, else in proportion to the throttle."""
    propulsion = vehicle.propulsion
    assert propulsion is not None
    if propulsion.CT:
        assert propulsion.diameter is not None
        size = propulsion.diameter**4 / _POUND_FORCE
        thrust = _product(
            _value(size), _density(), _speed(vehicle), _speed(vehicle), _by_advance(vehicle, propulsion.CT)
        )
    else:
        thrust = _product(_value((propulsion.max_thrust or 0.0) / _POUND_FORCE), _property(_MOTOR))
    loss = effects.get("thrust_speed_loss", {}).get("dT_dV")
    if loss is not None:
        faster = _difference(_property(_AIRSPEED), _value(vehicle.flight.airspeed / _FT))
        thrust = _sum(thrust, _product(_value(loss * _FT / _POUND_FORCE), _property(_MOTOR), faster))
    scale = effects.get("thrust_scale", {}).get("scale")
    return thrust if scale is None else _product(_value(1.0 + scale), thrust)


def _speed(vehicle: Vehicle) -> _Node:
    """The propeller's speed, revolutions a second."""
    assert vehicle.propulsion is not None
    full = rotor_scale(vehicle.propulsion) / (2.0 * math.pi)
    node = ElementTree.Element("max")
    node.extend((_product(_value(full), _property(_MOTOR)), _value(_SLOWEST)))
    return node


def _density() -> _Node:
    return _product(_value(_SLUG / _FT**3), _property("atmosphere/rho-slugs_ft3"))


def _by_advance(vehicle: Vehicle, curve: Curve) -> _Node:
    """A coefficient by the advance ratio V / (n D)."""
    assert vehicle.propulsion is not None
    assert vehicle.propulsion.diameter is not None
    if isinstance(curve, Polynomial):
        low, high = curve.range
        places = np.linspace(low, high, _CURVE_POINTS)
        values = np.polynomial.Polynomial(curve.coefficients)(places)
    else:
        from scipy.interpolate import PchipInterpolator  # as sim_vehicle.vehicle.propulsion has it

        given, at = np.array(curve).T
        places = np.linspace(given[0], given[-1], _CURVE_POINTS)
        values = PchipInterpolator(given, at)(places)
    # Straight on beyond the ends, as the simulator does.
    first, last = (
        (values[1] - values[0]) / (places[1] - places[0]),
        (values[-1] - values[-2]) / (places[-1] - places[-2]),
    )
    far = 10.0 * (places[-1] - places[0])
    places = np.concatenate(([places[0] - far], places, [places[-1] + far]))
    values = np.concatenate(([values[0] - far * first], values, [values[-1] + far * last]))
    node = ElementTree.Element("interpolate1d")
    travelled = _product(_value(_FT / vehicle.propulsion.diameter), _property(_AIRSPEED))
    node.append(_quotient(travelled, _speed(vehicle)))
    for place, value in zip(places, values, strict=True):
        node.extend((_value(float(place)), _value(float(value))))
    return node


def _aerodynamics(model: Exported, effects: dict[str, dict[str, float]]) -> _Node:
    vehicle, geometry = model.vehicle, model.vehicle.geometry
    node = ElementTree.Element("aerodynamics")
    terms = [(parse_term(name), value) for name, value in model.model.flown().items()]
    # Here, where airspeed and density are those of the step; JSBSim's forces from outside come after.
    if vehicle.propulsion is not None:
        node.append(_function(_THRUST, _sum(_thrust(vehicle, effects))))
    stall = effects.get("stall")
    if stall is not None:
        node.append(_function("aero/gcs/separated", _separated(**stall)))
    for axis in AXES:
        total = _sum(*(_term(one, value, vehicle, effects) for one, value in terms if one.axis == axis))
        if stall is not None and axis == "CL":
            node.append(_function("aero/gcs/CL-attached", total))
            total = _blended()
        elif stall is not None and axis == "CD":
            total = _sum(total, _product(_value(2.0), _property("aero/gcs/separated"), _power(_abs(_sine()), 3.0)))
        node.append(_function(f"aero/gcs/{axis}", total))
    lift, drag = _property("aero/gcs/CL"), _property("aero/gcs/CD")
    S, b, c = geometry.S / _FT**2, geometry.b / _FT, geometry.c / _FT
    ahead = _difference(_product(lift, _sine()), _product(drag, _cosine()))
    down = _product(_value(-1.0), _sum(_product(lift, _cosine()), _product(drag, _sine())))
    bodies = {
        "X": (S, ahead), "Y": (S, _property("aero/gcs/CY")), "Z": (S, down), "ROLL": (S * b, _property("aero/gcs/Cl")),
        "PITCH": (S * c, _property("aero/gcs/Cm")), "YAW": (S * b, _property("aero/gcs/Cn")),
    }  # fmt: skip
    others = {"ROLL": _torque(vehicle, math.cos), "YAW": _torque(vehicle, lambda tilt: -math.sin(tilt))}
    for name, (size, body) in bodies.items():
        axis_node = ElementTree.SubElement(node, "axis", name=name)
        axis_node.append(_function(f"aero/gcs/{name}", _product(_property(_QBAR), _value(size), body)))
        if (other := others.get(name)) is not None:
            axis_node.append(_function(f"aero/gcs/{name}-other", other))
    return node


def _term(term: Term, value: float, vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> _Node:
    factors = [_value(value), *(_regressor(one, vehicle) for one in term.factors)]
    reference = vehicle.flight.airspeed
    if term.name == "CD_0" and "reynolds_drag" in effects:
        ratio = _quotient(_property(_AIRSPEED), _value(reference / _FT))
        factors.append(_power(ratio, -effects["reynolds_drag"]["n"]))
    if term.axis == "Cm" and "de" in term.factors:
        if "elastic_tail" in effects:
            usual = 0.5 * SEA_LEVEL_DENSITY * reference**2 * _FT**2 / _POUND_FORCE
            k = effects["elastic_tail"]["k"]
            factors.append(_sum(_value(1.0 + k), _product(_value(-k / usual), _property(_QBAR))))
        if "propwash_elevator" in effects:
            load = _product(_value(vehicle.geometry.S / _FT**2), _property(_QBAR))
            share = _quotient(_property(_THRUST), load)
            factors.append(_sum(_value(1.0), _product(_value(effects["propwash_elevator"]["k"]), share)))
    return _product(*factors)


def _regressor(name: str, vehicle: Vehicle) -> _Node:
    """JSBSim's expression of a regressor (sim_vehicle.model.aerodynamic_terms.REGRESSORS)."""
    if name in (places := _places(vehicle)):
        return _property(places[name][1])
    if name in ("alpha", "beta"):
        return _property(f"aero/{name}-rad")
    if name == "CL":
        return _property("aero/gcs/CL")
    if name == "throttle":
        return _property(_MOTOR)
    length = (vehicle.geometry.c if name in ("q", "alphadot") else vehicle.geometry.b) / _FT
    rate = "aero/alphadot-rad_sec" if name == "alphadot" else f"velocities/{name}-aero-rad_sec"
    return _quotient(_product(_property(rate), _value(0.5 * length)), _property(_AIRSPEED))


def _separated(alpha_stall: float, sharpness: float) -> _Node:
    """Beard & McLain, Small Unmanned Aircraft, eq. (4.10)."""

    def rise(offset: float, sign: float) -> _Node:
        node = ElementTree.Element("exp")
        node.append(_product(_value(sign * sharpness), _sum(_property(_ALPHA), _value(offset))))
        return node

    above, below = rise(-alpha_stall, -1.0), rise(alpha_stall, 1.0)
    return _quotient(
        _sum(_value(1.0), above, below),
        _product(_sum(_value(1.0), above), _sum(_value(1.0), below)),
    )


def _blended() -> _Node:
    """Lift between that of the attached flow and a flat plate's, eq. (4.9)."""
    share = _property("aero/gcs/separated")
    plate = _product(_value(2.0), _sine(), _abs(_sine()), _cosine())
    attached = _product(_difference(_value(1.0), share), _property("aero/gcs/CL-attached"))
    return _sum(attached, _product(share, plate))


def _torque(vehicle: Vehicle, part: Callable[[float], float]) -> _Node | None:
    """The propeller's torque about the body's x and z, foot-pounds; None where the vehicle file gives none."""
    propulsion = vehicle.propulsion
    if propulsion is None or not propulsion.CQ or propulsion.diameter is None:
        return None
    turning = -1.0 if propulsion.rotation == "cw" else 1.0
    size = turning * part(propulsion.inclination) * propulsion.diameter**5 / (_POUND_FORCE * _FT)
    if size == 0.0:
        return None
    return _product(_value(size), _density(), _speed(vehicle), _speed(vehicle), _by_advance(vehicle, propulsion.CQ))


def _function(name: str, body: _Node) -> _Node:
    node = ElementTree.Element("function", name=name)
    node.append(body)
    return node


def _value(x: float) -> _Node:
    node = ElementTree.Element("value")
    node.text = repr(float(x))
    return node


def _property(name: str) -> _Node:
    node = ElementTree.Element("property")
    node.text = name
    return node


def _of(tag: str, parts: Iterable[_Node], neutral: float) -> _Node:
    """An operation of two members at least, as JSBSim wants it."""
    node = ElementTree.Element(tag)
    node.extend(parts)
    while len(node) < 2:
        node.append(_value(neutral))
    return node


def _sum(*parts: _Node) -> _Node:
    return _of("sum", parts, 0.0)


def _product(*parts: _Node) -> _Node:
    return _of("product", parts, 1.0)


def _difference(first: _Node, second: _Node) -> _Node:
    return _of("difference", (first, second), 0.0)


def _quotient(first: _Node, second: _Node) -> _Node:
    return _of("quotient", (first, second), 1.0)


def _power(base: _Node, exponent: float) -> _Node:
    return _of("pow", (base, _value(exponent)), 1.0)


def _one(tag: str, inner: _Node) -> _Node:
    node = ElementTree.Element(tag)
    node.append(inner)
    return node


def _abs(inner: _Node) -> _Node:
    return _one("abs", inner)


def _sine() -> _Node:
    return _one("sin", _property(_ALPHA))


def _cosine() -> _Node:
    return _one("cos", _property(_ALPHA))

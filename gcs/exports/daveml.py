"""The aerodynamic model as DAVE-ML 2.0 (ANSI/AIAA S-119): coefficients with their uncertainties and correlations, the
six sums in MathML, and check cases.

Errors are normal, one standard deviation, additive; each names its correlation with every coefficient before it. Check
cases are points within what was flown, with the outputs that a reader of the file must come to.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gcs.exports.exported import AXES_AND_SIGNS, Exported, described, require_new
from gcs.text.files import write_whole
from gcs.version import VERSION
from sim_vehicle.model.aerodynamic_terms import AXES, Term, parse_term
from sysid.numerics.gaussian import known_from

NAMESPACE, MATHML = "http://daveml.org/2010/DAVEML", "http://www.w3.org/1998/Math/MathML"
_DOCTYPE = (
    '<!DOCTYPE DAVEfunc PUBLIC "-//AIAA//DTD for Flight Dynamic Models - Functions 2.0//EN"\n'
    '  "http://www.daveml.org/DTDs/2p0/DAVEfunc.dtd">\n'
)
# Inputs of the motion: name by the standard's convention, unit, axis system.
_MOTION = {
    "alpha": ("angleOfAttack", "rad", "Body"), "beta": ("angleOfSideslip", "rad", "Body"),
    "p": ("bodyAngularRate_Roll", "rad_s", "Body"), "q": ("bodyAngularRate_Pitch", "rad_s", "Body"),
    "r": ("bodyAngularRate_Yaw", "rad_s", "Body"), "alphadot": ("angleOfAttackRate", "rad_s", "Body"),
}  # fmt: skip
_SPEED = "trueAirspeed"
_SURFACES = {"de": "elevatorDeflection", "da": "aileronDeflection", "dr": "rudderDeflection"}
_LENGTHS = {"p": "b", "r": "b", "q": "c", "alphadot": "c"}
_OUTPUTS = {
    "CL": ("totalCoefficientOfLift", "Stability"), "CD": ("totalCoefficientOfDrag", "Stability"),
    "CY": ("aeroBodyForceCoefficient_Y", "Body"), "Cl": ("aeroBodyMomentCoefficient_Roll", "Body"),
    "Cm": ("aeroBodyMomentCoefficient_Pitch", "Body"), "Cn": ("aeroBodyMomentCoefficient_Yaw", "Body"),
}  # fmt: skip
# Check cases beside the one with every input at 0, and how large their inputs are: angles rad, rates rad/s.
_CASES, _SIZE = 4, 0.1
# Outputs of check cases, which are sums of some ten terms, agree to this.
_TOLERANCE = 1e-9

_Node = ElementTree.Element


def write(model: Exported, path: Path) -> list[str]:
    """Write the file. Returns what the form does not hold, a line each.

    Raises ExportError where the file exists, or the model has an effect: an aerodynamic model of DAVE-ML is sums alone.
    """
    require_new(path)
    model.effects_flown("DAVE-ML", ())
    root = _node(None, "DAVEfunc", xmlns=NAMESPACE)
    _header(root, model)
    terms = [parse_term(name) for name in model.model.flown()]
    inputs = _inputs(root, model, terms)
    _constants(root, model)
    _coefficients(root, model)
    for factor in (one for one in _LENGTHS if one in inputs):
        _rate(root, factor)
    for axis in AXES:
        _output(root, axis, [one for one in terms if one.axis == axis])
    _check_cases(root, model, terms, inputs)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_whole(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{_DOCTYPE}{text}\n')
    notes = ["thrust, motors and servos: an aerodynamic model is forces and moments of the air alone"]
    if known_from(model.model, flown=True)[0] is None:
        notes.append("correlations: the model's file has none")
    return [*model.left_out, *notes]


def _node(parent: _Node | None, tag: str, text: str = "", **attributes: str) -> _Node:
    made = ElementTree.Element(tag, attributes) if parent is None else ElementTree.SubElement(parent, tag, attributes)
    made.text = text or None
    return made


def _header(root: _Node, model: Exported) -> None:
    head = _node(root, "fileHeader", name=model.model.name)
    _node(head, "author", name="gcs export-model", org=f"gcs {VERSION}")
    _node(head, "creationDate", date=datetime.datetime.now(datetime.UTC).date().isoformat())
    _node(head, "description", f"{model.title}. {AXES_AND_SIGNS}")


def _variable(root: _Node, name: str, key: str, unit: str, said: str, **more: str) -> _Node:
    made = _node(root, "variableDef", name=name, varID=key, units=unit, **more)
    _node(made, "description", said)
    return made


def _inputs(root: _Node, model: Exported, terms: Sequence[Term]) -> dict[str, tuple[str, str]]:
    """Write the inputs that the model needs. Returns factor (V for the airspeed) -> its name and unit."""
    used = {factor for term in terms for factor in term.factors}
    found = {}
    if used & set(_LENGTHS):
        found["V"] = (_SPEED, "m_s")
        _node(_variable(root, _SPEED, "V", "m_s", "true airspeed"), "isInput")
    for factor, (name, unit, axes) in _MOTION.items():
        if factor in used:
            found[factor] = (name, unit)
            _node(_variable(root, name, factor, unit, name, axisSystem=axes), "isInput")
    for factor in sorted(used - set(_MOTION) - {"CL"}):
        name, unit = _SURFACES.get(factor, f"{factor}Position"), "nd" if factor == "throttle" else "rad"
        found[factor] = (name, unit)
        said = "throttle, 0 to 1" if factor == "throttle" else "deflection, signs of the vehicle file"
        _node(_variable(root, name, factor, unit, said), "isInput")
    return found


def _constants(root: _Node, model: Exported) -> None:
    size, mass = model.vehicle.geometry, model.vehicle.mass
    for key, name, unit, value in (
        ("S", "referenceWingArea", "m2", size.S), ("b", "referenceWingSpan", "m", size.b),
        ("c", "referenceWingChord", "m", size.c), ("mass", "totalMass", "kg", mass.mass),
        ("Ixx", "bodyMomentOfInertia_Roll", "kgm2", mass.Ixx), ("Iyy", "bodyMomentOfInertia_Pitch", "kgm2", mass.Iyy),
        ("Izz", "bodyMomentOfInertia_Yaw", "kgm2", mass.Izz), ("Ixz", "bodyProductOfInertia_ZX", "kgm2", mass.Ixz),
    ):  # fmt: skip
        _variable(root, name, key, unit, "of the vehicle file", initialValue=repr(value))


def _coefficients(root: _Node, model: Exported) -> None:
    """Every coefficient with its error, and how that hangs together with those of the coefficients before it."""
    known = known_from(model.model, flown=True)[0]
    spread = np.zeros(0) if known is None else np.sqrt(np.diag(known.covariance))
    place = {} if known is None else {name: i for i, name in enumerate(known.names)}
    refused, before = set(model.model.not_identified()), []
    flown = model.model.flown()
    together = [name for name in flown if name in place]
    for name, value in flown.items():
        entry = model.model.coefficients[name]
        said = described(name) or name
        if name in refused:
            said += f"; not identified, the mean of a refused estimate: {entry.refused}"
        made = _variable(root, name, name, "nd", said, initialValue=repr(float(value)))
        if not entry.flown_std:
            continue
        law = _node(_node(made, "uncertainty", effect="additive"), "normalPDF", numSigmas="1")
        _node(law, "bounds", repr(float(entry.flown_std)))
        if known is None or name not in place:
            continue
        before.append(name)
        for later in together[len(before) :]:
            _node(law, "correlatesWith", varID=later)
        for earlier in before[:-1]:
            i, j = place[name], place[earlier]
            share = known.covariance[i, j] / (spread[i] * spread[j])
            _node(law, "correlation", varID=earlier, corrCoef=f"{share:.12g}")


def _rate(root: _Node, factor: str) -> None:
    """A rate without dimension: length / 2V times it."""
    length = _LENGTHS[factor]
    said = f"{factor} {length} / 2V"
    math_ = _calculation(_variable(root, f"{factor}Nondimensional", f"{factor}hat", "nd", said))
    divided = _apply(math_, "divide")
    times = _apply(divided, "times")
    _names(times, factor, length)
    below = _apply(divided, "times")
    _node(below, "cn", "2")
    _names(below, "V")


def _output(root: _Node, axis: str, terms: Sequence[Term]) -> None:
    """The sum of an axis' terms."""
    name, axes = _OUTPUTS[axis]
    made = _variable(root, name, axis, "nd", f"{axis}, total", axisSystem=axes)
    total = _apply(_calculation(made), "plus")
    # A sum has two terms and more.
    _node(total, "cn", "0")
    _node(total, "cn", "0")
    for term in terms:
        product = _apply(total, "times")
        _node(product, "cn", "1")
        _names(product, term.name, *(f"{one}hat" if one in _LENGTHS else one for one in term.factors))
    _node(made, "isOutput")


def _calculation(variable: _Node) -> _Node:
    return _node(_node(variable, "calculation"), "math", xmlns=MATHML)


def _apply(parent: _Node, operator: str) -> _Node:
    made = _node(parent, "apply")
    _node(made, operator)
    return made


def _names(parent: _Node, *names: str) -> None:
    for name in names:
        _node(parent, "ci", name)


def _check_cases(root: _Node, model: Exported, terms: Sequence[Term], inputs: Mapping[str, tuple[str, str]]) -> None:
    """Points with the outputs there: every input at 0, then all of them moved."""
    checks = _node(root, "checkData")
    random = np.random.default_rng(1)
    speed = model.vehicle.flight.airspeed
    for number in range(_CASES + 1):
        size = _SIZE if number else 0.0
        point = {
            factor: float(value) for factor, value in zip(inputs, random.normal(0.0, 1.0, len(inputs)), strict=True)
        }
        point = {factor: speed if factor == "V" else round(size * value, 6) for factor, value in point.items()}
        shot = _node(checks, "staticShot", name=f"point {number}")
        side = _node(shot, "checkInputs")
        for factor, (name, unit) in inputs.items():
            _signal(side, name, unit, point[factor])
        side = _node(shot, "checkOutputs")
        for axis, value in _totals(model, terms, point).items():
            _node(_signal(side, _OUTPUTS[axis][0], "nd", value), "tol", repr(_TOLERANCE))


def _signal(side: _Node, name: str, unit: str, value: float) -> _Node:
    made = _node(side, "signal")
    _node(made, "signalName", name)
    _node(made, "signalUnits", unit)
    _node(made, "signalValue", repr(value))
    return made


def _totals(model: Exported, terms: Sequence[Term], point: Mapping[str, float]) -> dict[str, float]:
    """Axis -> its coefficient at a point."""
    size, flown = model.vehicle.geometry, model.model.flown()
    at = dict(point)
    for factor, length in _LENGTHS.items():
        if factor in at:
            at[factor] *= getattr(size, length) / (2.0 * at["V"])
    for axis in AXES:
        at[axis] = sum(
            flown[term.name] * math.prod(at[factor] for factor in term.factors) for term in terms if term.axis == axis
        )
    return {axis: at[axis] for axis in AXES}

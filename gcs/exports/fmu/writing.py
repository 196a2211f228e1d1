"""The FMU's file: description, sources, and the library of this machine where it has a C compiler.

FMI for Model Exchange and Co-Simulation 2.0.1; an FMU without a library for a machine is compiled there from its
sources (section 2.3), as FMPy does.
"""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

from gcs.errors import ExportError
from gcs.exports.exported import AXES_AND_SIGNS, Exported, require_new
from gcs.exports.fmu.variables import OF_EFFECTS, OUTPUTS, Variable, by_causality, variables
from gcs.text.files import write_whole
from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.model.aerodynamic_terms import AXES, REGRESSORS, Term, parse_term
from sim_vehicle.physics.layout import CURVE_COEFFICIENTS
from sim_vehicle.vehicle.propulsion import Curve, pack_curve

EFFECTS_HELD = frozenset({name.partition(".")[0] for name in OF_EFFECTS} | {"motor_lag"})
_IDENTIFIER = "aircraft"
_UNITS = {
    "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1}, "m": {"m": 1}, "m2": {"m": 2}, "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2}, "kg": {"kg": 1}, "kg.m2": {"kg": 1, "m": 2}, "kg/m3": {"kg": 1, "m": -3},
    "N": {"kg": 1, "m": 1, "s": -2}, "N.s/m": {"kg": 1, "s": -1}, "s": {"s": 1}, "1/s": {"s": -1},
}  # fmt: skip
_LIBRARIES = {"Linux": ("linux64", ".so"), "Darwin": ("darwin64", ".dylib"), "Windows": ("win64", ".dll")}
_COMPILE_S = 120.0


def write(model: Exported, path: Path) -> list[str]:
    """Write the FMU. Returns what it does not hold, a line each.

    Raises ExportError where something is in the way, for an effect that it does not hold, and for a vehicle that
    nothing drives.
    """
    require_new(path)
    effects = model.effects_flown("an FMU", EFFECTS_HELD)
    propulsion = model.vehicle.propulsion
    if propulsion is None or not propulsion.by_throttle:
        raise ExportError(
            f"{model.vehicle.path}: nothing gives thrust by the throttle; give max_thrust, or max_rpm beside CT"
        )
    found = variables(model, effects)
    header = _header(model, found, effects)
    source = files("gcs.exports.fmu").joinpath("aircraft.c").read_text(encoding="utf-8")
    guid = "{" + hashlib.sha256((header + source).encode()).hexdigest()[:32] + "}"
    header = f'#define GUID "{guid}"\n{header}'
    notes = [*model.left_out, "no ground contact"]
    library = _compiled(source, header)
    if library is None:
        notes.append("no library: there is no C compiler here; the tool that flies the FMU compiles its sources")
    space = io.BytesIO()
    with zipfile.ZipFile(space, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(model, found, guid, notes))
        archive.writestr("sources/aircraft.c", source)
        archive.writestr("sources/model.h", header)
        archive.writestr("documentation/index.html", _documentation(model, found, notes))
        if library is not None:
            folder, ending = _LIBRARIES[platform.system()]
            archive.writestr(f"binaries/{folder}/{_IDENTIFIER}{ending}", library)
    write_whole(path, space.getvalue())
    return notes


def _header(model: Exported, found: Sequence[Variable], effects: Mapping[str, Mapping[str, float]]) -> str:
    """model.h: places of the variables, their start values, and the terms' structure."""
    vehicle = model.vehicle
    propulsion = vehicle.propulsion
    assert propulsion is not None
    terms = [parse_term(name) for name in model.model.flown()]
    regressors = (*REGRESSORS, *vehicle.named_controls)
    first = next(place for place, one in enumerate(found) if one.causality == "parameter" and not one.symbol)
    places = "\n".join(f"#define {one.symbol} {place}" for place, one in enumerate(found) if one.symbol)
    x, y, z = propulsion.line
    numbers = {
        "VARIABLES": len(found), "OUTPUT_FIRST": len(found) - len(OUTPUTS), "OUTPUTS": len(OUTPUTS),
        "TERM_FIRST": first, "TERMS": len(terms), "CURVE_PIECE": 1 + CURVE_COEFFICIENTS,
        "HAS_STALL": int("stall" in effects), "HAS_ALPHADOT": int(any("alphadot" in one.factors for one in terms)),
        "HAS_CT": int(bool(propulsion.CT)), "HAS_CQ": int(bool(propulsion.CQ)),
        "STANDARD_GRAVITY": STANDARD_GRAVITY, "GAS_CONSTANT": GAS_CONSTANT, "SEA_LEVEL_DENSITY": SEA_LEVEL_DENSITY,
        "REFERENCE_SPEED": vehicle.flight.airspeed, "INCLINATION": propulsion.inclination,
        "PROPELLER_X": x, "PROPELLER_Y": y, "PROPELLER_Z": z,
        "TURNING": 1.0 if propulsion.rotation == "cw" else -1.0,
        "NAMED": len(vehicle.named_controls), **({} if vehicle.named_controls else {"V_NAMED": 0}),
    }  # fmt: skip
    defined = "\n".join(f"#define {name} ({value!r})" for name, value in numbers.items())
    factors = [[*(regressors.index(name) for name in one.factors), -1, -1, -1, -1][:4] for one in terms]
    arrays = [
        _array("int", "TERM_AXIS", [AXES.index(one.axis) for one in terms]),
        f"static const int TERM_FACTORS[][4] = {{{', '.join('{' + _list(row) + '}' for row in factors)}}};",
        _array("int", "TERM_KIND", [_kind(one) for one in terms]),
        _array("double", "CT", _packed(propulsion.CT)),
        _array("double", "CQ", _packed(propulsion.CQ)),
        _array("double", "START", [0.0 if one.start is None else one.start for one in found]),
    ]
    return "\n".join([places, defined, *arrays, ""])


def _kind(term: Term) -> int:
    """What effects may scale: 1 the elevator's pitching moment, 2 the drag at zero lift."""
    return 1 if term.axis == "Cm" and "de" in term.factors else 2 if term.name == "CD_0" else 0


def _packed(curve: Curve) -> list[float]:
    packed = pack_curve(curve)
    return [float(one) for one in packed[: 2 + (1 + CURVE_COEFFICIENTS) * max(int(packed[0]), 1)]]


def _array(kind: str, name: str, values: Sequence[float]) -> str:
    return f"static const {kind} {name}[] = {{{_list(values)}}};"


def _list(values: Iterable[float]) -> str:
    return ", ".join(repr(one) for one in values)


def _compiled(source: str, header: str) -> bytes | None:
    """The library for this machine, None where there is no compiler or no name for the machine."""
    compiler = next((one for one in ("cc", "gcc", "clang") if shutil.which(one)), None)
    if compiler is None or platform.system() not in _LIBRARIES or platform.machine() not in ("x86_64", "AMD64"):
        return None
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "aircraft.c").write_text(source, encoding="utf-8")
        (place / "model.h").write_text(header, encoding="utf-8")
        options = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]
        try:
            done = subprocess.run(
                [compiler, *options, "aircraft.c", "-o", "library", "-lm"], cwd=place, capture_output=True, text=True,
                timeout=_COMPILE_S, check=False,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired):
            return None
        return (place / "library").read_bytes() if done.returncode == 0 else None


def _description(model: Exported, found: Sequence[Variable], guid: str, notes: Sequence[str]) -> bytes:
    root = ElementTree.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=model.vehicle.name, guid=guid,
        description=". ".join([model.title, AXES_AND_SIGNS, *(f"Left out: {note}" for note in notes)]),
        generationTool="gcs export-model", variableNamingConvention="structured",
    )  # fmt: skip
    cosimulation = ElementTree.SubElement(
        root, "CoSimulation", modelIdentifier=_IDENTIFIER, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true", canSerializeFMUstate="true",
    )  # fmt: skip
    sources = ElementTree.SubElement(cosimulation, "SourceFiles")
    ElementTree.SubElement(sources, "File", name="aircraft.c")
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name, powers in _UNITS.items():
        unit = ElementTree.SubElement(units, "Unit", name=name)
        ElementTree.SubElement(unit, "BaseUnit", {key: str(power) for key, power in powers.items()})
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="20.0", stepSize="0.01")
    listed = ElementTree.SubElement(root, "ModelVariables")
    for place, one in enumerate(found):
        kind = {"input": "continuous", "output": "continuous", "parameter": "fixed"}[one.causality]
        text = _words(one)
        entry = ElementTree.SubElement(
            listed, "ScalarVariable", name=one.name, valueReference=str(place), causality=one.causality,
            variability=kind,
        )  # fmt: skip
        real = ElementTree.SubElement(entry, "Real")
        if text:
            entry.set("description", text)
        if one.unit:
            real.set("unit", one.unit)
        if one.start is not None:
            real.set("start", repr(one.start))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for name in ("Outputs", "InitialUnknowns"):
        part = ElementTree.SubElement(structure, name)
        for place in by_causality(found, "output"):
            ElementTree.SubElement(part, "Unknown", index=str(place + 1))
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _words(one: Variable) -> str:
    return one.words if one.std is None else f"{one.words} (standard error {one.std:.3g})".strip()


def _documentation(model: Exported, found: Sequence[Variable], notes: Sequence[str]) -> str:
    """A page that FMI tools show."""
    from html import escape

    rows = "".join(
        f"<tr><td>{escape(one.name)}<td>{one.causality}<td>{'' if one.start is None else f'{one.start:.6g}'}"
        f"<td>{escape(one.unit)}<td>{escape(_words(one))}"
        for one in found
    )
    lines = "".join(f"<li>Left out: {escape(note)}" for note in notes)
    return (
        f"<!doctype html><meta charset=utf-8><title>{escape(model.vehicle.name)}</title><p>{escape(model.title)}."
        f" {escape(AXES_AND_SIGNS)}<ul>{lines}</ul><table><tr><th>variable<th>causality<th>start<th>unit<th>{rows}"
        "</table>\n"
    )

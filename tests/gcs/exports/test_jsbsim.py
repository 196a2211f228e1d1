"""Exported aircraft flown by JSBSim itself, against the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jsbsim
import numpy as np
import pytest
from export_flights import (
    EFFECTS,
    FLAP,
    HEIGHT,
    NOTHING,
    SECONDS,
    SHARE,
    STEP,
    Array,
    Named,
    commands,
    craft,
    flown_here,
    shares,
)

from gcs.errors import ExportError
from gcs.exports import jsbsim as exporter
from gcs.exports.exported import Exported
from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.state import PlantState
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.controls import Control
from sim_vehicle.vehicle.vehicle_file import Vehicle

pytestmark = pytest.mark.whole_flight

FT = 0.3048
SLUG = 0.45359237 * 9.80665 / FT


def flown_there(
    folder: Path, vehicle: Vehicle, begun: PlantState, trim: Array, late: float = 0.0, named: Named = NOTHING
) -> Array:
    """(N, 10) STATES of the exported aircraft in JSBSim.

    late: of the commands, in steps: a lag answers what is held over a step, as our simulation holds its middle.
    """
    twin = jsbsim.FGFDMExec(str(folder))
    twin.set_debug_level(0)
    twin.set_aircraft_path("aircraft")
    assert twin.load_planet(str(folder / "flat.xml"), False)
    assert twin.load_model(vehicle.name)
    twin.set_dt(STEP)
    for part in ("rate/rotational", "rate/translational", "position/rotational", "position/translational"):
        twin.set_property_value(f"simulation/integrator/{part}", 5)
    twin.set_property_value("simulation/gravity-model", 0)
    assert vehicle.environment.air_density is not None
    twin.set_property_value("atmosphere/override/density", vehicle.environment.air_density / SLUG * FT**3)
    for name, value in zip(("u", "v", "w"), begun.x[3:6], strict=True):
        twin.set_property_value(f"ic/{name}-fps", value / FT)
    q0, q1, q2, q3 = begun.x[6:10]
    twin.set_property_value("ic/theta-rad", float(np.arcsin(2.0 * (q0 * q2 - q3 * q1))))
    twin.set_property_value("ic/phi-rad", float(np.arctan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1**2 + q2**2))))
    twin.set_property_value("ic/h-sl-ft", HEIGHT / FT)
    twin.set_property_value("fcs/motor-norm", trim[3])
    for name, value in zip(("elevator", "aileron", "rudder"), trim, strict=False):
        twin.set_property_value(f"fcs/{name}-servo-rad", float(value))
    inputs = commands(trim, (np.arange(round(SECONDS / STEP) + 1) - late) * STEP)
    give(twin, vehicle, inputs[0])
    assert twin.run_ic()
    rows = []
    for i, row in enumerate(inputs):
        give(twin, vehicle, row)
        for name, at in named.items():
            twin.set_property_value(f"fcs/gcs/{name}-cmd-norm", at((i - late + 0.5) * STEP) / 0.5)
        if rows:
            twin.run()
        rows.append(read(twin))
    return np.array(rows)


def give(twin: jsbsim.FGFDMExec, vehicle: Vehicle, row: Array) -> None:
    for name, value in zip(("elevator", "aileron", "rudder"), row, strict=False):
        travel = vehicle.controls[name].limits
        twin.set_property_value(f"fcs/{name}-cmd-norm", float(value) / (travel[1] if value > 0.0 else -travel[0]))
    twin.set_property_value("fcs/throttle-cmd-norm", float(row[3]))


def read(twin: jsbsim.FGFDMExec) -> list[float]:
    get = twin.get_property_value
    return [
        get("velocities/vt-fps") * FT, get("aero/alpha-rad"), get("aero/beta-rad"), get("attitude/phi-rad"),
        get("attitude/theta-rad"), np.angle(np.exp(1j * get("attitude/psi-rad"))),
        *(get(f"velocities/{name}-rad_sec") for name in "pqr"), get("position/h-sl-ft") * FT,
    ]  # fmt: skip


def flown_both(folder: Path, vehicle: Vehicle, model: Model) -> dict[str, float]:
    here, begun, trim = flown_here(vehicle, model)
    exporter.write(Exported(model, vehicle), folder)
    return shares(here, flown_there(folder, vehicle, begun, trim))


@pytest.mark.parametrize("name", ["iitb-mav", "ultrastick25e", "aerosonde"])
def test_jsbsim_flies_what_the_simulator_flies(name: str, tmp_path: Path) -> None:
    """The second and third have propellers by CT and CQ over the advance ratio, the second a motor that lags."""
    off = flown_both(tmp_path / "out", *craft(name))
    assert max(off.values()) < SHARE, off
    listed = ElementTree.parse(tmp_path / "out" / "aircraft" / name / f"{name}-set.xml").getroot()
    assert (listed.findtext("sim/flight-model"), listed.findtext("sim/aero")) == ("jsb", name)


def test_a_flap_goes_along(tmp_path: Path) -> None:
    """One that goes down alone, set in the middle of the flight."""
    vehicle, model = craft("iitb-mav")
    flap = Control("flap", "command", (6,), (1.0,), ((1000.0, 2000.0),), ((0.0, 0.5),))
    vehicle = replace(vehicle, controls={**vehicle.controls, "flap": flap})
    for name, value in {"CL_flap": 0.8, "CD_flap": 0.06, "Cm_flap": -0.08, "Cl_flap": 0.001}.items():
        model = model.with_coefficient(name, value)
    here, begun, trim = flown_here(vehicle, model, FLAP)
    exporter.write(Exported(model, vehicle), tmp_path / "out")
    assert max(shares(here, flown_there(tmp_path / "out", vehicle, begun, trim, named=FLAP)).values()) < SHARE
    assert max(shares(here, flown_there(tmp_path / "out", vehicle, begun, trim)).values()) > 10.0 * SHARE


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_goes_along(effect: str, tmp_path: Path) -> None:
    vehicle, model = craft("iitb-mav")
    name, values = parse_effect(effect)
    changed = model.with_effect(name, values)
    here, begun, trim = flown_here(vehicle, changed)
    exporter.write(Exported(changed, vehicle), tmp_path / "with")
    off = shares(here, flown_there(tmp_path / "with", vehicle, begun, trim, 0.5 * (name.name == "actuator_lag")))
    assert max(off.values()) < SHARE, off
    exporter.write(Exported(model, vehicle), tmp_path / "without")
    assert max(shares(here, flown_there(tmp_path / "without", vehicle, begun, trim)).values()) > 10.0 * SHARE


def test_what_it_cannot_hold_is_named(tmp_path: Path) -> None:
    vehicle, model = craft("iitb-mav")
    deaf: Mapping[str, float] = {"width": 0.01}
    with pytest.raises(ExportError, match="does not hold the effect servo_deadband"):
        exporter.write(
            Exported(model.with_effect(parse_effect("servo_deadband:width=0.01")[0], deaf), vehicle), tmp_path / "a"
        )
    assert not (tmp_path / "a").exists()
    late, values = parse_effect("vane_lag:tau=0.05")
    notes = exporter.write(Exported(model.with_effect(late, values), vehicle), tmp_path / "b")
    assert any("vane_lag is no part of the aircraft" in note for note in notes)
    with pytest.raises(ExportError, match="exists already"):
        exporter.write(Exported(model, vehicle), tmp_path / "b")
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match=r"file/c: cannot be written: .*; give another place"):
        exporter.write(Exported(model, vehicle), tmp_path / "file" / "c")

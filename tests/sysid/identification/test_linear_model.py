"""The linearised model: against textbook derivatives, the nonlinear simulation, python-control and a Monte Carlo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_vehicle.flight.plant import Plant
from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.linear_model import INPUTS, OUTPUTS, STATES, LinearModel, linearise
from sysid.numerics.gaussian import Gaussian
from sysid.uncertainty.total import ErrorParts

VEHICLE = load_vehicle("iitb-mav")
MODEL = read_model("iitb-mav")
SPEED, DENSITY = 15.0, 1.2


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    return linearise(VEHICLE, MODEL, SPEED, DENSITY)


def entry(linear: LinearModel, rate: str, cause: str) -> float:
    system = linear.system
    if cause in INPUTS:
        return float(system.B[STATES.index(rate), INPUTS.index(cause)])
    return float(system.A[STATES.index(rate), STATES.index(cause)])


def test_moment_derivatives_are_the_textbooks(linear: LinearModel) -> None:
    value = MODEL.values()
    mass, size = VEHICLE.mass, VEHICLE.geometry
    pressure = 0.5 * DENSITY * SPEED**2 * size.S
    determinant = mass.Ixx * mass.Izz - mass.Ixz**2
    assert entry(linear, "q", "alpha") == pytest.approx(pressure * size.c * value["Cm_alpha"] / mass.Iyy, rel=1e-5)
    assert entry(linear, "q", "de") == pytest.approx(pressure * size.c * value["Cm_de"] / mass.Iyy, rel=1e-5)
    for cause, rate_scale in (("beta", 1.0), ("p", size.b / (2.0 * SPEED)), ("r", size.b / (2.0 * SPEED)), ("da", 1.0)):
        roll = pressure * size.b * value.get(f"Cl_{cause}", 0.0) * rate_scale
        yaw = pressure * size.b * value.get(f"Cn_{cause}", 0.0) * rate_scale
        expected_p = (mass.Izz * roll + mass.Ixz * yaw) / determinant
        expected_r = (mass.Ixz * roll + mass.Ixx * yaw) / determinant
        assert entry(linear, "p", cause) == pytest.approx(expected_p, rel=1e-5, abs=1e-6)
        assert entry(linear, "r", cause) == pytest.approx(expected_r, rel=1e-5, abs=1e-6)
    assert entry(linear, "theta", "q") == pytest.approx(1.0, abs=1e-6)
    assert entry(linear, "V", "theta") == pytest.approx(-VEHICLE.environment.gravity, rel=1e-4)


def test_a_small_doublet_of_the_simulation_is_the_linear_response(linear: LinearModel) -> None:
    import control

    vehicle = replace(VEHICLE, environment=replace(VEHICLE.environment, air_density=DENSITY))
    without_lag = replace(MODEL, effects=tuple(e for e in MODEL.effects if not e.name.startswith("actuator")))
    plant = Plant(vehicle, without_lag, max_step=0.001)
    trim = plant.trim(SPEED, 0.0)
    step, count = 0.01, 300
    time = step * np.arange(count)
    for source, size in (("de", 2e-3), ("da", 1e-3), ("dr", 2e-3)):
        doublet = size * (np.where(time < 0.5, 1.0, 0.0) - np.where((time >= 0.5) & (time < 1.0), 1.0, 0.0))
        state = trim.state.copy()
        flown = np.empty((count, 8))
        names = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")
        for k in range(count):
            flown[k] = plant.outputs(state)[:8]
            command = trim.command.copy()
            command[INPUTS.index(source)] += doublet[k]
            plant.step(state, command, step)
        system = linear.system
        exact = control.ss(system.A, system.B[:, [INPUTS.index(source)]], system.C, system.D[:, [INPUTS.index(source)]])
        held = control.c2d(exact, step, "zoh")
        predicted = control.forced_response(held, time, doublet).outputs
        for output in ("alpha", "q", "theta") if source == "de" else ("beta", "p", "r", "phi"):
            change = flown[:, names.index(output)] - flown[0, names.index(output)]
            given = predicted[OUTPUTS.index(output)]
            assert np.abs(given - change).max() < 0.02 * np.abs(change).max(), (source, output)


def test_frequency_responses_and_modes_are_those_of_python_control(linear: LinearModel) -> None:
    import control

    system = linear.system
    theirs = control.ss(system.A, system.B, system.C, system.D, inputs=INPUTS, outputs=OUTPUTS, states=STATES)
    frequencies = np.geomspace(0.05, 10.0, 20)
    response = np.asarray(theirs(2j * math.pi * frequencies))
    for source, output in (("de", "q"), ("da", "p"), ("dr", "ay"), ("throttle", "V")):
        ours, gain_std, phase_std = linear.response(source, output, frequencies)
        np.testing.assert_allclose(ours, response[OUTPUTS.index(output), INPUTS.index(source)], rtol=1e-9)
        assert np.all(np.isfinite(gain_std))
        assert np.all(np.isfinite(phase_std))
    frequency, damping, poles = control.damp(theirs, doprint=False)
    modes = linear.modes()
    assert [mode.name for mode in modes] == ["short period", "phugoid", "roll", "Dutch roll", "spiral"]
    for mode in modes:
        i = int(np.argmin(np.abs(poles - mode.eigenvalue)))
        assert poles[i] == pytest.approx(mode.eigenvalue, rel=1e-9)
        if mode.frequency_hz is not None and mode.damping is not None:
            assert 2.0 * math.pi * mode.frequency_hz[0] == pytest.approx(frequency[i], rel=1e-9)
            assert mode.damping[0] == pytest.approx(damping[i], rel=1e-9)


def test_standard_errors_of_modes_are_the_scatter_of_drawn_models() -> None:
    names = ("CL_alpha", "Cm_alpha", "Cm_q", "Cl_p", "Cn_beta", "Cn_r")
    value = MODEL.with_coefficient("Cm_q", -2.0).values()
    std = {name: 0.03 * max(abs(value[name]), 0.05) for name in names}
    model = MODEL
    for name in names:
        model = model.with_coefficient(name, value[name], std[name])
    correlation = np.eye(6)
    correlation[0, 1] = correlation[1, 0] = 0.8
    spread = np.outer(list(std.values()), list(std.values())) * correlation
    known = Gaussian(names, np.array([value[name] for name in names]), spread)
    expected = linearise(VEHICLE, model, SPEED, DENSITY, ErrorParts(known, {})).modes()
    draws = np.random.default_rng(4).multivariate_normal([value[name] for name in names], spread, 300)
    drawn = []
    for row in draws:
        changed = model
        for name, number in zip(names, row, strict=True):
            changed = changed.with_coefficient(name, float(number))
        drawn.append(linearise(VEHICLE, changed, SPEED, DENSITY).modes())
    for i, mode in enumerate(expected):
        for key in ("frequency_hz", "damping", "time_constant_s"):
            pair = getattr(mode, key)
            if pair is None or mode.name == "spiral":  # a spiral near neutral is not linear in anything
                continue
            scatter = np.std([getattr(modes[i], key)[0] for modes in drawn])
            assert pair[1] == pytest.approx(scatter, rel=0.2), (mode.name, key)


def test_what_was_refused_widens_and_what_is_unknown_is_not_given() -> None:
    refused = {
        name: e if name != "Cm_alpha" else Coefficient(None, refused="x") for name, e in MODEL.coefficients.items()
    }
    wide = linearise(VEHICLE, replace(MODEL, coefficients=refused), SPEED, DENSITY).modes()
    sure = {mode.name: mode for mode in linearise(VEHICLE, MODEL, SPEED, DENSITY).modes()}
    assert wide[0].time_constant_s[1] > 0.05 * abs(wide[0].time_constant_s[0])
    assert sure["short period"].time_constant_s[1] == 0.0
    lateral = {
        name: Coefficient(None, refused="no rudder moved") if name[:2] in ("CY", "Cl", "Cn") else e
        for name, e in MODEL.coefficients.items()
    }
    names = [mode.name for mode in linearise(VEHICLE, replace(MODEL, coefficients=lateral), SPEED, DENSITY).modes()]
    assert names == ["short period", "phugoid"]


def test_without_a_thrust_model_the_surfaces_responses_are_the_same(linear: LinearModel) -> None:
    bare = linearise(replace(VEHICLE, propulsion=None), MODEL, SPEED, DENSITY)
    assert bare.system.inputs == ("de", "da", "dr")
    ours, theirs = ({mode.name: mode.eigenvalue for mode in each.modes()} for each in (linear, bare))
    for name in ("short period", "roll", "Dutch roll"):
        assert theirs[name] == pytest.approx(ours[name], rel=2e-3)
    entries = bare.responses_json()
    assert [(entry["input"], entry["output"]) for entry in entries][:2] == [("de", "q"), ("de", "az")]


def test_a_response_that_is_not_there_is_none(linear: LinearModel) -> None:
    base, gain_std, _ = linear.response("de", "beta", np.array([0.5, 1.0]))
    assert np.isnan(base).all()
    assert np.isnan(gain_std).all() or not linear.names


def test_motions_that_coincide_have_no_modes_and_take_none_from_the_others() -> None:
    refused = {
        name: Coefficient(None, refused="no aileron moved") if name.startswith(("Cl_", "Cn_")) else e
        for name, e in MODEL.coefficients.items()
    }
    linear = linearise(VEHICLE, replace(MODEL, coefficients=refused), SPEED, DENSITY)
    sure = {mode.name: mode for mode in linearise(VEHICLE, MODEL, SPEED, DENSITY).modes()}
    modes = linear.modes()
    assert [mode.name for mode in modes][:2] == ["short period", "phugoid"]
    assert modes[0].eigenvalue == pytest.approx(sure["short period"].eigenvalue, rel=1e-3)
    (line,) = linear.left_out()
    assert "lateral modes coincide" in line
    assert not linearise(VEHICLE, MODEL, SPEED, DENSITY).left_out()

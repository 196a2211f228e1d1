"""What stands beside an estimate against dense matrices: several records, samples missing, one acting on one record."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import signals_of

from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.errors import EstimationError
from sysid.output_error.from_problem import fit
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.problem.estimation_problem import free_coefficients
from sysid.problem.formulation import make_problem
from sysid.signals.preparation import prepare


@pytest.fixture(scope="module")
def here() -> OutputErrorLinearisation:
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    pulse = replace(manoeuvre("elevator-pulse"), duration=4.0)
    generator = np.random.default_rng(5)
    suite = SensorSuite(vehicle, generator=generator)
    flown = fly(Plant(vehicle, model, max_step=0.0021), Plan((pulse, pulse)), suite=suite, generator=generator)
    prepared = [prepare(signals_of(flown, vehicle, "pulses"), vehicle)]
    compatible = check_compatibility(prepared)
    problem = make_problem(prepared, vehicle, compatible, ("accel_bias_z", "gyro_bias_q"), run_s=3.0)
    assert len(problem.records) > 1
    problem.records[0].z[5:20] = np.nan
    names = free_coefficients(list(model.coefficients), problem.motion)
    return OutputErrorLinearisation(problem, model, names, (), fit(problem, model, names))


def dense(here: OutputErrorLinearisation, series: list[np.ndarray]) -> np.ndarray:
    """Rows over the noise, records one below the other: (records, N, outputs, ...) of `series`, 0 where missing."""
    columns, sigma = here.estimation.columns, here.result.sigma
    parts = []
    for values, nu in zip(series, here.residuals, strict=True):
        good = np.isfinite(nu[:, columns])
        part = np.zeros((*good.shape, *values.shape[2:]))
        part[good] = values[:, columns][good]
        weight = (1.0 / sigma[columns]).reshape(1, -1, *[1] * (part.ndim - 2))
        parts.append((part * weight).reshape(-1, *part.shape[2:]))
    return np.concatenate(parts)


def scattered(here: OutputErrorLinearisation) -> list[np.ndarray]:
    """Sensitivities of every record by all unknowns."""
    found = []
    for k, s in enumerate(here.S):
        wide = np.zeros((*s.shape[:2], here.estimation.predictor.size))
        wide[:, :, here.estimation.places(k)] = s
        found.append(wide)
    return found


def test_others_stand_beside_the_unknowns(here):
    generator = np.random.default_rng(0)
    shapes = [y.shape for y in here.predicted]
    everywhere = {k: generator.standard_normal(shape) for k, shape in enumerate(shapes)}
    once = {1: generator.standard_normal(shapes[1])}
    joint, gradient = here.bordered_information(here.others([everywhere, once]))
    further = [
        np.stack([one.get(k, np.zeros(shape)) for one in (everywhere, once)], axis=2) for k, shape in enumerate(shapes)
    ]
    rows = np.concatenate([dense(here, scattered(here)), dense(here, further)], axis=1)
    n, p = here.estimation.predictor.size, len(here.result.parameters)
    expected = rows.T @ rows
    expected[:p, :p] += here.estimation.prior_information
    expected[n:, n:] += np.eye(2)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(joint / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-10)
    downhill = rows.T @ dense(here, here.residuals)
    downhill[:p] -= here.estimation.prior_information @ (here.result.theta[:p] - here.estimation.prior_mean)
    np.testing.assert_allclose(gradient / scale, downhill / scale, atol=1e-8)


def test_shifts_pull_at_the_unknowns(here):
    generator = np.random.default_rng(1)
    shifts = [[generator.standard_normal(y.shape) for y in here.predicted] for _ in range(3)]
    shifts[0][0][7] = np.nan
    here.problem.records[0].z[7] = np.nan
    fresh = replace(here)
    expected = [
        dense(fresh, scattered(fresh)).T @ dense(fresh, [np.nan_to_num(part) for part in one]) for one in shifts
    ]
    found = fresh.gradient_changes(shifts)
    assert found == pytest.approx(np.stack(expected, axis=1), rel=1e-9, abs=1e-6 * np.abs(expected).max())


def test_a_simulation_that_diverges_next_to_the_estimate_is_refused(here):
    added = {k: np.zeros_like(y) for k, y in enumerate(here.predicted)}
    added[1][40:] = np.inf
    with pytest.raises(EstimationError):
        here.others([added])


def test_what_the_last_step_knew_is_what_stands_at_the_estimate(here):
    again = OutputErrorLinearisation.fitted(here.problem, here.model, here.coefficients, here.effects)
    np.testing.assert_array_equal(again.result.theta, here.result.theta)
    scale = 1.0 / np.sqrt(np.diag(here.normal[0]))
    assert (
        np.abs((again.normal[0] - here.normal[0]) * np.outer(scale, scale)).max() < 5e-3
    )  # a step that gained next to nothing apart
    assert np.abs((again.normal[1] - here.normal[1]) * scale).max() < 1e-2
    for one, other in zip(again.predicted, here.predicted, strict=True):
        np.testing.assert_array_equal(one, other)
    # A copy of another problem knows nothing of the first one's.
    later = replace(again, problem=replace(here.problem, command_first=not here.problem.command_first))
    assert np.abs(later.predicted[0] - again.predicted[0]).max() > 1e-6

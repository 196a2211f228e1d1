"""Our equations of motion against JSBSim's, flown from the same trim under the same inputs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsbsim_twin import STATES, Array, fly_twin, write_twin

from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.flight.state import PlantState
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

SECONDS = 20.0
STEP = 0.001
# Largest difference allowed over the whole flight: this share of a state's range, or so many m, m/s, rad, rad/s. The
# two agree to a tenth of that; the rest is room for other machines.
SHARE = 1e-4
FLOOR = {name: 1e-2 if name in ("north", "east", "down") else 1e-4 for name in STATES}


def aircraft(Ixz: float, density: float | None, line: tuple[float, float, float]) -> tuple[Vehicle, Model]:
    """The packaged vehicle with a product of inertia, an offset thrust line, pitch damping and cross terms."""
    vehicle = load_vehicle("iitb-mav")
    assert vehicle.propulsion is not None
    vehicle = replace(
        vehicle,
        mass=replace(vehicle.mass, Ixz=Ixz),
        propulsion=replace(vehicle.propulsion, tau=0.0, line=line, inclination=0.03),
        environment=replace(vehicle.environment, air_density=density),
    )
    model = read_model("iitb-mav")
    for name, value in {"Cm_q": -5.0, "CL_q": 3.0, "CL_alpha2": -1.0, "Cm_alpha_de": 0.3, "CY_r": 0.1}.items():
        model = model.with_coefficient(name, value)
    return vehicle, model


def multisine(times: Array, size: float, harmonics: list[int], phase: float) -> Array:
    """Sum of sines at harmonics of 1/20 s, starting from zero in the first second."""
    angles = 2.0 * np.pi * np.outer(times / SECONDS, harmonics) + phase * np.arange(len(harmonics)) ** 2
    ramp = np.clip(times, 0.0, 1.0)
    return size * ramp * np.sin(angles).sum(axis=1) / np.sqrt(len(harmonics))


def commands(trim: Array, times: Array) -> Array:
    """(N, 4) de, da, dr, throttle: orthogonal multisines on all four."""
    return trim + np.column_stack(
        [
            multisine(times, 0.03, [4, 9, 17, 26, 38], 0.7),
            multisine(times, 0.02, [6, 11, 20, 31], 1.1),
            multisine(times, 0.03, [5, 13, 22], 0.4),
            multisine(times, 0.08, [2, 7], 1.9),
        ]
    )


def place(plant: Plant, state: PlantState) -> Array:
    """(12,) in the order of STATES."""
    outputs = dict(zip(OUTPUTS, plant.outputs(state), strict=True))
    velocity = dict(zip("uvw", state.x[3:6], strict=True))
    return np.array([velocity[name] if name in velocity else outputs[name] for name in STATES])


def fly_both(folder: Path, ours: tuple[Vehicle, Model], theirs: tuple[Vehicle, Model]) -> tuple[Array, Array]:
    """States (N, 12) of one aircraft in our simulation and one in JSBSim's, from our trim."""
    vehicle, model = ours
    plant = Plant(vehicle, model)
    trim = plant.trim(15.0, 300.0)
    count = round(SECONDS / STEP)
    # JSBSim's integrator takes inputs as lines between samples, ours as held: the middle of a step is what it holds.
    held = commands(trim.command, (np.arange(count) + 0.5) * STEP)
    sampled = commands(trim.command, np.arange(count + 1) * STEP)
    state = trim.state.copy()
    flown = np.empty((count + 1, len(STATES)))
    flown[0] = place(plant, state)
    for i in range(count):
        plant.step(state, held[i], STEP)
        flown[i + 1] = place(plant, state)
    write_twin(folder, *theirs)
    assert vehicle.propulsion is not None
    assert vehicle.propulsion.max_thrust is not None
    thrust = vehicle.propulsion.max_thrust * sampled[:, 3]
    surfaces = np.ascontiguousarray(sampled[:, :3])
    return flown, fly_twin(folder, flown[0], surfaces, thrust, STEP, vehicle.environment.air_density)


def differences(ours: Array, theirs: Array) -> dict[str, tuple[float, float]]:
    """Per state its largest difference, the shorter way round for angles, and its range."""
    result = {}
    for i, name in enumerate(STATES):
        apart, flown = ours[:, i] - theirs[:, i], theirs[:, i]
        if name in ("phi", "theta", "psi"):
            apart, flown = (apart + np.pi) % (2.0 * np.pi) - np.pi, np.unwrap(flown)
        result[name] = float(np.abs(apart).max()), float(np.ptp(flown))
    return result


@pytest.mark.whole_flight
@pytest.mark.parametrize(
    ("Ixz", "density", "line"),
    [(0.0, 1.1, (0.1, 0.0, 0.0)), (0.004, None, (0.1, 0.0, 0.01)), (-0.006, 1.225, (0.1, 0.02, -0.01))],
)
def test_twenty_seconds_of_multisine_agree_with_jsbsim(
    tmp_path: Path, Ixz: float, density: float | None, line: tuple[float, float, float]
) -> None:
    both = aircraft(Ixz, density, line)
    found = differences(*fly_both(tmp_path, both, both))
    for name, (apart, spread) in found.items():
        assert apart <= max(SHARE * spread, FLOOR[name]), f"{name}: {apart:.3g} apart over a range of {spread:.3g}"
    # The flight must have been worth comparing.
    assert found["q"][1] > 0.5
    assert found["phi"][1] > 0.3


def test_the_comparison_sees_the_sign_of_the_product_of_inertia(tmp_path: Path) -> None:
    line = (0.1, 0.0, 0.0)
    found = differences(*fly_both(tmp_path, aircraft(0.004, 1.2, line), aircraft(-0.004, 1.2, line)))
    assert found["p"][0] > 10.0 * SHARE * found["p"][1]

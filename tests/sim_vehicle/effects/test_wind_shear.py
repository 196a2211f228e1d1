"""Wind shear in the equations of motion, against flights over ground through the moving air of
`sim_vehicle.flight.wind`.
"""

from __future__ import annotations

import hand_flight as hf
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.flight.flight_loop import wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.wind import WindField
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.physics.simulation import simulate
from sim_vehicle.vehicle.packed_model import flatten

Array = NDArray[np.float64]

GRADIENT, DT, TICKS = 0.1, 0.002, 1500
SHEAR = {"wind_shear": {"gradient": GRADIENT}}
# 17 m above the height at which the air is still; a dive of 1.7 m/s and more, in a turn.
ABOVE = 17.0


def commands() -> Array:
    wanted = np.tile(hf.SURFACES, (TICKS, 1))
    wanted[250:700, 0] += 0.04
    wanted[400:600, 1] -= 0.03
    return wanted


def flown_over_ground(effects: dict[str, dict[str, float]], air: WindField) -> tuple[Array, Array]:
    """Readings (N, 19) and heights (N,) of a flight whose u v w are over ground, in air that does not know of it."""
    plant = Plant(hf.vehicle(), hf.model_with(effects), max_step=DT)
    x = hf.body_state()
    x[2] = -(plant.vehicle.flight.altitude + ABOVE)
    state = hf.state_of(plant, x)
    x[3:6] += rotation(x[6:10]) @ air.at(-x[2])
    state.x[:] = x
    plant.evaluate(state, air.at(-x[2]), hf.STILL, 0.0)
    read = np.empty((TICKS, len(CHANNELS)))
    for k, command in enumerate(commands()):
        read[k] = state.reading
        height, sink = float(-state.x[2]), float(read[k, CHANNELS.index("vd")])
        plant.step(state, command, DT, air.at(height - 0.5 * DT * sink))
        plant.evaluate(state, air.at(float(-state.x[2])), hf.STILL, DT)
    return read, read[:, CHANNELS.index("altitude")] - plant.vehicle.flight.altitude


def rotation(quaternion: Array) -> Array:
    """Earth to body, (3, 3), by Rodrigues' formula."""
    scalar, vector = quaternion[0], quaternion[1:]
    cross = np.cross(np.eye(3), vector)
    return np.asarray((scalar**2 - vector @ vector) * np.eye(3) + 2.0 * np.outer(vector, vector) - 2.0 * scalar * cross)


@pytest.fixture(scope="module")
def over_ground() -> tuple[Array, Array]:
    plant = Plant(hf.vehicle(), hf.model_with(SHEAR))
    return flown_over_ground(SHEAR, wind_of(plant))


@pytest.mark.parametrize("recorded", [False, True])
def test_the_motion_against_the_air_is_that_of_a_flight_over_ground(
    over_ground: tuple[Array, Array], recorded: bool
) -> None:
    """With the height integrated, and with it recorded."""
    truth, heights = over_ground
    flat = flatten(hf.vehicle(), hf.model_with(SHEAR))
    x0 = hf.body_state()
    x0[2] = -ABOVE
    controls = commands()
    inputs = np.column_stack((controls, heights)) if recorded else controls
    found = np.empty((TICKS, len(CHANNELS)))
    air = np.full(TICKS, np.nan), np.full(TICKS, hf.RHO), np.zeros((0, 9)), np.zeros((0, 3)), DT, 1, False
    simulate(x0, 0, 0, TICKS, DrivingInputs(inputs, *air), flat.arrays, found)
    calm = np.empty((TICKS, len(CHANNELS)))
    still = flatten(hf.vehicle(), hf.model_with({}))
    simulate(x0, 0, 0, TICKS, DrivingInputs(controls, *air), still.arrays, calm)
    assert np.ptp(heights) > 5.0
    for j, name in enumerate(CHANNELS):
        if name == "altitude":
            continue
        changed = np.abs(calm[:, j] - truth[:, j]).max()
        assert np.abs(found[:, j] - truth[:, j]).max() < 2e-5 * changed, name
    for name in ("airspeed", "vn"):
        j = CHANNELS.index(name)
        assert np.abs(calm[:, j] - truth[:, j]).max() > 0.3


def test_a_plant_flies_the_wind_it_is_given_and_no_shear_besides() -> None:
    air = WindField(gradient=GRADIENT, reference_altitude=hf.vehicle().flight.altitude)
    with_effect, _ = flown_over_ground(SHEAR, air)
    without, _ = flown_over_ground({}, air)
    np.testing.assert_array_equal(with_effect, without)

"""Flights of exported aircraft in our own simulation, and how far another program's are from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.flight.state import PlantState
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

Array = NDArray[np.float64]
SECONDS, STEP, HEIGHT = 20.0, 0.001, 300.0
STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "altitude")
# Largest difference over the whole flight, as a share of the state's range.
SHARE = 1e-3
# What may go along with a model: effects of the aircraft, its servos and its motor.
EFFECTS = (
    "stall:alpha_stall=0.16,sharpness=40", "reynolds_drag:n=0.6", "thrust_line_offset:z_T=0.03",
    "thrust_scale:scale=0.1", "thrust_speed_loss:dT_dV=-0.3", "mass_error:scale=0.08", "inertia_error:scale=0.1",
    "cg_shift:x=0.01", "elastic_tail:k=0.2", "propwash_elevator:k=0.3", "actuator_lag:tau=0.05", "motor_lag:tau=0.3",
)  # fmt: skip


# Controls of their own names: what each does at a time, s.
Named = Mapping[str, Callable[[float], float]]
NOTHING: Named = {}
FLAP: Named = {"flap": lambda time_s: 0.15 if 8.0 <= time_s < 13.0 else 0.0}


def craft(name: str) -> tuple[Vehicle, Model]:
    """A packaged vehicle in air of one density, with its model and cross terms."""
    vehicle = load_vehicle(name)
    vehicle = replace(vehicle, environment=replace(vehicle.environment, air_density=1.18))
    model = read_model(name)
    for key, value in {"CL_alpha2": -0.6, "Cm_alpha_de": 0.3}.items():
        model = model.with_coefficient(key, value)
    return vehicle, model


def multisine(times: Array, size: float, harmonics: tuple[int, ...], phase: float) -> Array:
    angles = 2.0 * np.pi * np.outer(times / SECONDS, harmonics) + phase * np.arange(len(harmonics)) ** 2
    return size * np.clip(times, 0.0, 1.0) * np.sin(angles).sum(axis=1) / np.sqrt(len(harmonics))


def commands(trim: Array, times: Array) -> Array:
    """(N, 4) de, da, dr, throttle."""
    sizes = (
        (0.03, (4, 9, 17, 26, 38), 0.7),
        (0.02, (6, 11, 20, 31), 1.1),
        (0.03, (5, 13, 22), 0.4),
        (0.08, (2, 7), 1.9),
    )
    return trim + np.column_stack([multisine(times, *one) for one in sizes])


def flown_here(vehicle: Vehicle, model: Model, named: Named = NOTHING) -> tuple[Array, PlantState, Array]:
    """(N, 10) STATES in our simulation, the state it began with, and the trimmed commands."""
    plant = Plant(vehicle, model)
    trim = plant.trim(vehicle.flight.airspeed, HEIGHT)
    state, begun = trim.state.copy(), trim.state.copy()
    held = commands(trim.command, (np.arange(round(SECONDS / STEP)) + 0.5) * STEP)
    rows = [plant.outputs(state)]
    for i, command in enumerate(held):
        own = [named[name]((i + 0.5) * STEP) if name in named else 0.0 for name in vehicle.named_controls]
        plant.step(state, np.append(command, own), STEP)
        rows.append(plant.outputs(state))
    places = [OUTPUTS.index(name if name != "altitude" else "down") for name in STATES]
    flown = np.array(rows)[:, places]
    flown[:, -1] *= -1.0
    return flown, begun, trim.command


def shares(here: Array, there: Array) -> dict[str, float]:
    """Largest difference of each state as a share of its range."""
    off = np.abs(here - there).max(axis=0) / np.ptp(here, axis=0)
    return dict(zip(STATES, off.tolist(), strict=True))

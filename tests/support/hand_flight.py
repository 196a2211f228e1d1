"""One aircraft in one general state of flight, its accelerations worked out by hand, for tests of the equations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.plant import CHANNELS, OUTPUTS, Plant, PlantState
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

Array = NDArray[np.float64]

MASS, IXX, IYY, IZZ, IXZ = 1.0, 0.02, 0.03, 0.045, 0.004
S, B, C, RHO, GRAVITY = 0.2, 1.0, 0.2, 1.1, 9.80665
REFERENCE_SPEED, MAX_THRUST, DIAMETER, MAX_RPM = 15.0, 8.0, 0.229, 9000.0
V, ALPHA, BETA = 16.0, 0.12, 0.06
P, Q, R = 0.3, 0.4, -0.2
PHI, THETA, PSI = 0.2, 0.1, 0.7
DE, DA, DR, THROTTLE = 0.05, -0.04, 0.03, 0.5
SURFACES = np.array([DE, DA, DR, THROTTLE])
STILL = np.zeros(3)


def vehicle(rotation: str = "cw", tau: float = 0.0) -> Vehicle:
    """The paper's aircraft with all sensors at the centre of gravity, a product of inertia, and air of 1.1 kg/m3."""
    packaged = load_vehicle("iitb-mav")
    assert packaged.propulsion is not None
    at_cg = {
        name: replace(packaged.sensors[name], position=(0.0, 0.0, 0.0))
        for name in ("accelerometer", "alpha_vane", "beta_vane")
    }
    return replace(
        packaged,
        mass=replace(packaged.mass, Ixz=IXZ),
        sensors=replace(packaged.sensors, **at_cg),
        propulsion=replace(packaged.propulsion, line=(0.1, 0.0, 0.0), rotation=rotation, tau=tau),
        environment=replace(packaged.environment, air_density=RHO),
    )


def model_with(effects: Mapping[str, Mapping[str, float]]) -> Model:
    """The packaged model with these effects."""
    model = read_model("iitb-mav")
    for name, values in effects.items():
        model = model.with_effect(EFFECTS[name], values)
    return model


def body_state() -> Array:
    """The general state as the simulator's vector, (14,)."""
    x = np.zeros(14)
    x[2] = -100.0
    x[3] = V * math.cos(ALPHA) * math.cos(BETA)
    x[4] = V * math.sin(BETA)
    x[5] = V * math.sin(ALPHA) * math.cos(BETA)
    x[6:10] = quaternion(PHI, THETA, PSI)
    x[10:13] = P, Q, R
    x[13] = ALPHA
    return x


def plant_with(effects: Mapping[str, Mapping[str, float]], rotation: str = "cw") -> Plant:
    return Plant(vehicle(rotation), model_with(effects))


def state_of(plant: Plant, x: Array | None = None, command: Array = SURFACES) -> PlantState:
    """The general state (or `x`), actuators at rest at `command`."""
    return plant.state_at(body_state() if x is None else x, command, command)


def outputs(plant: Plant, state: PlantState) -> dict[str, float]:
    return dict(zip(OUTPUTS, plant.outputs(state).tolist(), strict=True))


def readings(plant: Plant, state: PlantState) -> dict[str, float]:
    return dict(zip(CHANNELS, plant.read(state).tolist(), strict=True))


@dataclass
class Hand:
    """Coefficients, propeller force and moments of the packaged aircraft in the general state, by hand.

    An effect changes them; `accelerations` then follows from Newton and Euler.
    """

    coefficients: dict[str, float] = field(default_factory=lambda: read_model("iitb-mav").values())
    thrust: float = MAX_THRUST * THROTTLE
    mass: float = MASS
    inertia: float = 1.0
    rho: float = RHO
    extra_CL: float = 0.0
    extra_CD: float = 0.0
    extra_z: float = 0.0
    moments: Array = field(default_factory=lambda: np.zeros(3))
    elevator_moment: float = 1.0
    attached: float = 1.0

    @property
    def qbar(self) -> float:
        return 0.5 * self.rho * V**2

    def lift(self) -> float:
        k = self.coefficients
        return self.attached * (k["CL_0"] + k["CL_alpha"] * ALPHA + k["CL_de"] * DE) + self.extra_CL

    def accelerations(self) -> dict[str, float]:
        """Specific force, m/s2, and angular acceleration, rad/s2."""
        k = self.coefficients
        CL = self.lift()
        CD = k["CD_0"] + k["CD_k"] * CL**2 + self.extra_CD
        CY = k["CY_beta"] * BETA + k["CY_dr"] * DR
        ph, rh = P * B / (2 * V), R * B / (2 * V)
        Cl = k["Cl_beta"] * BETA + k["Cl_p"] * ph + k["Cl_r"] * rh + k["Cl_da"] * DA
        Cm = k["Cm_0"] + k["Cm_alpha"] * ALPHA + self.elevator_moment * k["Cm_de"] * DE
        Cn = k["Cn_beta"] * BETA + k["Cn_p"] * ph + k["Cn_r"] * rh + k["Cn_da"] * DA + k["Cn_dr"] * DR
        force = self.qbar * S * np.array(
            [-CD * math.cos(ALPHA) + CL * math.sin(ALPHA), CY, -CD * math.sin(ALPHA) - CL * math.cos(ALPHA)]
        ) + np.array([self.thrust, 0.0, self.extra_z])  # fmt: skip
        moment = self.qbar * S * np.array([B * Cl, C * Cm, B * Cn]) + self.moments
        tensor = self.inertia * np.array([[IXX, 0.0, -IXZ], [0.0, IYY, 0.0], [-IXZ, 0.0, IZZ]])
        rates = np.array([P, Q, R])
        turning = np.linalg.solve(tensor, moment - np.cross(rates, tensor @ rates))
        return dict(zip(("ax", "ay", "az"), force / self.mass, strict=True)) | dict(
            zip(("p_dot", "q_dot", "r_dot"), turning, strict=True)
        )

"""Two published aircraft: their numbers typed from the sources and evaluated by the sources' formulae, the trims and
linear models that the sources print, every manoeuvre, and what an identification finds.

Aerosonde: mavsim_python/parameters/aerosonde_parameters.py (byu-magicc/mavsim_public); trim and linear model at 25 m/s
as the authors' programs write them (mavsim chapter 5). Ultra Stick 25e: ParamDef_UltraStick25e.m and
ValidatedDynamics.txt (UASLab/OpenFlight).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated import fly_mav

from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.manoeuvres.shapes import CONTROLS, MANOEUVRES, SURFACES
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.physics.layout import Aux
from sim_vehicle.physics.propeller import along
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify

Array = NDArray[np.float64]
NAMES = ("aerosonde", "ultrastick25e")
STILL = np.zeros(3)
U, V, W, P, Q, R = 3, 4, 5, 10, 11, 12  # places in the state


@pytest.fixture(scope="module", params=NAMES)
def plant(request: pytest.FixtureRequest) -> Plant:
    return Plant(load_vehicle(request.param), read_model(request.param))


@pytest.fixture(scope="module")
def aerosonde() -> Plant:
    return Plant(load_vehicle("aerosonde"), read_model("aerosonde"))


@pytest.fixture(scope="module")
def ultrastick() -> Plant:
    return Plant(load_vehicle("ultrastick25e"), read_model("ultrastick25e"))


def trimmed(plant: Plant) -> dict[str, float]:
    return dict(zip(OUTPUTS, plant.outputs(plant.trim().state).tolist(), strict=True))


def slopes(plant: Plant, rows: tuple[int, ...], places: tuple[int, ...], surface: int | None = None) -> Array:
    """Central differences of the rates `rows` in trim, by state or by one surface: (rows, places)."""
    state, columns = plant.trim().state, []
    for place in (surface,) if surface is not None else places:
        ends = []
        for sign in (-1.0, 1.0):
            moved = state.copy()
            (moved.x if surface is None else moved.surfaces)[place] += sign * 1e-5
            ends.append(plant.rates(moved, STILL, STILL)[list(rows)])
        columns.append((ends[1] - ends[0]) / 2e-5)
    return np.array(columns).T


def flown_coefficients(plant: Plant, motion: tuple[float, ...], surfaces: tuple[float, ...]) -> dict[str, float]:
    """CL to Cn and alpha' of the simulator for u v w p q r and de da dr."""
    state = plant.trim().state.copy()
    state.x[[U, V, W, P, Q, R]] = motion
    state.surfaces[:3] = surfaces
    plant.rates(state, STILL, STILL)
    return {name: float(state.work[Aux[name]]) for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn", "alpha_dot")}


def cases(seed: int, speed: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    random, found = np.random.default_rng(seed), []
    for _ in range(12):
        alpha, beta = random.uniform(-0.1, 0.2), random.uniform(-0.1, 0.1)
        velocity = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        motion = (*(speed * random.uniform(0.8, 1.2) * velocity), *random.uniform(-0.5, 0.5, 3))
        found.append((motion, (-random.uniform(0.02, 0.2), *random.uniform(-0.2, 0.2, 2))))
    return found


def test_loads_without_a_doubt_and_trims_inside_its_travel(plant: Plant) -> None:
    assert plant.vehicle.warnings == ()
    trim = trimmed(plant)
    assert trim["V"] == pytest.approx(plant.vehicle.flight.airspeed)
    assert 0.0 < trim["alpha"] < 0.1
    assert -0.15 < trim["de"] < 0.0
    assert 0.5 < trim["throttle"] < 0.9


def test_aerosonde_coefficients_are_those_of_the_source(aerosonde: Plant) -> None:
    S, b, c, e = 0.55, 2.8956, 0.18994, 0.9
    for motion, (de, da, dr) in cases(1, 25.0):
        u, v, w, p, q, r = motion
        Va = np.sqrt(u * u + v * v + w * w)
        alpha, beta = np.arctan(w / u), np.arcsin(v / Va)
        expected = {  # Beard & McLain, eq. (4.6) to (4.12); rates multiplied by b / 2 Va and c / 2 Va there
            "CL": 0.23 + 5.61 * alpha + 7.95 * c / (2 * Va) * q + 0.13 * de,
            "CD": 0.043 + (0.23 + 5.61 * alpha) ** 2 / (np.pi * e * b**2 / S) + 0.0135 * de,
            "CY": -0.98 * beta + 0.075 * da + 0.19 * dr,
            "Cl": -0.13 * beta - 0.51 * b / (2 * Va) * p + 0.25 * b / (2 * Va) * r + 0.17 * da + 0.0024 * dr,
            "Cm": 0.0135 - 2.74 * alpha - 38.21 * c / (2 * Va) * q - 0.99 * de,
            "Cn": 0.073 * beta + 0.069 * b / (2 * Va) * p - 0.095 * b / (2 * Va) * r - 0.011 * da - 0.069 * dr,
        }
        found = flown_coefficients(aerosonde, motion, (de, da, dr))
        # 2e-5: the stall's sigmoid at alpha 0.2 rad, and six digits of the polar.
        assert {name: found[name] for name in expected} == pytest.approx(expected, abs=2e-5)


def test_ultrastick_forces_and_moments_are_those_of_the_source(ultrastick: Plant) -> None:
    S, b, c = 0.3097, 1.27, 0.25
    for motion, (de, da, dr) in cases(2, 17.0):
        u, v, w, p, q, r = motion
        speed = np.sqrt(u * u + v * v + w * w)
        alpha, beta = np.arctan2(w, u), np.arcsin(v / speed)
        ph, qh, rh = p * b / (2 * speed), q * c / (2 * speed), r * b / (2 * speed)
        right, left = da, -da  # the two ailerons of the source, each with half of the coefficient
        found = flown_coefficients(ultrastick, motion, (de, da, dr))
        lift = 0.1086 + 4.58 * alpha + 6.1639 * qh + 1.9724 * found["alpha_dot"] * c / (2 * speed)
        lift += 0.0983 * de + 0.5 * 0.4751 * (right + left)
        drag = 0.0434 + (lift - 0.23) ** 2 / (np.pi * 0.75 * b**2 / S) + 0.0135 * abs(de)
        side = -0.4889 * beta - 0.0375 * ph + 0.1500 * rh + 0.1913 * dr
        expected = {
            "CL": lift,
            "CD": drag,
            "Cl": -0.0545 * beta - 0.4496 * ph + 0.1086 * rh - 0.5 * 0.1646 * (right - left) + 0.0115 * dr,
            "Cm": -0.0278 - 0.7230 * alpha - 13.5664 * qh - 0.8488 * de + 0.5 * 0.0467 * (right + left),
            "Cn": 0.0723 * beta + 0.1180 * ph - 0.1833 * rh + 0.5 * 0.0574 * (right - left) - 0.1811 * dr,
        }
        assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-5, abs=2e-6)
        # Side force is given in wind axes: along body y drag has a part, here as at the trim's drag of 0.046.
        body_y = side * np.cos(beta) - 0.046 * np.sin(beta)
        assert found["CY"] == pytest.approx(body_y, abs=0.0012)


@pytest.mark.parametrize(
    ("name", "CT", "CQ"),
    [
        ("aerosonde", (-0.1079, -0.06044, 0.09357), (-0.01664, 0.004970, 0.005230)),
        (
            "ultrastick25e",
            (-0.4314, 1.08, -0.896, 0.1089, 0.0604),
            tuple(np.array([0.5054, -0.5304, 0.0412, 0.01664, 0.0223]) / (2.0 * np.pi)),
        ),
    ],
)
def test_thrust_and_torque_are_those_of_the_published_curves(
    name: str, CT: tuple[float, ...], CQ: tuple[float, ...]
) -> None:
    plant = Plant(load_vehicle(name), read_model(name))
    propulsion = plant.vehicle.propulsion
    assert propulsion is not None
    assert propulsion.diameter is not None
    assert propulsion.max_rpm is not None
    D, rho = propulsion.diameter, 1.1
    for share, J in ((0.4, 0.05), (0.7, 0.31), (1.0, 0.58)):
        n = share * propulsion.max_rpm / 60.0
        thrust, torque = along(np.array([share]), np.array([J * n * D]), np.array([rho]), plant.flat.P)
        assert thrust[0] == pytest.approx(rho * n**2 * D**4 * np.polyval(CT, J), rel=1e-7)
        assert torque[0] == pytest.approx(rho * n**2 * D**5 * np.polyval(CQ, J), rel=1e-5)  # nine digits of CP / 2 pi


def test_aerosonde_full_throttle_thrust_is_that_of_the_published_motor() -> None:
    # Voltage balance of a motor that turns this propeller (the supplement's section 4.3), solved by bisection.
    D, rho, speed, K, resistance, idle, volts = 0.508, 1.2682, 25.0, 60.0 / (2.0 * np.pi * 145.0), 0.042, 1.5, 44.4
    low, high = 100.0, 1000.0
    for _ in range(60):
        omega = 0.5 * (low + high)
        n = omega / (2.0 * np.pi)
        torque = rho * n**2 * D**5 * np.polyval((-0.01664, 0.004970, 0.005230), speed / (n * D))
        low, high = (omega, high) if K * ((volts - K * omega) / resistance - idle) > torque else (low, omega)
    thrust = rho * n**2 * D**4 * np.polyval((-0.1079, -0.06044, 0.09357), speed / (n * D))
    propulsion = load_vehicle("aerosonde").propulsion
    assert propulsion is not None
    assert (propulsion.max_thrust, propulsion.max_rpm) == (
        pytest.approx(thrust, rel=1e-3),
        pytest.approx(60.0 * n, rel=1e-3),
    )


def test_aerosonde_trim_and_linear_model_are_the_published_ones(aerosonde: Plant) -> None:
    trim = trimmed(aerosonde)
    # Printed for a set without parasite drag, whose smaller thrust carries less of the weight: 0.4 % of CL.
    assert trim["alpha"] == pytest.approx(0.050011, abs=5e-4)
    assert trim["de"] == pytest.approx(-0.124778, abs=1e-3)
    # a_phi1, a_phi2: roll acceleration by p and da. a_theta1, a_theta2, a_theta3: pitch acceleration by q, alpha, de.
    roll, pitch = slopes(aerosonde, (P,), (P,))[0, 0], slopes(aerosonde, (Q,), (Q,))[0, 0]
    assert (-roll, -pitch) == (pytest.approx(22.628851, rel=1e-6), pytest.approx(5.294738, rel=1e-6))
    assert slopes(aerosonde, (P,), (), 1)[0, 0] == pytest.approx(130.883678, rel=1e-6)
    assert slopes(aerosonde, (Q,), (), 0)[0, 0] == pytest.approx(-36.112390, rel=1e-6)
    by_u, by_w = slopes(aerosonde, (Q,), (U, W))[0]
    assert -25.0 * np.sin(trim["alpha"]) * by_u + 25.0 * np.cos(trim["alpha"]) * by_w == pytest.approx(
        -99.947422, rel=1e-6
    )
    published = [[-4.463936, 24.371050], [-3.992979, -5.294738]]  # A_lon, rows and columns of w and q
    np.testing.assert_allclose(slopes(aerosonde, (W, Q), (W, Q)), published, rtol=0.01)


def test_aerosonde_polar_has_the_published_tangent(aerosonde: Plant) -> None:
    values = aerosonde.model.values()
    alpha = 0.05  # rad, at the trim
    tangent = values["CD_alpha"] + 2.0 * values["CD_alpha2"] * alpha
    level = values["CD_0"] + values["CD_alpha"] * alpha + values["CD_alpha2"] * alpha**2
    # C_D_alpha = 0.132 and C_D_0 = 0.0424 of the same file.
    assert (tangent, level - tangent * alpha) == (pytest.approx(0.132, abs=1.5e-3), pytest.approx(0.0424, abs=5e-5))


def poles(matrix: Array) -> list[complex]:
    return sorted(np.linalg.eigvals(matrix).tolist(), key=abs)


def lateral_matrix(plant: Plant) -> Array:
    """A of v, p, r, phi in level trim."""
    theta = trimmed(plant)["theta"]
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = slopes(plant, (V, P, R), (V, P, R))
    matrix[0, 3] = plant.vehicle.environment.gravity * np.cos(theta)
    matrix[3, 1:3] = 1.0, np.tan(theta)
    return matrix


def test_ultrastick_modes_are_near_the_published_ones(ultrastick: Plant) -> None:
    short = poles(slopes(ultrastick, (W, Q), (W, Q)))[0]
    assert abs(short) == pytest.approx(15.4, rel=0.05)
    assert -short.real / abs(short) == pytest.approx(0.761, abs=0.03)
    _, dutch, _, roll = poles(lateral_matrix(ultrastick))
    assert abs(dutch) == pytest.approx(5.60, rel=0.02)
    assert -dutch.real / abs(dutch) == pytest.approx(0.329, abs=0.01)
    assert roll.real == pytest.approx(-16.1, rel=0.01)


def as_simulated_in_minnesota(model: Model) -> Model:
    """Their simulation leaves CL_alphadot out and lets the forces act 4.5 mm behind the centre of gravity."""
    values = model.values()
    arm = 0.0045 / 0.25
    for name in ("0", "alpha", "q", "de"):
        model = model.with_coefficient(f"Cm_{name}", values[f"Cm_{name}"] - arm * values[f"CL_{name}"])
    for name, force in (("beta", -0.4889 - 0.046), ("p", -0.0375), ("r", 0.15), ("dr", 0.1913)):
        model = model.with_coefficient(f"Cn_{name}", values[f"Cn_{name}"] - 0.0045 / 1.27 * force)
    return model.with_coefficient("CL_alphadot", 0.0)


def test_ultrastick_flown_as_in_its_source_has_the_published_trim_and_linear_model(ultrastick: Plant) -> None:
    plant = Plant(ultrastick.vehicle, as_simulated_in_minnesota(ultrastick.model))
    trim = trimmed(plant)
    assert trim["alpha"] == pytest.approx(0.0551, abs=3e-4)
    assert trim["de"] == pytest.approx(-0.0972, abs=5e-4)
    assert trim["thrust"] == pytest.approx(2.513, rel=0.02)  # of the published propeller at the published 827 rad/s
    published = [[-7.56, 15.72], [-7.405, -15.81]]
    np.testing.assert_allclose(slopes(plant, (W, Q), (W, Q)), published, rtol=0.004)
    np.testing.assert_allclose(slopes(plant, (U, W, Q), (), 0)[:, 0], [0.4698, -2.703, -133.7], rtol=0.005)
    published = [[-0.8726, 0.8968, -16.82], [-2.757, -16.09, 3.368], [1.708, 0.514, -2.775]]
    np.testing.assert_allclose(slopes(plant, (V, P, R), (V, P, R)), published, rtol=0.005)
    np.testing.assert_allclose(slopes(plant, (V, P, R), (), 2)[:, 0], [5.302, -4.972, -82.04], rtol=0.003)
    np.testing.assert_allclose(slopes(plant, (P, R), (), 1)[:, 0], [-2.0 * 78.23, 2.0 * 5.752], rtol=0.001)


CONTRACT = (
    *(f"{surface}-{shape}" for surface in SURFACES for shape in ("pulse", "doublet", "3211", "multisine", "sweep")),
    "multisine", "throttle-step", "throttle-multisine", "deceleration", "roller-coaster", "cruise",
)  # fmt: skip


@pytest.mark.whole_flight
@pytest.mark.parametrize("manoeuvre", CONTRACT)
def test_flies_every_manoeuvre(plant: Plant, manoeuvre: str) -> None:
    vehicle = plant.vehicle
    suite = SensorSuite(vehicle, generator=np.random.default_rng(5))
    plan = plan_of([manoeuvre])
    flown = fly(plant, plan, suite=suite, generator=np.random.default_rng(5), duration=4.5)
    truth = flown.truth
    assert np.isfinite(np.array(list(truth.values()))).all()
    assert np.abs(truth["V"] / vehicle.flight.airspeed - 1.0).max() < 0.3
    assert np.abs(truth["phi"]).max() < 0.8
    assert np.abs(truth["alpha"]).max() < 0.25
    assert np.abs(-truth["down"] - vehicle.flight.altitude).max() < 15.0
    excited = MANOEUVRES[manoeuvre]
    for axis in excited.axes:
        column = flown.command[:, CONTROLS.index(axis)]
        assert np.ptp(column) > 0.6 * excited.amplitude
    if manoeuvre == "deceleration":
        assert truth["V"][-1] < truth["V"][0] - 0.5


def test_the_aerosonde_is_identified_from_one_flight() -> None:
    vehicle, model = load_vehicle("aerosonde"), read_model("aerosonde")
    signals, _ = fly_mav("multisine", 3, vehicle=vehicle, model=model, duration=10.0)
    # The polar of the source is no CD_k CL^2: drag is left to the structure, the rest is judged.
    found: dict[str, Any] = dict(identify([signals], vehicle, systematic=False).model.coefficients)
    true = model.values()
    main = (
        "CL_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cn_beta", "Cn_p",
        "Cn_r", "Cn_dr",
    )  # fmt: skip
    for name in main:
        entry = found[name]
        assert entry.value is not None, f"{name}: {entry.refused}"
        assert entry.std < 0.05 * abs(true[name]), f"{name}: standard error {entry.std:.3g}"
        error = abs(entry.value - true[name])
        assert error < max(3.0 * entry.std, 0.02 * abs(true[name])), f"{name}: {entry.value:.4g} for {true[name]:.4g}"

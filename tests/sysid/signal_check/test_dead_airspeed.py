"""An airspeed that repeats one value: a linear model's, flown by scipy; a dead pitot's, with and without GPS beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from scipy.signal import cont2discrete, dlsim
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SignalError
from sysid.identification.identify import Identification, identify
from sysid.signal_check.dead_airspeed import BY_GPS, with_airspeed
from sysid.signals.flight import FlightSignals, Signal

G, STEP_S = 9.80665, 0.02
LATERAL = ("CY_beta", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr")


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("iitb-mav")


def linear_lateral_flight(vehicle: Vehicle, speed: float) -> FlightSignals:
    """beta, p, r, phi of the linear equations about level flight at one speed (Klein & Morelli 2016, table 3.3)."""
    c, mass, geometry = read_model("iitb-mav").values(), vehicle.mass, vehicle.geometry
    qS, half = 0.5 * 1.225 * speed**2 * geometry.S, geometry.b / (2.0 * speed)
    moments = np.linalg.inv([[mass.Ixx, -mass.Ixz], [-mass.Ixz, mass.Izz]]) * qS * geometry.b

    def force(name: str) -> float:
        return c.get(f"CY_{name}", 0.0) * qS / mass.mass

    def turn(name: str) -> np.ndarray:
        return np.asarray(moments @ [c.get(f"Cl_{name}", 0.0), c.get(f"Cn_{name}", 0.0)])

    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[0] = force("beta") / speed, force("p") * half / speed, force("r") * half / speed - 1.0, G / speed
    A[1:3, 0], A[1:3, 1], A[1:3, 2], A[3, 1] = turn("beta"), turn("p") * half, turn("r") * half, 1.0
    for j, surface in enumerate(("da", "dr")):
        B[0, j], B[1:3, j] = force(surface) / speed, turn(surface)
    time_s = np.arange(0.0, 16.0, STEP_S)
    steps = [
        np.sign(np.sin(2.0 * np.pi * f * time_s)) * (np.abs(time_s - t) < 3.0) for f, t in ((0.4, 4.0), (0.3, 11.0))
    ]
    u = 0.015 * np.column_stack(steps)
    system = cont2discrete((A, B, np.eye(4), np.zeros((4, 2))), STEP_S)
    _, x, _ = dlsim(system, u)
    ay = force("beta") * x[:, 0] + (force("p") * x[:, 1] + force("r") * x[:, 2]) * half
    ay += force("da") * u[:, 0] + force("dr") * u[:, 1]
    noise = np.random.default_rng(2)
    still = np.zeros(time_s.size)
    clean = {
        "beta": (x[:, 0], 0.0005), "p": (x[:, 1], 0.001), "r": (x[:, 2], 0.001), "phi": (x[:, 3], 0.0005),
        "ay": (ay, 0.01), "ax": (still, 0.03), "az": (still - G, 0.03), "q": (still, 0.003), "alpha": (still, 0.002),
        "theta": (still, 0.002), "psi": (np.cumsum(x[:, 2]) * STEP_S, 0.002),
        "airspeed": (still + speed, 0.0), "da": (u[:, 0], 0.0), "dr": (u[:, 1], 0.0), "de": (still, 0.0),
        "air_density": (still + 1.225, 0.0), "thrust": (still + 2.0, 0.0),
    }  # fmt: skip
    signals = {
        name: Signal(time_s, values + std * noise.standard_normal(time_s.size), "SI", "scipy")
        for name, (values, std) in clean.items()
    }
    return FlightSignals("linear", signals)


def misses(found: Identification) -> dict[str, float]:
    """Coefficient -> standard errors that it is off."""
    truth = read_model("iitb-mav").values()
    return {
        name: (one.value - truth[name]) / own_bar(one)
        for name, one in found.model.coefficients.items()
        if one.value is not None and one.std and name in truth
    }


@pytest.mark.parametrize("method", ["auto", "map", "ee"])
def test_a_linear_model_s_one_speed_is_taken_as_it_is(vehicle: Vehicle, method: str) -> None:
    flight = linear_lateral_flight(vehicle, 16.0)
    found = identify([flight], vehicle, method=method, systematic=False)
    off = misses(found)
    assert set(LATERAL) <= off.keys()
    assert max(abs(off[name]) for name in LATERAL) < 4.0, off
    assert any("it hardly changed" in line for line in found.flights[0].warnings)


def with_pitot_at(flight: FlightSignals, value: float, *without: str) -> FlightSignals:
    kept = {name: one for name, one in flight.signals.items() if name not in without}
    read = kept["airspeed"]
    kept["airspeed"] = replace(read, values=np.full_like(read.values, value))
    return replace(flight, signals=kept)


@pytest.mark.parametrize("value", [0.0, 40.0])
def test_gps_stands_for_a_dead_pitot_and_widens_the_bars(vehicle: Vehicle, value: float) -> None:
    flight = fly_mav("multisine", 11, duration=20.0)[0]
    bars = []
    for signals in (flight, with_pitot_at(flight, value)):
        found = identify([signals], vehicle, method="map", systematic=False)
        off = misses(found)
        assert {"CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da"} <= off.keys()
        assert max(abs(z) for z in off.values()) < 3.5, off
        bars.append(found.model.coefficients["CL_alpha"].std or 0.0)
    assert bars[1] > 2.0 * bars[0]
    assert any(BY_GPS in line for line in found.flights[0].warnings)


def test_the_wind_is_known_where_the_flight_turned(vehicle: Vehicle) -> None:
    """A circle at 20 m/s in a wind of 5 m/s, by hand: GPS alone gives the airspeed back."""
    time_s = np.arange(0.0, 60.0, 0.04)
    psi, speed, wind = 0.2 * time_s, 20.0, (3.0, -4.0)
    still = np.zeros(time_s.size)
    series = {
        "psi": psi, "phi": still + np.arctan(0.2 * speed / G), "theta": still, "ax": still, "ay": still,
        "az": still - G / np.cos(np.arctan(0.2 * speed / G)), "vn": speed * np.cos(psi) + wind[0],
        "ve": speed * np.sin(psi) + wind[1], "air_density": still + 1.225, "airspeed": still,
    }  # fmt: skip
    flight = FlightSignals("circle", {name: Signal(time_s, one, "SI", "hand") for name, one in series.items()})
    found = with_airspeed(flight, vehicle)
    assert found.scale_std < 0.03
    assert np.allclose(found.signals.signals["airspeed"].values, speed, rtol=0.02)


def test_where_nothing_says_how_fast_it_flew_it_is_refused(vehicle: Vehicle) -> None:
    flight = with_pitot_at(fly_mav("multisine", 12, duration=10.0)[0], 0.0, "vn", "ve", "vd")
    with pytest.raises(SignalError, match=r"repeats one value, 0 m/s: its sensor is dead .* GPS velocity"):
        identify([flight], vehicle)


def test_methods_without_doubts_of_their_inputs_leave_it_to_the_one_that_has_them(vehicle: Vehicle) -> None:
    flight = with_pitot_at(fly_mav("multisine", 12, duration=10.0)[0], 0.0)
    with pytest.raises(SignalError, match="--method map does without it"):
        identify([flight], vehicle, method="oe")

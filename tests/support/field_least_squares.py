"""Plain least squares with one delay: what an afternoon's script makes of a flight, to compare estimators with."""

from __future__ import annotations

import numpy as np
from jsbsim_twin import Array
from scipy.signal import savgol_filter

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.problem.model_structure import default_structure
from sysid.signals.flight import FlightSignals

STEP, WINDOW = 0.02, 9  # s, samples of the smoothing polynomial
DELAYS = np.arange(0.0, 0.101, 0.01)  # s


def least_squares(flight: FlightSignals, vehicle: Vehicle) -> dict[str, tuple[float, float]]:
    """Value and standard error of the default structure's coefficients, by the best of the delays of the commands."""
    signals = flight.signals
    t = np.arange(0.0, signals["p"].time_s[-1], STEP)

    def at(key: str, late: float = 0.0) -> Array:
        return np.interp(t - late, signals[key].time_s, signals[key].values)

    x = {key: savgol_filter(at(key), WINDOW, 2) for key in signals if key not in ("de", "da", "dr")}
    dot = {key: savgol_filter(at(key), WINDOW, 2, deriv=1, delta=STEP) for key in "pqr"}
    m, g, at_imu = vehicle.mass, vehicle.geometry, np.array(vehicle.sensors.accelerometer.position)
    V = x["airspeed"] * np.sqrt(1.225 / x["air_density"])
    p, q, r = x["p"], x["q"], x["r"]
    rates, turn = np.stack([p, q, r], axis=1), np.stack([dot[k] for k in "pqr"], axis=1)
    force = np.stack([x["ax"], x["ay"], x["az"]], axis=1)
    force = force - np.cross(turn, at_imu) - np.cross(rates, np.cross(rates, at_imu))
    vane, flank = vehicle.sensors.alpha_vane.position, vehicle.sensors.beta_vane.position
    alpha = x["alpha"] + vane[0] * q / V - vane[1] * p / V
    beta = x["beta"] - flank[0] * r / V + flank[2] * p / V
    qS = 0.5 * x["air_density"] * V**2 * g.S
    X, Z = m.mass * force[:, 0] - x["thrust"], m.mass * force[:, 2]
    line = vehicle.propulsion.line if vehicle.propulsion else (0.0, 0.0, 0.0)
    sides = {
        "CL": (X * np.sin(alpha) - Z * np.cos(alpha)) / qS,
        "CD": -(X * np.cos(alpha) + Z * np.sin(alpha)) / qS,
        "CY": m.mass * force[:, 1] / qS,
        "Cl": (m.Ixx * dot["p"] - m.Ixz * (dot["r"] + p * q) + (m.Izz - m.Iyy) * q * r) / (qS * g.b),
        "Cm": (m.Iyy * dot["q"] + (m.Ixx - m.Izz) * p * r + m.Ixz * (p**2 - r**2) - line[2] * x["thrust"]) / (qS * g.c),
        "Cn": (m.Izz * dot["r"] - m.Ixz * (dot["p"] - q * r) + (m.Iyy - m.Ixx) * p * q) / (qS * g.b),
    }
    regressors = {"alpha": alpha, "beta": beta, "p": p * g.b / (2 * V), "q": q * g.c / (2 * V), "r": r * g.b / (2 * V)}
    regressors["CL"] = sides["CL"]
    best: tuple[float, dict[str, tuple[float, float]]] = (np.inf, {})
    for late in DELAYS:
        cost, found = 0.0, {}
        for axis, side in sides.items():
            every = {**regressors, **{key: at(key, late) for key in ("de", "da", "dr")}}
            names = [name for name in default_structure(("de", "da", "dr")) if parse_term(name).axis == axis]
            A = np.stack(
                [np.prod([every[f] for f in parse_term(n).factors] or [np.ones(t.size)], axis=0) for n in names], axis=1
            )
            values, *_ = np.linalg.lstsq(A, side, rcond=None)
            variance = float(np.mean((side - A @ values) ** 2))
            stds = np.sqrt(np.maximum(np.diag(variance * np.linalg.pinv(A.T @ A)), 0.0))
            cost += np.log(variance + 1e-12) if axis in ("Cl", "Cm", "Cn") else 0.0
            found |= {n: (float(v), float(s)) for n, v, s in zip(names, values, stds, strict=True)}
        if cost < best[0]:
            best = cost, found
    return best[1]

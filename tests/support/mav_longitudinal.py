"""The paper's MAV in the vertical plane, simulated here on its own: truth for the estimators' tests.

Mass 1.0 kg, S 0.2 m2, c 0.2 m, Iyy 0.03 kg m2, 15 m/s, thrust constant and known; coefficients and sensor errors
are Tables II to IV of Jolly, Unhelkar, Arya, "A Comprehensive Sensor Suite for Mini Aerial Vehicle Flight Tests".
Nothing of the code under test is used: plain numpy, RK4 at a tenth of the sample interval.
"""

import numpy as np
from scipy.optimize import fsolve

from sysid.signals.flight import FlightData

MASS, S, C, IYY, RHO, G = 1.0, 0.2, 0.2, 0.03, 1.225, 9.80665
TWO_DEGREES = np.deg2rad(2.0)
COEFFICIENTS = {
    "CL_0": 0.1784, "CL_alpha": 2.453, "CL_de": 0.7405, "CD_0": 0.0871, "CD_k": 0.4,
    "Cm_0": 0.0385, "Cm_alpha": -0.5998, "Cm_de": 1.5894,
}  # fmt: skip
ERRORS = {
    "accel_bias_x": 0.1962, "accel_bias_y": 0.1962, "accel_bias_z": 0.1962,
    "gyro_bias_p": np.deg2rad(0.25), "gyro_bias_q": np.deg2rad(0.25), "gyro_bias_r": np.deg2rad(0.25),
    "alpha_scale": 0.005, "beta_scale": 0.005,
}  # fmt: skip
NOISE = {
    "airspeed": 0.02, "alpha": np.deg2rad(0.3), "beta": np.deg2rad(0.3),
    "p": np.deg2rad(0.03), "q": np.deg2rad(0.03), "r": np.deg2rad(0.03),
    "ax": 0.008 * G, "ay": 0.008 * G, "az": 0.008 * G,
    "phi": np.deg2rad(0.05), "theta": np.deg2rad(0.05), "psi": np.deg2rad(0.05),
}  # fmt: skip


def forces(x, de, thrust):
    """(ax, az, q') of state u w q theta."""
    u, w = x[0], x[1]
    speed2 = u * u + w * w
    alpha = np.arctan2(w, u)
    k = COEFFICIENTS
    cl = k["CL_0"] + k["CL_alpha"] * alpha + k["CL_de"] * de
    cd = k["CD_0"] + k["CD_k"] * cl**2
    cm = k["Cm_0"] + k["Cm_alpha"] * alpha + k["Cm_de"] * de
    qs = 0.5 * RHO * speed2 * S
    ax = (thrust + qs * (-cd * np.cos(alpha) + cl * np.sin(alpha))) / MASS
    az = qs * (-cd * np.sin(alpha) - cl * np.cos(alpha)) / MASS
    return ax, az, qs * C * cm / IYY


def air_relative(x, wind):
    """State with the velocity against the air instead of the ground's; wind: (north, down) m/s, heading north."""
    ct, st = np.cos(x[3]), np.sin(x[3])
    return np.array([x[0] - (ct * wind[0] - st * wind[1]), x[1] - (st * wind[0] + ct * wind[1]), x[2], x[3]])


def rates(x, de, thrust, wind=(0.0, 0.0)):
    ax, az, qdot = forces(air_relative(x, wind), de, thrust)
    u, w, q, theta = x
    return np.array([ax - q * w - G * np.sin(theta), az + q * u + G * np.cos(theta), qdot, q])


def trim(speed=15.0):
    """State, elevator and thrust of level flight."""

    def residual(free):
        alpha, de, thrust = free
        x = np.array([speed * np.cos(alpha), speed * np.sin(alpha), 0.0, alpha])
        return rates(x, de, thrust)[:3]

    alpha, de, thrust = fsolve(residual, [0.07, 0.0, 3.7], xtol=1e-13)
    return np.array([speed * np.cos(alpha), speed * np.sin(alpha), 0.0, alpha]), float(de), float(thrust)


def gust(count, sigma, rng, interval=0.02, length=20.0, speed=15.0):
    """(N, 2) first-order gusts north and down, m/s."""
    decay = np.exp(-interval * speed / length)
    series = np.zeros((count, 2))
    series[0] = sigma * rng.standard_normal(2)
    for k in range(1, count):
        series[k] = decay * series[k - 1] + sigma * np.sqrt(1.0 - decay**2) * rng.standard_normal(2)
    return series


def fly(elevator, interval=0.02, substeps=10, wind=None):
    """True signals of a flight: `elevator` (N,) is the deflection from trim held over each interval, rad.

    wind: (N, 2) north and down at the samples, m/s, linear in between; None is calm air.
    """
    wind = np.zeros((elevator.size, 2)) if wind is None else wind
    x, de_trim, thrust = trim()
    n, dt = elevator.size, interval / substeps
    states, air, ax, az, qdot = np.empty((n, 4)), np.empty((n, 4)), np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        de = de_trim + elevator[k]
        states[k] = x
        air[k] = air_relative(x, wind[k])
        ax[k], az[k], qdot[k] = forces(air[k], de, thrust)
        ahead = wind[min(k + 1, n - 1)]
        for i in range(substeps):
            now, mid, end = (wind[k] + (ahead - wind[k]) * (i + part) / substeps for part in (0.0, 0.5, 1.0))
            k1 = rates(x, de, thrust, now)
            k2 = rates(x + 0.5 * dt * k1, de, thrust, mid)
            k3 = rates(x + 0.5 * dt * k2, de, thrust, mid)
            k4 = rates(x + dt * k3, de, thrust, end)
            x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    _, _, q, theta = states.T
    u, w = air[:, 0], air[:, 1]
    zero = np.zeros(n)
    return {
        "airspeed": np.hypot(u, w), "alpha": np.arctan2(w, u), "beta": zero, "phi": zero, "theta": theta,
        "psi": zero, "p": zero, "q": q, "r": zero, "ax": ax, "ay": zero, "az": az,
        "de": de_trim + elevator, "thrust": np.full(n, thrust), "qdot_true": qdot, "u_true": u, "w_true": w,
    }  # fmt: skip


def pulse(duration=10.0, interval=0.02, amplitude=TWO_DEGREES, start=1.0, width=1.0):
    """One elevator pulse."""
    time = interval * np.arange(round(duration / interval))
    return np.where((time >= start - 1e-9) & (time < start + width - 1e-9), amplitude, 0.0)


def multisine(duration=20.0, interval=0.02, amplitude=TWO_DEGREES, rng=None):
    """Sum of harmonics 0.1 to 2.5 Hz between 1 s and 19 s, scaled to its peak."""
    rng = rng or np.random.default_rng(5)
    time = interval * np.arange(round(duration / interval))
    span = duration - 2.0
    harmonics = np.arange(2, round(2.5 * span))
    phase = rng.uniform(0.0, 2.0 * np.pi, harmonics.size)
    wave = np.sin(2.0 * np.pi * np.outer(time - 1.0, harmonics) / span + phase).sum(axis=1)
    wave[(time < 1.0) | (time > duration - 1.0)] = 0.0
    return amplitude * wave / np.abs(wave).max()


def measure(truth, rng, errors=ERRORS, noise=NOISE, interval=0.02, name="mav"):
    """Readings of Table II's sensors: (1 + scale) true + bias + white noise."""
    columns = {key: values.copy() for key, values in truth.items() if not key.endswith("_true")}
    bias = {"ax": "accel_bias_x", "ay": "accel_bias_y", "az": "accel_bias_z"}
    bias |= {rate: f"gyro_bias_{rate}" for rate in "pqr"}
    for key in columns:
        if key in ("de", "thrust"):
            continue
        scale = errors.get(f"{key}_scale", 0.0)
        offset = errors.get(bias.get(key, f"{key}_bias"), 0.0)
        columns[key] = (
            (1.0 + scale) * columns[key] + offset + noise.get(key, 0.0) * rng.standard_normal(columns[key].size)
        )
    time = interval * np.arange(columns["q"].size)
    return FlightData(name, interval, time, columns)

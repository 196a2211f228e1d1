"""The paper's experiment end to end: estimates against the paper's errors, the bound against another computation."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "paper_tables.py"
SEEDS = 10

# Tables III and IV: name -> printed true value, largest RMS error allowed (the paper's own error or less).
REQUIRED = {
    "accel_bias_x": (0.1962, 0.0227), "accel_bias_z": (0.1962, 0.0064), "gyro_bias_q": (0.25, 0.0551),
    "alpha_scale": (0.005, 0.06), "theta_scale": (0.0, 0.002),
    "CL_0": (0.1784, 0.0143), "CL_alpha": (2.453, 0.05), "CL_de": (0.7405, 0.15), "CD_0": (0.0871, 0.0071),
    "CD_k": (0.4, 0.0248), "Cm_0": (0.0385, 0.004), "Cm_alpha": (-0.5998, 0.013), "Cm_de": (1.5894, 0.04),
}  # fmt: skip
ONE_STEP, TWO_STEP = "one-step: output error", "two-step: compatibility, correction, equation error"


def run(*options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(SCRIPT), *options], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Finished process and its JSON."""
    target = tmp_path_factory.mktemp("paper") / "tables.json"
    done = run("--seeds", str(SEEDS), "--workers", "1", "--json", str(target))
    return done, json.loads(target.read_text(encoding="utf-8"))


def test_every_requirement_is_met(outcome):
    done, result = outcome
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("required RMS error: met by all 13") == 2
    for estimator in (ONE_STEP, TWO_STEP):
        rows = result["estimators"][estimator]
        assert set(rows) == set(REQUIRED)
        for name, (true, limit) in REQUIRED.items():
            assert rows[name]["true"] == true
            assert rows[name]["rms"] <= limit, f"{estimator}: {name}"


def test_one_step_is_near_the_bound(outcome):
    rows = outcome[1]["estimators"][ONE_STEP]
    # 13 rows of 10 flights: chi-squared with 130 degrees of freedom has a 99.9 % quantile of 184 (of independent rows;
    # these correlate, which widens it, and the goal of 1.15 bounds leaves room for that).
    assert sum(SEEDS * (row["rms"] / row["bound"]) ** 2 for row in rows.values()) < 184.0 * 1.15**2
    assert np.mean([row["within_3_bounds"] for row in rows.values()]) >= 0.98
    assert np.mean([row["coverage"] for row in rows.values()]) >= 0.88


def test_bound_agrees_with_another_computation(outcome):
    """The bound of the flown flights against a vertical-plane simulation of this file's own."""
    rows = outcome[1]["estimators"][ONE_STEP]
    for name, bound in independent_bound().items():
        assert rows[name]["bound"] == pytest.approx(bound, rel=0.02), name


def test_wrong_use_is_refused():
    done = run("--seeds", "0")
    assert done.returncode == 2
    assert "--seeds must be at least 1" in done.stderr


# --- another computation: one pulse in the vertical plane, all perturbed runs side by side ---

MASS, S, C, IYY, GRAVITY, SPEED = 1.0, 0.2, 0.2, 0.03, 9.80665, 15.0
RHO = 1.225 * (1.0 - 0.0065 * 100.0 / 288.15) ** 4.2559  # International Standard Atmosphere at 100 m
VANE_X = 0.1
NAMES = list(REQUIRED)
SIGMA = np.array([0.02, np.radians(0.3), np.radians(0.03), np.radians(0.05), 0.008 * 9.81, 0.008 * 9.81])


def motion(k, x, de, thrust):
    """ax, az and the rates of u w q theta; every entry of k (13 values by name) and x (4 states) may be an array."""
    u, w, q, theta = x
    alpha, qs = np.arctan2(w, u), 0.5 * RHO * (u * u + w * w) * S
    CL = k["CL_0"] + k["CL_alpha"] * alpha + k["CL_de"] * de
    CD = k["CD_0"] + k["CD_k"] * CL**2
    ax = (thrust + qs * (CL * np.sin(alpha) - CD * np.cos(alpha))) / MASS
    az = -qs * (CD * np.sin(alpha) + CL * np.cos(alpha)) / MASS
    qdot = qs * C * (k["Cm_0"] + k["Cm_alpha"] * alpha + k["Cm_de"] * de) / IYY
    return ax, az, np.array([ax - q * w - GRAVITY * np.sin(theta), az + q * u + GRAVITY * np.cos(theta), qdot, q])


def outputs(k, x, de, thrust):
    """Readings V alpha q theta ax az (6, runs)."""
    ax, az, _ = motion(k, x, de, thrust)
    u, w, q, theta = x
    speed = np.hypot(u, w)
    alpha = np.arctan2(w, u) - VANE_X * q / speed
    return np.array(
        [
            speed * np.sqrt(RHO / 1.225), (1.0 + k["alpha_scale"]) * alpha, q + np.radians(k["gyro_bias_q"]),
            (1.0 + k["theta_scale"]) * theta, ax + k["accel_bias_x"], az + k["accel_bias_z"],
        ]
    )  # fmt: skip


def independent_bound():
    """Cramer-Rao bound by central differences over 13 parameters and 4 initial states, in printed units."""
    true = {name: value for name, (value, _) in REQUIRED.items()}

    def residual(free):
        alpha, de, thrust = free
        x = np.array([SPEED * np.cos(alpha), SPEED * np.sin(alpha), 0.0, alpha])
        return motion(true, x, de, thrust)[2][:3]

    alpha, de_trim, thrust = fsolve(residual, [0.07, 0.0, 3.7], xtol=1e-13)
    start = np.array([SPEED * np.cos(alpha), SPEED * np.sin(alpha), 0.0, alpha])
    count = len(NAMES) + 4
    step = 1e-5
    signs = np.concatenate([np.eye(count), -np.eye(count)], axis=1) * step
    k = {name: true[name] + signs[i] for i, name in enumerate(NAMES)}
    x = start[:, None] + signs[len(NAMES) :]
    information = np.zeros((count, count))
    dt, parts = 0.02, 2
    for sample in range(501):
        # A sensor still sees the surface of the step that ends at its sample.
        before, now = (de_trim + np.radians(2.0) * (50 <= m < 100) for m in (sample - 1, sample))
        y = outputs(k, x, before, thrust)
        slope = (y[:, :count] - y[:, count:]) / (2.0 * step) / SIGMA[:, None]
        information += slope.T @ slope
        h = dt / parts
        for _ in range(parts):
            k1 = motion(k, x, now, thrust)[2]
            k2 = motion(k, x + 0.5 * h * k1, now, thrust)[2]
            k3 = motion(k, x + 0.5 * h * k2, now, thrust)[2]
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + motion(k, x + h * k3, now, thrust)[2])
    scale = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return dict(zip(NAMES, np.sqrt(np.diag(covariance)), strict=False))

"""The compatibility check against hidden truth: the paper's MAV simulated on its own, sensors of Table II."""

from dataclasses import replace

import mav_longitudinal as mav
import numpy as np
import pytest

from sysid.compatibility.kinematics import air_data, reconstruct, to_centre_of_gravity
from sysid.compatibility.reconstruction import compatibility, correct
from sysid.compatibility.selection import most_implausible, select
from sysid.errors import EstimationError, SignalError
from sysid.signals.flight import FlightData
from sysid.signals.sensor_mounting import SensorMounting

pytestmark = pytest.mark.whole_flight

PAPER = ("accel_bias_x", "accel_bias_z", "gyro_bias_q", "alpha_scale", "theta_scale")
NUISANCE = ("accel_bias_y", "gyro_bias_p", "gyro_bias_r")
RUNS = 40


@pytest.fixture(scope="module")
def truth():
    return mav.fly(mav.pulse())


@pytest.fixture(scope="module")
def repeats(truth):
    """Estimates of the paper's five sensor errors from repeated flights of one 2 deg elevator pulse in 10 s."""
    results = []
    for seed in range(RUNS):
        data = mav.measure(truth, np.random.default_rng(seed))
        results.append(compatibility(data, candidates=[*PAPER, *NUISANCE]))
    return results


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        # Root mean square errors of a two-step estimate with the same noise; the paper's own errors are
        # 0.0227 and 0.0064 m/s2, 0.0551 deg/s and 0.06.
        ("accel_bias_x", 0.0043),
        ("accel_bias_z", 0.0045),
        ("gyro_bias_q", np.deg2rad(0.0018)),
        ("alpha_scale", 0.012),
        ("theta_scale", 0.0006),
    ],
)
def test_sensor_errors_are_recovered(repeats, name, limit):
    error = np.array([r.parameters[name].value - mav.ERRORS.get(name, 0.0) for r in repeats])
    # 40 runs tell a root mean square to 11 %: two such sigmas are allowed.
    assert np.sqrt(np.mean(error**2)) < 1.22 * limit


def test_intervals_cover_the_truth(repeats):
    inside = [
        abs(r.parameters[name].value - mav.ERRORS.get(name, 0.0)) < 1.96 * r.parameters[name].std
        for r in repeats
        for name in (*PAPER, *NUISANCE)
    ]
    assert 0.90 < np.mean(inside) <= 1.0


def test_outputs_agree_after_the_correction_and_not_before(repeats):
    result = repeats[0]
    assert result.compatible
    assert result.converged
    assert result.after["airspeed"].rms < 0.05 < result.before["airspeed"].rms
    assert result.after["theta"].rms < 2.0 * mav.NOISE["theta"] < result.before["theta"].rms
    assert result.noise["alpha"] == pytest.approx(mav.NOISE["alpha"], rel=0.2)
    assert result.gust_sigma < 0.05


def test_reconstruction_is_far_better_than_the_vane(truth, repeats):
    states = repeats[0].states[0]
    error = states["alpha"] - truth["alpha"]
    assert np.sqrt(np.mean(error**2)) < 0.25 * mav.NOISE["alpha"]
    assert np.sqrt(np.mean((states["V"] - truth["airspeed"]) ** 2)) < 0.02


def test_what_the_flight_cannot_tell_is_refused_with_reason_and_manoeuvre(truth):
    result = compatibility(mav.measure(truth, np.random.default_rng(0)))
    refused = {refusal.name: refusal for refusal in result.refused}
    # Attitude mounting and accelerometer bias are one thing in level flight; sideslip never moved.
    assert "accel_bias_x" in refused["theta_bias"].reason
    assert "noise" in refused["beta_scale"].reason
    assert not set(refused) & set(result.parameters)
    assert all(refusal.manoeuvre for refusal in result.refused)


def test_in_rough_air_an_error_that_no_sensor_has_is_refused_and_in_calm_air_told(truth):
    """A vane that hardly moves: in rough air, where the fit may have run away, its gain is held."""

    def with_weak_vane(motion, generator):
        data = mav.measure(motion, generator)
        weak = replace(data, columns=data.columns | {"alpha": 0.05 + 0.04 * data["alpha"]})
        return compatibility(weak, candidates=[*PAPER, *NUISANCE, "alpha_bias"])

    wave, generator = mav.multisine(), np.random.default_rng(1)
    rough = with_weak_vane(mav.fly(wave, substeps=2, wind=mav.gust(wave.size, 1.0, generator)), generator)
    assert "which no sensor does" in {one.name: one.reason for one in rough.refused}["alpha_scale"]
    assert "alpha_scale" not in rough.parameters
    for name in ("gyro_bias_q", "theta_scale"):
        error = rough.parameters[name]
        assert abs(error.value - mav.ERRORS.get(name, 0.0)) < 4.0 * error.std, name
    calm = with_weak_vane(truth, np.random.default_rng(0)).parameters["alpha_scale"]
    # Of the vane's own reading, whose gain is 1.005.
    assert calm.value == pytest.approx(0.04 * 1.005 - 1.0, abs=4.0 * calm.std)


def test_the_worst_of_the_errors_that_no_sensor_has_goes_first():
    names = ["alpha_scale", "airspeed_bias", "gyro_bias_q", "wind_north"]
    assert most_implausible(names, [-0.6, 3.0, 0.1, 40.0]) is None
    assert most_implausible(names, [-0.8, 30.0, 0.1, 0.0]).name == "airspeed_bias"
    assert most_implausible(names, [-1.2, 30.0, 0.1, 0.0]).name == "alpha_scale"
    assert most_implausible(names, [4.5, 3.0, 0.1, 0.0]).name == "alpha_scale"


def test_turbulence_is_found_and_does_not_bias_the_vane():
    wave = mav.multisine()
    errors = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        truth = mav.fly(wave, substeps=2, wind=mav.gust(wave.size, 0.3, rng))
        result = compatibility(mav.measure(truth, rng), candidates=[*PAPER, *NUISANCE])
        assert 0.15 < result.gust_sigma < 0.5
        errors.append(result.parameters["alpha_scale"].value - 0.005)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03


def test_two_parts_are_better_than_one(truth):
    one = mav.measure(truth, np.random.default_rng(1))
    two = mav.measure(truth, np.random.default_rng(2))
    single = compatibility(one, candidates=[*PAPER, *NUISANCE])
    both = compatibility([one, two], candidates=[*PAPER, *NUISANCE])
    ratio = both.parameters["accel_bias_x"].std / single.parameters["accel_bias_x"].std
    assert ratio == pytest.approx(np.sqrt(0.5), abs=0.06)
    assert len(both.states) == 2


def test_a_bench_prior_narrows_the_estimate(truth):
    data = mav.measure(truth, np.random.default_rng(3))
    wanted = [*PAPER, *NUISANCE]
    informed = compatibility(data, candidates=wanted, priors={"alpha_scale": (0.005, 0.002)})
    assert informed.parameters["alpha_scale"].std < 0.002


def test_corrected_signals_are_the_truth(truth, repeats):
    data = mav.measure(truth, np.random.default_rng(0))
    corrected = correct(data, repeats[0], part=0)
    assert np.mean(corrected["az"] - truth["az"]) == pytest.approx(0.0, abs=0.015)
    assert np.mean(corrected["q"] - truth["q"]) == pytest.approx(0.0, abs=1e-4)
    assert corrected["V"] == pytest.approx(truth["airspeed"], abs=0.1)
    with pytest.raises(EstimationError, match="already corrected"):
        correct(corrected, repeats[0])


def turning_flight():
    """A circling flight of prescribed motion; rates and specific force follow from it by the kinematic equations."""

    def state(t):
        speed, alpha, beta = 15.0 + np.sin(0.5 * t), 0.08 + 0.04 * np.sin(2.1 * t), 0.04 * np.sin(1.7 * t)
        phi, theta, psi = 0.4 + 0.2 * np.sin(0.8 * t), 0.07 + 0.08 * np.sin(1.1 * t), 0.3 * t
        u, w = speed * np.cos(alpha) * np.cos(beta), speed * np.sin(alpha) * np.cos(beta)
        return np.array([u, speed * np.sin(beta), w, phi, theta, psi])

    time = 0.02 * np.arange(2000)
    u, v, w, phi, theta, psi = state(time)
    du, dv, dw, dphi, dtheta, dpsi = (state(time + 1e-4) - state(time - 1e-4)) / 2e-4
    p = dphi - dpsi * np.sin(theta)
    q = dtheta * np.cos(phi) + dpsi * np.cos(theta) * np.sin(phi)
    r = -dtheta * np.sin(phi) + dpsi * np.cos(theta) * np.cos(phi)
    ax = du - r * v + q * w + mav.G * np.sin(theta)
    ay = dv - p * w + r * u - mav.G * np.cos(theta) * np.sin(phi)
    az = dw - q * u + p * v - mav.G * np.cos(theta) * np.cos(phi)
    return time, np.column_stack([u, v, w, phi, theta, psi]), np.column_stack([ax, ay, az, p, q, r])


def test_reconstruction_follows_a_prescribed_motion_to_fourth_order():
    _, states, imu = turning_flight()
    found = reconstruct(states[0].copy(), imu, np.zeros(6), 0.02, mav.G)
    assert found == pytest.approx(states, abs=1e-3)
    coarse = reconstruct(states[0].copy(), np.ascontiguousarray(imu[::4]), np.zeros(6), 0.08, mav.G)
    fine = reconstruct(states[0].copy(), np.ascontiguousarray(imu[::2]), np.zeros(6), 0.04, mav.G)
    ratio = np.abs(coarse - states[::4])[-50:].max() / np.abs(fine - states[::2])[-100:].max()
    assert ratio > 8.0


def test_wind_comes_from_gps_and_vanes_off_the_centre_are_moved():
    time, states, imu = turning_flight()
    wind = np.array([3.0, -2.0, 0.0])
    rng = np.random.default_rng(0)
    speed, alpha, beta = air_data(states[:, :3])
    p, q, r = imu[:, 3:].T
    phi, theta, psi = states[:, 3:].T
    north = np.column_stack([np.cos(theta) * np.cos(psi), np.cos(theta) * np.sin(psi), -np.sin(theta)])
    right = np.column_stack(
        [
            np.sin(phi) * np.sin(theta) * np.cos(psi) - np.cos(phi) * np.sin(psi),
            np.sin(phi) * np.sin(theta) * np.sin(psi) + np.cos(phi) * np.cos(psi),
            np.sin(phi) * np.cos(theta),
        ]
    )
    down = np.cross(north, right)
    ground = states[:, :1] * north + states[:, 1:2] * right + states[:, 2:3] * down + wind
    ground += 0.1 * rng.standard_normal(ground.shape)
    ground[np.arange(time.size) % 10 != 0] = np.nan
    layout = SensorMounting(alpha_vane=(0.1, 0.5, 0.0), beta_vane=(0.1, -0.5, 0.2))
    columns = dict(zip(("ax", "ay", "az", "p", "q", "r"), imu.T, strict=True))
    columns |= {
        "airspeed": speed, "alpha": alpha - 0.1 * q / speed + 0.5 * p / speed,
        "beta": beta + 0.1 * r / speed - 0.2 * p / speed, "phi": phi, "theta": theta, "psi": psi,
    }  # fmt: skip
    for name in columns:
        columns[name] = columns[name] + mav.NOISE[name] * rng.standard_normal(time.size)
    columns |= dict(zip(("vn", "ve", "vd"), ground.T, strict=True))
    data = FlightData("circle", 0.02, time, columns)
    result = compatibility(data, layout)
    for name, true in zip(("wind_north", "wind_east"), wind, strict=False):
        estimate = result.parameters[name]
        assert abs(estimate.value - true) < 4.0 * estimate.std
        assert estimate.std < 0.3
    for name, estimate in result.parameters.items():
        if not name.startswith("wind"):
            assert abs(estimate.value) < 4.0 * estimate.std, name
    corrected = correct(data, replace(result, parameters={}))
    assert np.mean((corrected["alpha"] - alpha) ** 2) < 1.1 * mav.NOISE["alpha"] ** 2
    assert np.mean((corrected["beta"] - beta) ** 2) < 1.1 * mav.NOISE["beta"] ** 2


def test_accelerometer_lever_arm():
    # Steady rotation about z, sensor 0.2 m ahead: it feels the centripetal acceleration -r^2 x.
    rates = np.tile([0.0, 0.0, 2.0], (3, 1))
    moved = to_centre_of_gravity(np.zeros((3, 3)), rates, np.zeros((3, 3)), (0.2, 0.0, 0.0))
    assert moved == pytest.approx(np.tile([0.8, 0.0, 0.0], (3, 1)))
    # Pitch acceleration, sensor ahead: a_z there is -q' x more.
    moved = to_centre_of_gravity(np.zeros((1, 3)), np.zeros((1, 3)), np.array([[0.0, 5.0, 0.0]]), (0.2, 0.0, 0.0))
    assert moved == pytest.approx(np.array([[0.0, 0.0, 1.0]]))


def test_selection_keeps_one_of_a_collinear_pair():
    std = np.array([0.2, 0.015])
    covariance = np.outer(std, std) * np.array([[1.0, 0.99], [0.99, 1.0]])
    kept, refused = select(["accel_bias_x", "theta_bias"], covariance)
    assert kept == ["accel_bias_x"]
    assert refused[0].name == "theta_bias"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"az": None}, "needs az"),
        ({"q": np.full(500, np.nan)}, "q has gaps"),
        ({"theta": np.full(500, 1.5)}, "Euler angles fail"),
    ],
)
def test_unusable_parts_are_refused(truth, change, message):
    data = mav.measure(truth, np.random.default_rng(0))
    columns = {name: value for name, value in (data.columns | change).items() if value is not None}
    with pytest.raises(SignalError, match=message):
        compatibility(replace(data, columns=columns))


def test_unknown_names_are_refused(truth):
    with pytest.raises(EstimationError, match="unknown sensor error gyro_scale"):
        compatibility(mav.measure(truth, np.random.default_rng(0)), candidates=["gyro_scale"])

"""One part of a flight as the kinematic filter takes it, and how well its outputs agree in open loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.arrays import Array
from sysid.compatibility.ekf import OUTPUTS, PARAMETERS, predict_readings
from sysid.compatibility.ekf_jacobians import linearise_part
from sysid.compatibility.kinematics import STATES, air_data, body_velocity, reconstruct, to_centre_of_gravity
from sysid.errors import SignalError
from sysid.numerics.smoothing import fourier_smooth, sample_noise
from sysid.signals.flight import FlightData
from sysid.signals.sensor_mounting import SensorMounting

# See `linearise_part`.
PartJacobians = tuple[Array, Array, Array, Array]

IMU = ("ax", "ay", "az", "p", "q", "r")
REQUIRED = (*IMU, "airspeed", "phi", "theta")
# Below these a converter's last bit or a simulated perfect sensor would be trusted without end.
_NOISE_FLOOR = {"ax": 1e-3, "ay": 1e-3, "az": 1e-3, "p": 1e-5, "q": 1e-5, "r": 1e-5, "airspeed": 1e-3}
_OUTPUT_FLOOR = 1e-5
_GPS_NOISE = 0.1  # m/s: a receiver's velocity comes too rarely and too filtered to read its noise off it
_WINDOW_S = 10.0  # open-loop agreement starts afresh after this time; integrated noise grows without bound
# No specific force, speed, rate or unwrapped angle of a small aircraft goes beyond, SI units.
_LARGEST = 1e4
_STEEP = 1.4  # rad: beyond it Euler angles fail


@dataclass(frozen=True)
class OutputFit:
    """How well one output agrees: rms of the difference (unit of the output) and TIC (Theil)."""

    rms: float
    tic: float


@dataclass
class Part:
    """Arrays of one part; `nominal` (N, 6) and `gusts` (N, 3), the trajectory linearised about, are replaced by others
    but never written to.

    imu: (N, 6) at the centre of gravity. z: (N, 9) outputs, NaN missing. noise: (9,), imu_noise: (6,) sigma.
    dt: s. speed: mean true airspeed, m/s. layout: (7,) packed. measured_start: (N, 6) states from the sensors alone.
    """

    data: FlightData
    imu: Array
    z: Array
    noise: Array
    imu_noise: Array
    dt: float
    speed: float
    layout: Array
    measured: Array
    nominal: Array
    gusts: Array
    _kept: tuple[Array, Array, Array, PartJacobians] | None = field(default=None, init=False, repr=False, compare=False)

    def linearised(self, theta: Array) -> PartJacobians:
        """What `linearise_part` gives for sensor errors (18,) along the nominal trajectory; the last is kept."""
        kept = self._kept
        if kept is not None and kept[0] is self.nominal and kept[1] is self.gusts and np.array_equal(kept[2], theta):
            return kept[3]
        self._kept = None  # what is kept is large
        jacobians = linearise_part(self.nominal, self.gusts, theta, self.imu, self.dt, self.layout)
        self._kept = (self.nominal, self.gusts, theta.copy(), jacobians)
        return jacobians

    def predicted(self) -> Array:
        """(N, 9) readings of perfect sensors along the nominal trajectory, order OUTPUTS."""
        return predict_readings(self.nominal, self.gusts, self.imu, np.zeros(len(PARAMETERS)), self.layout)

    def reconstructed(self) -> dict[str, Array]:
        """Air-relative motion of the nominal trajectory: u v w phi theta psi V alpha beta."""
        velocity = self.nominal[:, :3] - _to_body(self.nominal, self.gusts)
        speed, alpha, beta = air_data(velocity)
        names = {name: self.nominal[:, i] for i, name in enumerate(STATES)}
        names |= {"u": velocity[:, 0], "v": velocity[:, 1], "w": velocity[:, 2]}
        return names | {"V": speed, "alpha": alpha, "beta": beta}


def _reach(values: Array) -> float:
    """Largest magnitude, NaN left out."""
    return float(np.nanmax(np.abs(values), initial=0.0))


def prepare_part(data: FlightData, layout: SensorMounting) -> Part:
    """Arrays of one part.

    data: signals as measured, see `compatibility`. layout: sensor positions.
    Raises SignalError for a missing signal, NaN within a required one, fewer than 50 samples, or a climb too steep.
    """
    missing = [name for name in REQUIRED if name not in data]
    if missing:
        raise SignalError(f"{data.name}: data compatibility needs {', '.join(missing)}, which the flight lacks")
    holes = [name for name in REQUIRED if not np.isfinite(data[name]).all()]
    if holes:
        raise SignalError(f"{data.name}: {', '.join(holes)} has gaps in this part; give a part without (find_segments)")
    absurd = [name for name in (*REQUIRED, *OUTPUTS) if name in data and _reach(data[name]) > _LARGEST]
    if absurd:
        raise SignalError(
            f"{data.name}: {absurd[0]} reaches {_reach(data[absurd[0]]):.3g} in SI units, which no aircraft does;"
            " check its unit and calibration"
        )
    n, dt = data.time_s.size, data.interval_s
    if n < 50:
        raise SignalError(f"{data.name}: {n} samples are too few for data compatibility, 50 are the least")
    if float(np.abs(data["theta"]).max()) > _STEEP:
        raise SignalError(
            f"{data.name}: pitch beyond {np.rad2deg(_STEEP):.0f} deg, where Euler angles fail; leave it out"
        )
    z = np.full((n, len(OUTPUTS)), np.nan)
    noise = np.ones(len(OUTPUTS))
    for j, name in enumerate(OUTPUTS):
        if name in data and np.isfinite(data[name]).sum() >= 2:
            z[:, j] = data[name]
            noise[j] = _output_noise(name, data[name], dt)
    z[:, 5] = _unwrapped(z[:, 5])
    imu_noise = np.array([max(sample_noise(data[name], dt), _NOISE_FLOOR[name]) for name in IMU])
    imu = np.ascontiguousarray(_imu_at_centre(data, layout, np.zeros(3)).T)
    measured = _measured_states(data, z, layout)
    speed = float(np.mean(data["airspeed"])) * layout.airspeed_factor
    return Part(
        *(data, imu, np.ascontiguousarray(z), noise, imu_noise, dt, speed, layout.packed()),
        *(measured, measured.copy(), np.zeros((n, 3))),
    )


def part_states(data: FlightData, layout: SensorMounting, values: Mapping[str, float]) -> dict[str, Array]:
    """Signals of a part with sensor errors taken off, at the centre of gravity.

    Parameters
    ----------
    data : FlightData
        The part: N uniform samples of the sensors' readings, SI units and rad.
    layout : SensorMounting
        Where the sensors sit and what they read.
    values : Mapping[str, float]
        Sensor errors by name, each in the unit of `sysid.compatibility.selection.LIMITS`; those absent count as 0.

    Returns
    -------
    dict[str, Array], each of shape (N,)
        ax ay az [m/s^2], p q r [rad/s], V [m/s] and, where measured, alpha beta phi theta [rad]. Where vn ve vd are
        measured and their wind is in `values`, the velocity against the air vn_air ve_air vd_air [m/s], earth axes.
    """

    def error(name: str) -> float:
        return values.get(name, 0.0)

    def true(name: str) -> Array:
        bias, scale = error(f"{name}_bias"), error(f"{name}_scale")
        return (data[name] - bias) / (1.0 + scale) if bias or scale else data[name]

    imu = _imu_at_centre(data, layout, np.array([error(f"gyro_bias_{axis}") for axis in "pqr"]))
    imu -= np.array([error(name) for name in PARAMETERS[:6]])[:, None]
    out = dict(zip(IMU, imu, strict=True))
    out["V"] = true("airspeed") * layout.airspeed_factor
    p, q, r = imu[3:]
    speed = np.maximum(out["V"], 1.0)
    if "alpha" in data:
        x, y, _ = layout.alpha_vane
        out["alpha"] = true("alpha") + (x * q - y * p) / speed
    if "beta" in data:
        x, _, z = layout.beta_vane
        vane = true("beta") + (z * p - x * r) / speed
        if layout.beta_kind == "flank":
            vane = np.arctan(np.tan(vane) * np.cos(out.get("alpha", np.zeros_like(vane))))
        out["beta"] = vane
    for name in ("phi", "theta"):
        if name in data:
            out[name] = true(name)
    for name, wind in (("vn", "wind_north"), ("ve", "wind_east"), ("vd", "wind_down")):
        if name in data and wind in values:
            out[f"{name}_air"] = data[name] - error(wind)
    return out


def open_loop_agreement(parts: list[Part], theta: Array, measured_start: bool) -> dict[str, OutputFit]:
    """Measured outputs against integrated kinematics, windows of at most 10 s, all parts pooled.

    theta: (18,) sensor errors. measured_start: start from the sensors' (smoothed) values, else from the nominal
    trajectory. Wind is not compared without its estimate: GPS velocities enter only with `wind_*` in theta.
    """
    differences: list[Array] = []
    readings: list[Array] = []
    for part in parts:
        size = max(round(_WINDOW_S / part.dt), 2)
        starts = part.measured if measured_start else part.nominal
        for first in range(0, part.z.shape[0], size):
            part_slice = slice(first, min(first + size, part.z.shape[0]))
            imu = np.ascontiguousarray(part.imu[part_slice])
            states = reconstruct(starts[first].copy(), imu, theta[:6], part.dt, float(part.layout[6]))
            predicted = predict_readings(
                states, part.gusts[part_slice] * float(not measured_start), imu, theta, part.layout
            )
            difference = part.z[part_slice] - predicted
            difference[:, 3:6] = np.arctan2(np.sin(difference[:, 3:6]), np.cos(difference[:, 3:6]))
            differences.append(difference)
            readings.append(part.z[part_slice])
    gap, z = np.concatenate(differences), np.concatenate(readings)
    fits: dict[str, OutputFit] = {}
    for j, name in enumerate(OUTPUTS):
        seen = np.isfinite(gap[:, j])
        if np.any(seen):
            rms = float(np.sqrt(np.mean(gap[seen, j] ** 2)))
            size_z = float(np.sqrt(np.mean(z[seen, j] ** 2)))
            size_y = float(np.sqrt(np.mean((z[seen, j] - gap[seen, j]) ** 2)))
            fits[name] = OutputFit(rms, rms / max(size_z + size_y, 1e-12))
    return fits


def _to_body(states: Array, vector: Array) -> Array:
    """(N, 3) NED vectors in the body axes of (N, 6) states."""
    sf, cf = np.sin(states[:, 3]), np.cos(states[:, 3])
    st, ct = np.sin(states[:, 4]), np.cos(states[:, 4])
    sp, cp = np.sin(states[:, 5]), np.cos(states[:, 5])
    north, east, down = vector[:, 0], vector[:, 1], vector[:, 2]
    ahead = cp * north + sp * east
    aside = -sp * north + cp * east
    x = ct * ahead - st * down
    lifted = st * ahead + ct * down
    return np.column_stack([x, sf * lifted + cf * aside, cf * lifted - sf * aside])


def _imu_at_centre(data: FlightData, layout: SensorMounting, gyro_bias: Array) -> Array:
    """(6, N) what the IMU would read at the centre of gravity. gyro_bias: (3,) rad/s."""
    imu = np.stack([data[name] for name in IMU], dtype=np.float64)
    if any(layout.accelerometer):
        rates = imu[3:] - gyro_bias[:, None]
        slopes = np.column_stack([_slope(rate, data.interval_s) for rate in rates])
        imu[:3] = to_centre_of_gravity(imu[:3].T, rates.T, slopes, layout.accelerometer).T
    return imu


def _slope(values: Array, dt: float) -> Array:
    """Derivative of each run without NaN; NaN elsewhere and in runs too short to smooth."""
    slope = np.full(values.size, np.nan)
    finite = np.concatenate([[0], np.isfinite(values).astype(np.int8), [0]])
    for start, stop in np.flatnonzero(np.diff(finite)).reshape(-1, 2):
        if stop - start >= 16:
            slope[start:stop] = fourier_smooth(values[start:stop], dt).derivative
    return slope


def _output_noise(name: str, values: Array, dt: float) -> float:
    if name in ("vn", "ve", "vd"):
        return _GPS_NOISE
    dense = np.isfinite(values)
    if dense.mean() < 0.9:
        # Sparse samples: the time between them is the sampling interval.
        values, dt = values[dense], dt / float(dense.mean())
        if values.size < 16:
            return max(float(np.std(np.diff(values)) / np.sqrt(2.0)), _OUTPUT_FLOOR)
    return max(sample_noise(values, dt), _NOISE_FLOOR.get(name, _OUTPUT_FLOOR))


def _unwrapped(values: Array) -> Array:
    out = values.copy()
    seen = np.isfinite(values)
    out[seen] = np.unwrap(values[seen])
    return out


def _measured_states(data: FlightData, z: Array, layout: SensorMounting) -> Array:
    """(N, 6) states from air data and attitude alone, smoothed; what is not measured is 0 (psi: integrated)."""

    def column(index: int) -> Array:
        seen = np.isfinite(z[:, index])
        if seen.sum() < 2:
            return np.zeros(z.shape[0])
        filled = np.interp(data.time_s, data.time_s[seen], z[seen, index])
        return fourier_smooth(filled, data.interval_s).values

    speed = np.maximum(column(0) * layout.airspeed_factor, 1.0)
    alpha, beta, phi, theta, psi = (column(index) for index in range(1, 6))
    if not np.isfinite(z[:, 1]).any():
        # Level flight: what the aircraft carries on its lift; good enough to linearise about.
        alpha = np.full(z.shape[0], 0.05)
    if not np.isfinite(z[:, 5]).any():
        turn = (data["q"] * np.sin(phi) + data["r"] * np.cos(phi)) / np.cos(theta)
        psi = np.cumsum(turn) * data.interval_s
    velocity = body_velocity(speed, alpha, beta)
    return np.ascontiguousarray(np.column_stack([velocity, phi, theta, psi]))

"""Data compatibility: do IMU, air data, attitude and GPS describe one motion, and with which sensor errors?

The kinematic equations are integrated from specific force and rates and compared with V, alpha, beta, attitude
and GPS velocity. Sensor errors and states are estimated together by maximum likelihood (Gauss-Newton on the
innovations, IMU noise and turbulence as process noise), so that the standard errors are those of the whole chain.
Sources: Klein & Morelli, "Aircraft System Identification", chapter 10; R. V. Jategaonkar, "Flight Vehicle System
Identification", chapter 10; R. K. Mehra, "Approaches to adaptive filtering", IEEE TAC 17(5), 1972 (output noise).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.arrays import Array
from sysid.compatibility.ekf import OUTPUTS, PARAMETERS
from sysid.compatibility.ekf_part import IMU, OutputFit, Part, open_loop_agreement, part_states, prepare_part
from sysid.compatibility.gauss_newton import Mask, ReconstructionSettings, Solution, apply, run_pass, step
from sysid.compatibility.selection import LIMITS, Refusal, most_implausible, select
from sysid.errors import EstimationError
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared, airspeed_gain, in_even_air
from sysid.signals.record import OUTPUTS as RECORD_OUTPUTS
from sysid.signals.record import STATES, Record
from sysid.signals.sensor_mounting import SensorMounting

__all__ = ["CompatibilityResult", "OutputFit", "Refusal", "SensorError", "SensorMounting", "compatibility", "correct"]

_COUNT = len(PARAMETERS)
_MAX_ITERATIONS = 20  # of Gauss-Newton
# Passes from the sensors' own readings to a smoothed motion that moves no more.
_SETTLING_PASSES = 4
# Prior of a sensor error: ten times the standard error above which it is refused, so that it says nothing itself.
_DIFFUSE = 10.0
_CALM = 0.05  # m/s
_GUSTS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
# Two log-likelihood units for one parameter: 95 %. Below that the air counts as calm.
_GUST_GAIN = 2.0
_GUST_LOST = 100.0
# An output agrees if its TIC is below the customary mark, or what is left is no more than a few sigma of its noise.
TIC_LIMIT = 0.25
_SIGMA_LIMIT = 3.0


@dataclass(frozen=True)
class SensorError:
    """One estimated sensor error: value and standard deviation in `unit` (scale factors in "1")."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class CompatibilityResult:
    """Sensor errors of one or more flight parts, and the motion reconstructed with them.

    parameters: name -> SensorError. covariance: (P, P) in the order of `parameters`.
    refused: what these parts cannot identify. before, after: output -> open-loop agreement without and with correction.
    compatible: whether every output agrees after the correction; incompatible: the outputs that do not.
    states: per part, name -> (N,): u v w (m/s, relative to the air) phi theta psi (rad), V (m/s) alpha beta (rad) at
        the centre of gravity, ax ay az (m/s^2) there and p q r (rad/s), all corrected.
    noise: signal -> estimated sigma, in the signal's unit. gust_sigma: estimated turbulence, m/s.
    """

    parameters: dict[str, SensorError]
    covariance: Array
    refused: list[Refusal]
    before: dict[str, OutputFit]
    after: dict[str, OutputFit]
    compatible: bool
    incompatible: list[str]
    states: list[dict[str, Array]]
    noise: dict[str, float]
    gust_sigma: float
    layout: SensorMounting
    converged: bool
    warnings: list[str] = field(default_factory=list)


def compatibility(
    parts: FlightData | Sequence[FlightData],
    layout: SensorMounting | None = None,
    candidates: Sequence[str] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> CompatibilityResult:
    """Estimate the sensor errors common to all parts, and each part's motion.

    parts: uniform, without NaN in ax ay az p q r airspeed phi theta; alpha beta psi vn ve vd are used where present
        (NaN allowed there). Units m/s^2, rad/s, m/s, rad.
    layout: sensor positions; None puts all at the centre of gravity.
    candidates: names of PARAMETERS to consider; None takes all that the outputs present can bear on.
    priors: name -> (value, std) known from the bench; such a parameter starts there.
    Raises SignalError for missing or incomplete signals, EstimationError for unknown names or no convergence.
    """
    sequence = [parts] if isinstance(parts, FlightData) else list(parts)
    if not sequence:
        raise EstimationError("data compatibility needs at least one part of a flight")
    layout = layout or SensorMounting()
    prepared = [prepare_part(part, layout) for part in sequence]
    wanted = _candidates(prepared, candidates)
    setting = _setting(prepared, wanted, dict(priors or {}))
    theta = setting.mean.copy()
    # A first pass with moderate turbulence gives a trajectory near enough to judge what is identifiable.
    apply(prepared, run_pass(prepared, theta, replace(setting, gust_sigma=0.1), smooth=True))
    wanted, refused = _moving(prepared, wanted)
    setting = replace(setting, free=_mask(wanted))
    kept, unknowable = select(wanted, step(run_pass(prepared, theta, setting, slopes=True), theta, setting)[1])
    theta, setting, covariance, converged = _estimate(prepared, theta, replace(setting, free=_mask(kept)))
    # The real trajectory and noise are known only now; what they cannot bear is refused now.
    again, late = select(kept, covariance)
    again, stirred = _calm_only(again, setting)
    late += stirred
    if late:
        kept, theta = again, np.where(_mask(again), theta, setting.mean)
        theta, setting, covariance, converged = _estimate(prepared, theta, replace(setting, free=_mask(kept)))
    refused += unknowable + late
    while (wrong := most_implausible(kept, theta[_mask(kept)].tolist())) is not None and setting.gust_sigma > _CALM:
        # In calm air readings that agree are right however odd their sensor; in rough air the fit may have run away.
        # What such errors did to the trajectory and the noise goes with them.
        refused.append(wrong)
        kept = [name for name in kept if name != wrong.name]
        prepared = [prepare_part(part, layout) for part in sequence]
        setting = replace(_setting(prepared, kept, dict(priors or {})), gust_sigma=0.1)
        apply(prepared, run_pass(prepared, setting.mean, setting, smooth=True))
        theta, setting, covariance, converged = _estimate(prepared, setting.mean.copy(), setting)
    return _result(prepared, theta, setting, covariance, kept, refused, layout, converged)


def correct(data: FlightData, result: CompatibilityResult, part: int | None = None) -> FlightData:
    """Take the estimated errors off measured signals and move them to the centre of gravity.

    data: a part, or the whole flight, on its time base.
    part: index of this part in the estimation: alpha, beta, V, phi and theta are then the reconstructed ones, far
        less noisy than the corrected measurements.
    Returns the flight with `ax ay az p q r alpha beta airspeed phi theta vn ve vd` corrected and `V` (true airspeed,
    m/s) added; `notes["reference"]` is "centre of gravity".
    """
    if "reference" in data.notes:
        raise EstimationError(f"{data.name}: already corrected; give the signals as measured")
    values = {name: parameter.value for name, parameter in result.parameters.items()}
    columns = dict(data.columns)
    corrected = part_states(data, result.layout, values)
    if part is not None:
        if not 0 <= part < len(result.states) or result.states[part]["V"].size != data.time_s.size:
            raise EstimationError(f"{data.name}: part {part} is not one that the sensor errors were estimated from")
        corrected |= result.states[part]
    columns |= corrected
    columns["airspeed"] = corrected["V"] / result.layout.airspeed_factor
    notes = data.notes | {"reference": "centre of gravity"}
    return replace(data, columns=columns, notes=notes)


def moved_by(
    parts: Sequence[FlightData], result: CompatibilityResult, changes: Sequence[Mapping[str, float]]
) -> list[CompatibilityResult]:
    """The result as it would be had the sensor errors been others: for each of `changes` (name -> change) the motion
    smoothed anew, noise and turbulence as they were found.

    parts: those that `result` came from. The changes must be small: each is one pass about the motion without changes.
    """
    theta = np.array([result.parameters[name].value if name in result.parameters else 0.0 for name in PARAMETERS])
    noise = np.array([result.noise.get(name, 1.0) ** 2 for name in OUTPUTS])
    q_imu = np.array([result.noise[name] ** 2 for name in IMU])
    setting = ReconstructionSettings(noise, q_imu, result.gust_sigma, _mask([]), np.zeros(_COUNT), np.ones(_COUNT))
    prepared = [prepare_part(part, result.layout) for part in parts]
    for _ in range(_SETTLING_PASSES):
        apply(prepared, run_pass(prepared, theta, setting, smooth=True))
    settled = [(part.nominal, part.gusts) for part in prepared]
    moved = []
    for change in changes:
        for part, (nominal, gusts) in zip(prepared, settled, strict=True):
            part.nominal, part.gusts = nominal, gusts
        shifted = theta + np.array([change.get(name, 0.0) for name in PARAMETERS])
        apply(prepared, run_pass(prepared, shifted, setting, smooth=True))
        parameters = {n: replace(e, value=e.value + change.get(n, 0.0)) for n, e in result.parameters.items()}
        values = {name: error.value for name, error in parameters.items()}
        states = [part_states(part.data, result.layout, values) | part.reconstructed() for part in prepared]
        moved.append(replace(result, parameters=parameters, states=states))
    return moved


def _mask(names: Sequence[str]) -> Mask:
    return np.array([name in names for name in PARAMETERS], dtype=np.bool_)


def _candidates(parts: list[Part], candidates: Sequence[str] | None) -> list[str]:
    unknown = [name for name in candidates or () if name not in PARAMETERS]
    if unknown:
        raise EstimationError(f"unknown sensor error {', '.join(unknown)}; known are {', '.join(PARAMETERS)}")
    present = {name for part in parts for j, name in enumerate(OUTPUTS) if np.isfinite(part.z[:, j]).any()}
    needs = {"alpha": "alpha", "beta": "beta", "wind_north": "vn", "wind_east": "ve", "wind_down": "vd"}
    usable = []
    for name in PARAMETERS:
        output = needs.get(name, needs.get(name.split("_")[0]))
        if (candidates is None or name in candidates) and (output is None or output in present):
            usable.append(name)
    return usable


def _moving(parts: list[Part], names: list[str]) -> tuple[list[str], list[Refusal]]:
    """Scale factors of outputs that move by more than their own noise; the others' regressor is noise itself."""
    kept, refused = [], []
    for name in names:
        output = name.removesuffix("_scale")
        if output == name or output not in OUTPUTS:
            kept.append(name)
            continue
        j = OUTPUTS.index(output)
        travel = np.sqrt(np.mean([np.var(part.predicted()[:, j]) for part in parts]))
        noise = np.sqrt(np.mean([part.noise[j] ** 2 for part in parts]))
        if travel > noise:
            kept.append(name)
        else:
            reason = f"{output} moves by {travel:.2g} rms, no more than its noise of {noise:.2g}"
            refused.append(Refusal(name, reason, LIMITS[name].manoeuvre))
    return kept, refused


def _calm_only(names: list[str], setting: ReconstructionSettings) -> tuple[list[str], list[Refusal]]:
    """Refuse the airspeed's errors in turbulence.

    The aircraft answers a gust, so specific force is correlated with it; the kinematics alone then take part of that
    answer for an airspeed error (measured: a scale of -0.11 where 0 is true, in gusts of 0.3 m/s; with GPS velocity
    +0.10). The filter of the dynamics, which knows how the aircraft answers, may distinguish them.
    """
    if setting.gust_sigma <= _CALM:
        return names, []
    reason = f"turbulence of {setting.gust_sigma:.2g} m/s, which kinematics cannot distinguish from it"
    prior = {name for name in names if setting.std[PARAMETERS.index(name)] < LIMITS[name].std}
    stirred = [name for name in names if name.startswith("airspeed_") and name not in prior]
    refused = [Refusal(name, reason, LIMITS[name].manoeuvre) for name in stirred]
    return [name for name in names if name not in stirred], refused


def _setting(parts: list[Part], wanted: list[str], priors: dict[str, tuple[float, float]]) -> ReconstructionSettings:
    unknown = [name for name in priors if name not in PARAMETERS]
    if unknown:
        raise EstimationError(f"unknown sensor error {', '.join(unknown)}; known are {', '.join(PARAMETERS)}")
    mean = np.array([priors.get(name, (0.0, 0.0))[0] for name in PARAMETERS])
    std = np.array([priors[name][1] if name in priors else _DIFFUSE * LIMITS[name].std for name in PARAMETERS])
    length = np.array([part.z.shape[0] for part in parts], dtype=np.float64)
    noise = np.average([part.noise**2 for part in parts], axis=0, weights=length)
    q_imu = np.average([part.imu_noise**2 for part in parts], axis=0, weights=length)
    return ReconstructionSettings(noise, q_imu, 0.0, _mask(wanted), mean, std)


def _find_gust(parts: list[Part], theta: Array, setting: ReconstructionSettings) -> ReconstructionSettings:
    """Turbulence of greatest likelihood; calm air unless the data insist."""
    found: list[float] = []
    for gust in _GUSTS:
        found.append(run_pass(parts, theta, replace(setting, gust_sigma=gust)).likelihood)
        # Far beyond the likeliest and falling on, nothing likelier comes.
        if len(found) > 2 and found[-1] < found[-2] < found[-3] and found[-1] < max(found) - _GUST_LOST:
            break
    best = int(np.argmax(found))
    if best == 0 or found[best] - found[0] < _GUST_GAIN:
        return replace(setting, gust_sigma=0.0)
    sigma = _GUSTS[best]
    if 1 < best < len(found) - 1:
        curve = np.polyfit(np.log(_GUSTS[best - 1 : best + 2]), found[best - 1 : best + 2], 2)
        sigma = float(np.exp(-0.5 * curve[1] / curve[0])) if curve[0] < 0.0 else sigma
    return replace(setting, gust_sigma=sigma)


def _estimate(
    parts: list[Part], theta: Array, setting: ReconstructionSettings
) -> tuple[Array, ReconstructionSettings, Array, bool]:
    """Gauss-Newton, the noise re-estimated on the way: turbulence, output noise, then its colour."""
    converged = False
    stage = 0
    free = np.flatnonzero(setting.free)
    for _ in range(_MAX_ITERATIONS):
        change, covariance = step(run_pass(parts, theta, setting, slopes=True), theta, setting)
        theta = theta.copy()
        theta[free] += change
        solution = run_pass(parts, theta, setting, smooth=True)
        apply(parts, solution)
        if np.any(np.abs(change) > 0.05 * np.sqrt(np.diag(covariance))):
            continue
        if stage == 3:
            converged = True
            break
        if stage == 0:
            setting = _find_gust(parts, theta, setting)
        else:
            setting = replace(setting, noise=_renew_noise(setting.noise, solution, coloured=stage == 2))
        stage += 1
    return theta, setting, covariance, converged


def _renew_noise(noise: Array, solution: Solution, coloured: bool) -> Array:
    """Output noise variances from the innovations, never below the noise seen at high frequency.

    First by size (Mehra: mean(innovation^2 R / S) = R). Then, for outputs whose innovations stay
    correlated, by the spectral density at low frequency, so that the standard errors hold for coloured errors.
    """
    renewed = noise.copy()
    for j in range(noise.size):
        series = [v[:, j] / np.sqrt(s[:, j]) for v, s in zip(solution.innovations, solution.variances, strict=True)]
        series = [one[np.isfinite(one)] for one in series]
        count = sum(one.size for one in series)
        if count < 20:
            continue
        power = sum(float(np.sum(one**2)) for one in series) / count
        if not coloured:
            renewed[j] *= float(np.clip(power, 1.0, 1e4))
            continue
        lags = max(min(25, count // 10), 1)
        total = 1.0
        for lag in range(1, lags + 1):
            rho = sum(float(np.sum(one[lag:] * one[:-lag])) for one in series) / (count * power)
            if rho < 2.0 / np.sqrt(count):
                break
            total += 2.0 * rho
        renewed[j] *= float(np.clip(total, 1.0, 50.0))
    return renewed


def _result(
    parts: list[Part],
    theta: Array,
    setting: ReconstructionSettings,
    covariance: Array,
    kept: list[str],
    refused: list[Refusal],
    layout: SensorMounting,
    converged: bool,
) -> CompatibilityResult:
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    parameters = {
        name: SensorError(float(theta[PARAMETERS.index(name)]), float(s), LIMITS[name].unit)
        for name, s in zip(kept, std, strict=True)
    }
    before = open_loop_agreement(parts, np.zeros(_COUNT), measured_start=True)
    after = open_loop_agreement(parts, theta, measured_start=False)
    sigma = dict(zip(OUTPUTS, np.sqrt(setting.noise), strict=True))
    floor = {name: np.sqrt(np.mean([part.noise[j] ** 2 for part in parts])) for j, name in enumerate(OUTPUTS)}
    incompatible = [n for n, fit in after.items() if fit.tic > TIC_LIMIT and fit.rms > _SIGMA_LIMIT * floor[n]]
    warnings = [f"{name} disagrees with the other sensors: rms {after[name].rms:.3g}" for name in incompatible]
    if not converged:  # a search that has run away says nothing of any sensor
        words = f"data compatibility did not settle in {_MAX_ITERATIONS} iterations"
        warnings = [f"{words}, so whether the sensors agree is not known"]
    values = {name: parameter.value for name, parameter in parameters.items()}
    states = [part_states(part.data, layout, values) | part.reconstructed() for part in parts]
    noise = {name: float(value) for name, value in sigma.items() if name in after}
    noise |= dict(zip(("ax", "ay", "az", "p", "q", "r"), np.sqrt(setting.q_imu).tolist(), strict=True))
    return CompatibilityResult(
        *(parameters, covariance, refused, before, after, not incompatible, incompatible, states, noise),
        *(setting.gust_sigma, layout, converged, warnings),
    )


def check_compatibility(prepared: Sequence[Prepared]) -> CompatibilityResult:
    """Sensor errors common to all stretches of all flights."""
    return compatibility(in_even_air(prepared), prepared[0].layout)


def smoothed_states(record: Record, layout: SensorMounting, errors: dict[str, float]) -> dict[str, Array]:
    """Motion of a record reconstructed from its own measurements: errors taken off, smoothed without phase.

    A vane that is missing counts as zero angle.

    Parameters
    ----------
    record : Record
        One stretch of a flight, N samples.
    layout : SensorMounting
        Where the sensors sit and what they read.
    errors : dict[str, float]
        Sensor errors by name, each in the unit of `sysid.compatibility.selection.LIMITS`; those absent count as 0.

    Returns
    -------
    dict[str, Array], each of shape (N,)
        Name of STATES -> its time history: u v w [m/s], p q r [rad/s], phi theta psi [rad].

    References
    ----------
    Klein & Morelli, "Aircraft System Identification", chapter 10.
    R. V. Jategaonkar, "Flight Vehicle System Identification", chapter 10.
    """
    columns = {name: record.z[:, j] for j, name in enumerate(RECORD_OUTPUTS) if np.isfinite(record.z[:, j]).all()}
    columns["airspeed"] = columns["airspeed"] * airspeed_gain(record, layout)
    data = FlightData(record.flight, record.interval_s, record.time_s, columns)
    values = part_states(data, layout, errors)
    smooth = {
        name: fourier_smooth(values[name], record.interval_s).values for name in ("p", "q", "r", "V", "phi", "theta")
    }
    zero = np.zeros(record.length)
    alpha, beta = (
        fourier_smooth(values[name], record.interval_s).values if name in values else zero for name in ("alpha", "beta")
    )
    psi = fourier_smooth(np.unwrap(columns["psi"]), record.interval_s).values if "psi" in columns else zero
    speed = smooth.pop("V")
    states = {
        **smooth,
        "u": speed * np.cos(alpha) * np.cos(beta),
        "v": speed * np.sin(beta),
        "w": speed * np.sin(alpha) * np.cos(beta),
        "psi": psi,
    }
    return {name: states[name] for name in STATES}

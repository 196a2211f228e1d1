"""The identified model about steady flight: state space, modes and frequency responses, each with its uncertainty.

Standard errors follow from the coefficients' covariance to first order; a mode's from the derivative of its eigenvalue,
w' dA v / w' v with right and left eigenvectors v and w.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eig

from sim_vehicle.errors import TrimError, VehicleFileError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.state import PlantState, Trim
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.physics.layout import Aux
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.problem.model_structure import is_longitudinal, usual_size
from sysid.problem.vehicle_errors import under_error
from sysid.uncertainty.total import ErrorParts

Complex = NDArray[np.complex128]

STATES = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi")
INPUTS = ("de", "da", "dr", "throttle")
OUTPUTS = (*STATES, "ax", "ay", "az")

_LONGITUDINAL = slice(0, 4)
_STILL = np.zeros(3)
# Steps of differences, of a state and of a coefficient as a share of its size; a response below the last, of the
# largest, is rounding.
_STEP = 1e-5
_COEFFICIENT_STEP = 1e-4
# Of one standard deviation of what was taken as known.
_SOURCE_STEP = 1e-3
_ROUNDING = 1e-10
# Cosine between an eigenvalue's left and right eigenvector, 0 where it coincides with another one's and has no slope;
# rounding makes it the square root of its own size.
_COINCIDE = 1e-6
RESPONSES = (("de", "q"), ("de", "az"), ("de", "alpha"), ("da", "p"), ("dr", "r"), ("dr", "beta"))
RESPONSE_HZ = tuple(np.geomspace(0.05, 10.0, 41).tolist())


@dataclass(frozen=True)
class StateSpace:
    """dx/dt = A x + B u, y = C x + D u about trim: small changes of STATES, `inputs` and OUTPUTS, SI and radians.

    A: (8, 8). B: (8, I). C: (11, 8). D: (11, I); the arguments of `control.ss`. airspeed: m/s, density: kg/m3.
    trim: values of STATES and inputs in steady flight. inputs: INPUTS, without the throttle where the vehicle file does
    not say what thrust it gives, and the vehicle's controls of other names.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    airspeed: float
    density: float
    trim: Mapping[str, float]
    inputs: tuple[str, ...] = INPUTS

    def response(self, source: str, output: str, frequencies_hz: Array | Complex) -> Complex:
        """(F,) transfer function from an input to an output at frequencies in Hz; complex ones are s over 2 pi i."""
        j, i = self.inputs.index(source), OUTPUTS.index(output)
        eye = np.eye(len(STATES))
        s = 2j * math.pi * np.asarray(frequencies_hz)
        x = np.linalg.solve(s[:, None, None] * eye - self.A, np.broadcast_to(self.B[:, j, None], (s.size, 8, 1)))[
            ..., 0
        ]
        response = x @ self.C[i] + self.D[i, j]
        # Motion that the input does not cause at all is left as rounding errors of the motion that it does cause.
        return np.where(np.abs(response) > _ROUNDING * np.abs(x).max(axis=1), response, 0.0)

    def to_json(self) -> dict[str, Any]:
        """As results hold it."""
        matrices = {name: getattr(self, name).tolist() for name in "ABCD"}
        names = {"states": list(STATES), "inputs": list(self.inputs), "outputs": list(OUTPUTS)}
        return {**names, **matrices, "airspeed": self.airspeed, "air_density": self.density, "trim": dict(self.trim)}


@dataclass(frozen=True)
class Mode:
    """One mode of the motion; pairs of (value, standard error).

    eigenvalue: 1/s, the one with the positive imaginary part of a pair. frequency_hz: undamped natural frequency, and
    damping: its ratio, None for a mode that does not oscillate. time_constant_s: -1 / real part; negative where it
    grows.
    """

    name: str
    eigenvalue: complex
    frequency_hz: tuple[float, float] | None
    damping: tuple[float, float] | None
    time_constant_s: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """As results hold it."""

        def pair(entry: tuple[float, float] | None) -> dict[str, float] | None:
            return None if entry is None else {"value": entry[0], "std": entry[1]}

        return {
            "name": self.name,
            "eigenvalue": [self.eigenvalue.real, self.eigenvalue.imag],
            "frequency_hz": pair(self.frequency_hz),
            "damping_ratio": pair(self.damping),
            "time_constant_s": pair(self.time_constant_s),
        }


@dataclass(frozen=True)
class LinearModel:
    """The state space of a model with its derivatives with respect to the coefficients.

    names: coefficients, and what was taken as known, in standard deviations, (P,). covariance: (P, P). slopes: by each
    of them the derivatives of (A, B, C, D).
    known: whether longitudinal and lateral motion are known at all.
    """

    system: StateSpace
    names: tuple[str, ...]
    covariance: Array
    slopes: tuple[tuple[Array, Array, Array, Array], ...]
    known: tuple[bool, bool]

    def modes(self) -> list[Mode]:
        """Modes of the motion that is known, longitudinal ones first, each group fastest first.

        Modes that coincide, as rolling and banking do without any roll damping, are left out (`left_out`).
        """
        values, right, left, longitudinal, alone = self._eigen()
        modes = []
        for is_known, chosen, namer in (
            (self.known[0], longitudinal, _longitudinal_names),
            (self.known[1], ~longitudinal, _lateral_names),
        ):
            places = [i for i in np.flatnonzero(chosen & alone) if values[i].imag >= 0.0]
            places.sort(key=lambda i: -abs(values[i]))
            if is_known:
                names = namer([complex(values[i]) for i in places])
                modes += [
                    self._mode(name, values[i], right[:, i], left[i]) for name, i in zip(names, places, strict=True)
                ]
        return modes

    def left_out(self) -> list[str]:
        """Which modes of motion that is known are left out and why, a line each."""
        _, _, _, longitudinal, alone = self._eigen()
        groups = (("longitudinal", self.known[0], longitudinal), ("lateral", self.known[1], ~longitudinal))
        return [
            f"{np.count_nonzero(chosen & ~alone)} {name} modes coincide, as they do where coefficients that were"
            " refused count as 0, and are left out: excite what was refused"
            for name, is_known, chosen in groups
            if is_known and np.any(chosen & ~alone)
        ]

    def _eigen(self) -> tuple[Complex, Complex, Complex, NDArray[np.bool_], NDArray[np.bool_]]:
        """Eigenvalues (8,), right eigenvectors in columns and left ones in rows with w v = 1, which are longitudinal,
        and which coincide with no other.
        """
        found: Any = eig(self.system.A, left=True, right=True)
        values, columns, right = found
        left = columns.conj().T
        cosines = np.sum(left * right.T, axis=1)
        alone = np.abs(cosines) > _COINCIDE
        left = left / np.where(alone, cosines, 1.0)[:, None]
        shares = np.abs(right * left.T)
        size = np.where(alone, shares, np.abs(right))
        return values, right, left, size[_LONGITUDINAL].sum(axis=0) > size[4:].sum(axis=0), alone

    def _mode(self, name: str, value: complex, right: Complex, left: Complex) -> Mode:
        slopes = np.array([left @ dA @ right for dA, _, _, _ in self.slopes], dtype=np.complex128).reshape(-1)

        def std(gradient: Array) -> float:
            return math.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0))

        real, size = float(value.real), abs(value)
        constant = (-1.0 / real, std(slopes.real / real**2)) if real else (math.inf, math.inf)
        if value.imag == 0.0:
            return Mode(name, complex(value), None, None, constant)
        growth = (slopes * np.conj(value)).real / size  # of the modulus
        frequency = (float(size) / (2.0 * math.pi), std(growth / (2.0 * math.pi)))
        damping = (-real / float(size), std(-slopes.real / size + real * growth / size**2))
        return Mode(name, complex(value), frequency, damping, constant)

    def response(self, source: str, output: str, frequencies_hz: Array) -> tuple[Complex, Array, Array]:
        """(F,) transfer function, and the standard errors of its gain, dB, and phase, rad; NaN where there is none."""
        base = self.system.response(source, output, frequencies_hz)
        base = np.where(base == 0.0, np.nan, base)
        rows = []
        for slope in self.slopes:
            moved = [m + _COEFFICIENT_STEP * d for m, d in zip(_matrices(self.system), slope, strict=True)]
            other = replace(self.system, A=moved[0], B=moved[1], C=moved[2], D=moved[3])
            rows.append(np.log(other.response(source, output, frequencies_hz) / base) / _COEFFICIENT_STEP)
        gradient = np.array(rows, dtype=np.complex128).reshape(len(rows), base.size)
        gain = np.einsum("if,ij,jf->f", gradient.real, self.covariance, gradient.real)
        phase = np.einsum("if,ij,jf->f", gradient.imag, self.covariance, gradient.imag)
        return base, 20.0 / math.log(10.0) * np.sqrt(np.maximum(gain, 0.0)), np.sqrt(np.maximum(phase, 0.0))

    def responses_json(self) -> list[dict[str, Any]]:
        """The usual frequency responses of the motion that is known, as results hold them."""
        frequencies = np.array(RESPONSE_HZ)
        found = []
        for source, output in RESPONSES:
            if not self.known[0 if source == "de" else 1]:
                continue
            base, gain_std, phase_std = self.response(source, output, frequencies)
            found.append(
                {
                    "input": source,
                    "output": output,
                    "frequency_hz": frequencies.tolist(),
                    "gain_db": (20.0 * np.log10(np.abs(base))).tolist(),
                    "gain_std_db": gain_std.tolist(),
                    "phase_rad": np.angle(base).tolist(),
                    "phase_std_rad": phase_std.tolist(),
                }
            )
        return found


def _matrices(system: StateSpace) -> tuple[Array, Array, Array, Array]:
    return system.A, system.B, system.C, system.D


def linearise(
    vehicle: Vehicle,
    model: Model,
    airspeed: float,
    density: float,
    errors: ErrorParts | None = None,
) -> LinearModel:
    """The model about steady level flight, with the standard errors of its coefficients.

    What was taken as known moves the coefficients and the aircraft together: a flight shows Cm over Iyy, and the motion
    is as well known as that, however little is known of Iyy.

    A coefficient that was refused counts by the mean and standard error of its estimate; without one it counts as 0,
    with its usual size as standard error.

    Parameters
    ----------
    vehicle : Vehicle
        The vehicle that flies.
    model : Model
        Coefficients and effects, with standard errors.
    airspeed : float
        True airspeed of the steady flight, m/s.
    density : float
        Air density, kg/m^3.
    errors : ErrorParts, optional
        Errors of the M estimates that the model flies by, dimensionless; without them the standard errors of the model
        stand alone.

    Returns
    -------
    LinearModel
        State space about trim [SI, rad], its derivatives with respect to the coefficients, and their covariance.

    Raises
    ------
    SimVehicleError
        Where the vehicle cannot be trimmed there.
    """
    motion_known = {
        longitudinal: any(
            entry.value is not None
            for name, entry in model.coefficients.items()
            if is_longitudinal(name) == longitudinal
        )
        for longitudinal in (True, False)
    }
    whole = replace(
        model,
        coefficients={
            name: _stand_in(name, entry, motion_known[is_longitudinal(name)]) if entry.value is None else entry
            for name, entry in model.coefficients.items()
        },
    )
    there = replace(vehicle, environment=replace(vehicle.environment, air_density=density))
    try:
        system, trim = _state_space(there, whole, airspeed, density)
    except (TrimError, VehicleFileError):
        # Whatever gave the thrust that was measured: only its line matters here, and the throttle is no input.
        there = replace(there, propulsion=_any_thrust(there))
        system, trim = _state_space(there, whole, airspeed, density)
        others = [j for j, name in enumerate(system.inputs) if name != "throttle"]
        inputs = tuple(system.inputs[j] for j in others)
        system = replace(system, inputs=inputs, B=system.B[:, others], D=system.D[:, others])
    names = [name for name, entry in whole.coefficients.items() if entry.std]
    spread = np.diag([float(whole.coefficients[name].std or 0.0) ** 2 for name in names])
    places: list[int] = []
    here: list[int] = []
    if errors is not None:
        known = {name: i for i, name in enumerate(errors.known.names)}
        here = [i for i, name in enumerate(names) if name in known and model.coefficients[name].flown is not None]
        places = [known[names[i]] for i in here]
        spread[np.ix_(here, here)] = errors.known.covariance[np.ix_(places, places)]
    # Both sides of a difference take the same steps, so that what a coefficient does not touch cancels to the last bit.
    base, _ = _state_space(there, whole, airspeed, density, trim)
    kept = [base.inputs.index(name) for name in system.inputs]

    def slope(vehicle: Vehicle, changed: Model, density: float, step: float) -> tuple[Array, Array, Array, Array]:
        moved, _ = _state_space(vehicle, changed, airspeed, density, trim)
        pairs = zip(_matrices(moved), _matrices(base), strict=True)
        a, b, c, d = ((after - before) / step for after, before in pairs)
        return a, b[:, kept], c, d[:, kept]

    slopes = []
    for name in names:
        value = whole.values()[name]
        step = _COEFFICIENT_STEP * max(abs(value), usual_size(name))
        slopes.append(slope(there, whole.with_coefficient(name, value + step), density, step))
    sources = {} if errors is None else errors.shifts
    for source, shift in sources.items():
        changed = whole
        for i, place in zip(here, places, strict=True):
            moved_to = whole.values()[names[i]] + _SOURCE_STEP * float(shift[place])
            changed = changed.with_coefficient(names[i], moved_to)
        other, denser = under_error(there, density, source, _SOURCE_STEP)
        other = replace(other, environment=replace(there.environment, air_density=denser))
        slopes.append(slope(other, changed, denser, _SOURCE_STEP))
    return LinearModel(
        system, (*names, *sources), block_diag(spread, np.eye(len(sources))), tuple(slopes),
        (motion_known[True], motion_known[False]),
    )  # fmt: skip


def _any_thrust(vehicle: Vehicle) -> Propulsion:
    """Enough thrust for any steady flight, on the vehicle's own thrust line where it has one."""
    enough = 3.0 * vehicle.mass.mass * vehicle.environment.gravity
    if vehicle.propulsion is None:
        return Propulsion(max_thrust=enough)
    return replace(vehicle.propulsion, max_thrust=enough, CT=(), CQ=())


def _stand_in(name: str, entry: Coefficient, motion_known: bool) -> Coefficient:
    """What stands for a coefficient that was refused: the mean of its estimate, or 0 within its usual size.

    Where nothing is known of a motion, its modes are not given, and usual coefficients only let it be trimmed.
    """
    if motion_known and entry.mean is not None:
        return Coefficient(entry.mean, entry.mean_std)
    return Coefficient(0.0, usual_size(name)) if motion_known else Coefficient(usual_size(name))


def _state_space(
    vehicle: Vehicle, model: Model, airspeed: float, density: float, near: Trim | None = None
) -> tuple[StateSpace, Trim]:
    """The model about level flight, and that flight; near: a trim of nearly the same model."""
    plant = Plant(vehicle, model)
    trim = solve_trim(plant, airspeed, 0.0, near=near)
    work = trim.state.copy()
    outputs = dict(zip(("V", "alpha", "beta", "p", "q", "r", "phi", "theta"), plant.outputs(trim.state), strict=False))
    x0 = np.array([outputs[name] for name in STATES])
    u0 = np.asarray(trim.state.surfaces[: len(INPUTS) + len(vehicle.named_inputs)], dtype=np.float64)
    matrix_x = np.empty((len(STATES) + 3, len(STATES)))
    # What one of several motors does goes by their laws, and the throttle is that of all.
    every = (*INPUTS, *vehicle.named_inputs)
    places = [j for j, name in enumerate(every) if name not in (*vehicle.motors, *MOTOR_MOMENTS)]
    inputs = tuple(every[j] for j in places)
    matrix_u = np.empty((len(STATES) + 3, len(inputs)))
    for matrix, at, moving in ((matrix_x, x0, list(range(len(STATES)))), (matrix_u, u0, places)):
        for j, place in enumerate(moving):
            sides = []
            for sign in (1.0, -1.0):
                moved = at.copy()
                moved[place] += sign * _STEP
                x, u = (moved, u0) if matrix is matrix_x else (x0, moved)
                sides.append(_rates(plant, work, x, u))
            matrix[:, j] = (sides[0] - sides[1]) / (2.0 * _STEP)
    n = len(STATES)
    C = np.vstack((np.eye(n), matrix_x[n:]))
    D = np.vstack((np.zeros((n, len(inputs))), matrix_u[n:]))
    trimmed = {**dict(zip(STATES, x0.tolist(), strict=True)), **dict(zip(inputs, u0[places].tolist(), strict=True))}
    return StateSpace(matrix_x[:n], matrix_u[:n], C, D, airspeed, density, trimmed, inputs), trim


def _rates(plant: Plant, state: PlantState, x: Array, u: Array) -> Array:
    """Rates of STATES (8,) and ax ay az (3,) in still air at sea level, the heading north; `state` is overwritten."""
    V, alpha, q, theta, beta, p, r, phi = x
    state.x[:], state.surfaces[:] = 0.0, u
    velocity = np.array([math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)]) * V
    state.x[3:6] = velocity
    state.x[6:10] = quaternion(phi, theta, 0.0)
    state.x[10:13] = p, q, r
    state.x[13] = alpha  # a lift that lags is taken as settled
    rate = plant.rates(state, _STILL, _STILL)
    du, dv, dw = rate[3:6]
    dV = float(velocity @ rate[3:6]) / V
    in_plane = math.hypot(velocity[0], velocity[2])
    dalpha = (velocity[0] * dw - velocity[2] * du) / in_plane**2
    dbeta = (V * dv - velocity[1] * dV) / (V * in_plane)
    dtheta = q * math.cos(phi) - r * math.sin(phi)
    dphi = p + math.tan(theta) * (q * math.sin(phi) + r * math.cos(phi))
    return np.array([dV, dalpha, rate[11], dtheta, dbeta, rate[10], rate[12], dphi, *state.work[Aux.ax : Aux.az + 1]])


def _longitudinal_names(values: Sequence[complex]) -> list[str]:
    """Names of the longitudinal modes, fastest first."""
    kinds = ["pair" if value.imag else "root" for value in values]
    if kinds == ["pair", "pair"]:
        return ["short period", "phugoid"]
    if kinds == ["root", "root", "pair"]:
        return ["short period, faster part", "short period, slower part", "phugoid"]
    if kinds == ["pair", "root", "root"]:
        return ["short period", "phugoid, faster part", "phugoid, slower part"]
    return ["third oscillation" if kind == "pair" else f"pitch root {i + 1}" for i, kind in enumerate(kinds)]


def _lateral_names(values: Sequence[complex]) -> list[str]:
    """Names of the lateral modes, fastest first."""
    pairs = [i for i, value in enumerate(values) if value.imag]
    roots = [i for i, value in enumerate(values) if not value.imag]
    names = [""] * len(values)
    if len(pairs) == 1 and len(roots) == 2:
        names[pairs[0]], names[roots[0]], names[roots[1]] = "Dutch roll", "roll", "spiral"
        return names
    if len(pairs) == 2:
        return ["Dutch roll", "roll and spiral together"]
    return [f"lateral mode {i + 1}" for i in range(len(values))]

"""Amplitudes of a multisine's harmonics: what each costs in travel, what information it gives, and the best division.

A harmonic k of an input with amplitude A_k and transfer function G gives, over N samples of outputs with noise sigma,

    M_k = A_k^2 N / 2 sum over outputs of Re(dG/dtheta (dG/dtheta)^H) / sigma^2

and costs the share of the travel allowed that it takes up. Powers that maximise log det(sum M_k) for a given cost are
found by the multiplicative algorithm: each is multiplied by its information per cost, tr(M^-1 M_k) / c_k, over the mean
(Mehra, IEEE TAC 19(6), 1974; Silvey, Titterington & Torsney, Comm. Statist. A 7(14), 1978).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.identification.linear_model import INPUTS, OUTPUTS, LinearModel, linearise
from sysid.problem.model_structure import usual_size

Complex = NDArray[np.complex128]

# Outputs whose travel an input of each group is held by.
GROUPS = {"elevator": ("alpha", "V", "theta"), "aileron": ("beta", "phi"), "rudder": ("beta", "phi")}
_PEAK = 2.5  # of a response of many harmonics over its rms
_INPUT_PEAK = 1.15 * math.sqrt(2.0)  # of an input with optimised phases over its rms
_SWEEPS = 300  # of the search for phases with low peaks
FLAT_SHARE = 0.2  # left to all harmonics alike, so that a wrong prior model is not believed blindly


@dataclass(frozen=True)
class Limits:
    """How far a manoeuvre may take the aircraft from trim.

    alpha, beta, bank, pitch: rad. airspeed: share of the trim speed. surface: travel of a surface, rad.
    """

    alpha: float = math.radians(5.0)
    beta: float = math.radians(5.0)
    airspeed: float = 0.15
    bank: float = math.radians(30.0)
    pitch: float = math.radians(15.0)
    surface: float = math.radians(6.0)

    def of_outputs(self, speed: float) -> dict[str, float]:
        """Travel allowed by output of the linear model; `speed` is that of trim, m/s."""
        return {
            "alpha": self.alpha, "beta": self.beta, "V": self.airspeed * speed, "phi": self.bank, "theta": self.pitch,
        }  # fmt: skip


def prior_linear(vehicle: Vehicle, model: Model, names: Sequence[str], airspeed: float, density: float) -> LinearModel:
    """The linearised prior model with its slopes by the coefficients `names`."""
    values = model.flown()
    entries = {name: Coefficient(values.get(name, 0.0), usual_size(name)) for name in names}
    kept = {name: Coefficient(value) for name, value in values.items() if name in model.coefficients}
    return linearise(vehicle, replace(model, coefficients=kept | entries), airspeed, density)


def responses(linear: LinearModel, axis: str, frequencies_hz: Array) -> tuple[Complex, Complex]:
    """Transfer functions from a control: (F, 11) to OUTPUTS, and (P, F, 11) their derivatives by the coefficients."""
    system = linear.system
    j = INPUTS.index({"elevator": "de", "aileron": "da", "rudder": "dr", "throttle": "throttle"}[axis])
    inverse = np.linalg.inv(2j * math.pi * frequencies_hz[:, None, None] * np.eye(8) - system.A)
    states = inverse @ system.B[:, j]
    gains = states @ system.C.T + system.D[:, j]
    slopes = np.empty((len(linear.slopes), frequencies_hz.size, len(OUTPUTS)), dtype=np.complex128)
    for i, (dA, dB, dC, dD) in enumerate(linear.slopes):
        moved = np.einsum("fij,fj->fi", inverse, states @ dA.T + dB[:, j])
        slopes[i] = moved @ system.C.T + states @ dC.T + dD[:, j]
    return gains, slopes


def costs(linear: LinearModel, axis: str, frequencies_hz: Array, limits: Limits) -> Array:
    """Share of the travel allowed that each harmonic of amplitude 1 rad takes up, squared, (F,).

    Shares of the surface and of every output of the axis' group are added, so that a sum of 1 keeps within all.
    """
    gains, _ = responses(linear, axis, frequencies_hz)
    allowed = limits.of_outputs(linear.system.airspeed)
    share = np.full(frequencies_hz.size, (_INPUT_PEAK / limits.surface) ** 2)
    for output in GROUPS[axis]:
        share = share + (_PEAK / allowed[output]) ** 2 * np.abs(gains[:, OUTPUTS.index(output)]) ** 2
    return np.asarray(0.5 * share)


def flat_amplitudes(
    linear: LinearModel, harmonics: Mapping[str, Sequence[int]], length: float, limits: Limits
) -> dict[str, Array]:
    """Equal amplitudes of all harmonics of each axis, rad; axes of one group share its travel."""
    found = {}
    for axis, numbers in harmonics.items():
        sharing = sum(GROUPS[other] == GROUPS[axis] for other in harmonics)
        total = float(costs(linear, axis, np.asarray(numbers) / length, limits).sum())
        found[axis] = np.full(len(numbers), 1.0 / math.sqrt(sharing * total))
    return found


def optimal_amplitudes(
    linear: LinearModel,
    harmonics: Mapping[str, Sequence[int]],
    length: float,
    limits: Limits,
    noise: Mapping[str, float],
    samples: int,
    flat_share: float = FLAT_SHARE,
) -> dict[str, Array]:
    """D-optimal amplitudes of the harmonics of each axis, rad, at the same cost as the flat ones.

    noise: 1 sigma by channel. samples: in the excitation. flat_share: of the cost, left to all harmonics alike.
    Priors of the coefficients' usual size keep it regular.
    """
    sigma = np.array([noise["airspeed" if name == "V" else name] for name in OUTPUTS])
    size = np.array([usual_size(name) for name in linear.names])
    information, price, group = [], [], []
    for axis, numbers in harmonics.items():
        frequencies = np.asarray(numbers) / length
        _, slopes = responses(linear, axis, frequencies)
        scaled = slopes / sigma * size[:, None, None]
        information.append(0.5 * samples * np.einsum("pfo,qfo->fpq", scaled, scaled.conj()).real)
        price.append(costs(linear, axis, frequencies, limits))
        group += [GROUPS[axis]] * len(numbers)
    each = np.concatenate(information) / np.concatenate(price)[:, None, None]
    members = [np.array([entry == chosen for entry in group]) for chosen in dict.fromkeys(group)]
    flat = np.concatenate([a**2 for a in flat_amplitudes(linear, harmonics, length, limits).values()])
    start = flat * np.concatenate(price)
    share = start.copy()
    for _ in range(_SWEEPS):
        whole = np.eye(size.size) + np.einsum("k,kpq->pq", share, each)
        per_harmonic = np.einsum("pq,kqp->k", np.linalg.inv(whole), each)
        for member in members:
            share[member] *= per_harmonic[member] / float(share[member] @ per_harmonic[member])
    share = (1.0 - flat_share) * share + flat_share * start
    amplitudes = np.sqrt(share / np.concatenate(price))
    edges = np.cumsum([len(numbers) for numbers in harmonics.values()])[:-1]
    return dict(zip(harmonics, np.split(amplitudes, edges), strict=True))

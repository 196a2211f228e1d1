"""Kinematic relations between the sensors in closed form, and how likely they make the readings of a flight.

Every measured angle and velocity is compared with the integral of what drives it by the other sensors (Klein &
Morelli, "Aircraft System Identification", chapter 10):

    phi   = int p + tan(theta) (q sin(phi) + r cos(phi))     u = int r v - q w - g sin(theta) + ax
    theta = int q cos(phi) - r sin(phi)                      v = int p w - r u + g cos(theta) sin(phi) + ay
    psi   = int (q sin(phi) + r cos(phi)) / cos(theta)       w = int q u - p v + g cos(theta) cos(phi) + az

and the velocity over ground with the integral of the specific force in earth axes. Nothing is simulated, so a
hypothesis about the data costs milliseconds. What varies slower than SLOW_HZ (drift, wind) is projected out;
what remains is whitened by an autoregression, so that log likelihoods of different readings of the same data can be
compared. Parameters multiply the prediction, never the noisy measurement: else the smallest scale would win.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from sim_vehicle.jit import jit
from sysid.arrays import Array
from sysid.compatibility.ekf_part import part_states
from sysid.numerics.autoregression import apply_whitening_filter, autoregression
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightData
from sysid.signals.sensor_layout import SensorLayout

SLOW_HZ = 0.15
GROUND = ("vn", "ve", "vd")
AIR = ("u", "v", "w")
DENSE = ("phi", "theta", "psi", *AIR)
# Output -> the relations that it is the measured side of.
MEASURED_IN: dict[str, tuple[str, ...]] = {
    "phi": ("phi",), "theta": ("theta",), "psi": ("psi",), "airspeed": ("u", "v", "w"), "alpha": ("w",),
    "beta": ("v",), "vn": ("vn",), "ve": ("ve",), "vd": ("vd",),
}  # fmt: skip
USED = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "airspeed", "alpha", "beta")
# Column that holds one number: by how much, s, velocities over ground come late.
GROUND_DELAY = "ground_delay_s"
# Relations that gusts do not enter.
CALM_RELATIONS = ("phi", "theta", "psi", *GROUND)
_ORDER = 4  # of the autoregression
_ROUNDS = 3
_LEAST_GROUND = 12  # GPS samples
_LEVEL_STD = 1.0  # m/s^2: mean specific force that sensor errors may feign
_STEP = 1e-3
# Weights of four samples in the integral of the cubic through them, between the first two and between the middle ones.
_END, _OUTER, _INNER = (9.0 / 24.0, 19.0 / 24.0, -5.0 / 24.0, 1.0 / 24.0), -1.0 / 24.0, 13.0 / 24.0
_FEWEST = 4
_UNKNOWN = 1e3  # prior standard deviation of an extra parameter: none that matters
# Sensor errors that are no mistake: name -> prior standard deviation, SI.
BIASES = {
    "accel_bias_x": 1.0, "accel_bias_y": 1.0, "accel_bias_z": 1.0,
    "gyro_bias_p": 0.05, "gyro_bias_q": 0.05, "gyro_bias_r": 0.05,
    "alpha_bias": 0.1, "beta_bias": 0.1, "phi_bias": 0.05, "theta_bias": 0.05,
}  # fmt: skip
SCALES = {"alpha": 0.3, "beta": 0.3, "airspeed": 0.15, "theta": 0.03}

Columns = Mapping[str, Array]
Slopes = list[dict[str, Array]]


@dataclass(frozen=True)
class Fit:
    """How well the relations hold for one reading of the data.

    cost: negative log likelihood, constants left out. values, std: estimates of the extra parameters and their
    standard errors. sigma: relation -> rms of the whitened residual. scales: scale errors of SCALES as estimated.
    """

    cost: float
    values: Array
    std: Array
    sigma: dict[str, float]
    scales: dict[str, float]


@jit
def integrate(rates: Array, interval_s: float, out: Array) -> None:
    """Integrals (K, N) of (K, N) samples from the first one on, by the cubic through the four nearest ones, N >= 4."""
    last = rates.shape[1] - 1
    for k in range(rates.shape[0]):
        rate, total = rates[k], 0.0
        out[k, 0] = 0.0
        for i in range(1, last + 1):
            if i == 1:
                step = _END[0] * rate[0] + _END[1] * rate[1] + _END[2] * rate[2] + _END[3] * rate[3]
            elif i == last:
                step = _END[0] * rate[i] + _END[1] * rate[i - 1] + _END[2] * rate[i - 2] + _END[3] * rate[i - 3]
            else:
                step = _OUTER * (rate[i - 2] + rate[i + 1]) + _INNER * (rate[i - 1] + rate[i])
            total += interval_s * step
            out[k, i] = total


class Window:
    """One stretch of a flight whose relations are examined.

    data: uniform, without NaN in IMU, attitude and airspeed; alpha beta psi vn ve vd where present. Raises ValueError
    where there are fewer samples than `integrate` takes.
    """

    def __init__(self, data: FlightData, layout: SensorLayout) -> None:
        # A length whose Fourier transform is quick; at most a few per cent of the stretch are left out.
        size = data.time_s.size
        while size > 1 and next_fast_len(size - 1, real=True) != size - 1:
            size -= 1
        if size < _FEWEST:
            raise ValueError(f"{data.name}: {data.time_s.size} samples are fewer than an integral takes")
        data = data.window(0, size)
        self.data, self.layout = data, layout
        self.interval_s, self.size = data.interval_s, data.time_s.size
        whole = {name: name in data and bool(np.isfinite(data[name]).all()) for name in ("alpha", "beta", "psi")}
        self.has_alpha, self.has_beta, self.has_psi = whole["alpha"], whole["beta"], whole["psi"]
        ground = [n for n in GROUND if whole["psi"] and n in data and np.isfinite(data[n]).sum() >= _LEAST_GROUND]
        self.air = [*(("u", "w") if self.has_alpha else ()), *(("v",) if self.has_alpha and self.has_beta else ())]
        self.relations = ("phi", "theta", *(("psi",) if self.has_psi else ()), *self.air, *ground)
        self.rows = {
            name: np.flatnonzero(np.isfinite(data[name])) if name in GROUND else np.arange(self.size)
            for name in self.relations
        }
        count = max(2, int(np.ceil(2.0 * self.size * self.interval_s * SLOW_HZ)))
        place = (np.arange(self.size) + 0.5) / self.size
        slow = np.column_stack([place, *(np.cos(np.pi * k * place) for k in range(count + 1))])
        self._dense = [name for name in self.relations if name not in GROUND]
        self._slow = np.asfortranarray(np.linalg.qr(slow)[0])
        self._slow_ground = {name: np.linalg.qr(slow[self.rows[name]])[0] for name in ground}
        self._sines: dict[str, tuple[Array, Array, Array]] = {}
        self._given: tuple[Columns, tuple[dict[str, Array], dict[str, Array]]] | None = None

    def smoothed(self, columns: Columns) -> dict[str, Array]:
        """The signals without their white noise; those that are sparse as they are."""
        found = dict(columns)
        for name in USED:
            if name in columns and np.isfinite(columns[name]).all():
                found[name] = fourier_smooth(columns[name], self.interval_s).values
        return found

    def states(self, columns: Columns, errors: Mapping[str, float]) -> dict[str, Array]:
        """Signals with sensor errors taken off, at the centre of gravity."""
        data = FlightData(self.data.name, self.interval_s, self.data.time_s, dict(columns))
        return part_states(data, self.layout, errors)

    def fast(self, values: Columns) -> dict[str, Array]:
        """Relation -> (rows,) of its (N,) values at its samples, slow motions taken out."""
        dense = self.quick(np.stack([values[name] for name in self._dense]))
        found = dict(zip(self._dense, dense, strict=True))
        for name, slow in self._slow_ground.items():
            here = values[name][self.rows[name]]
            found[name] = here - slow @ (slow.T @ here)
        return found

    def quick(self, values: Array) -> Array:
        """(K, N) values, slow motions taken out."""
        return np.asarray(values - (values @ self._slow) @ self._slow.T)

    def measured(self, s: Columns, columns: Columns) -> dict[str, Array]:
        """Relation -> (N,) measured side."""
        found = {"phi": s["phi"], "theta": s["theta"]}
        if self.air:
            sa, ca = self._sine("alpha", s["alpha"])
            sb, cb = self._sine("beta", s["beta"]) if self.has_beta else (np.zeros(self.size), np.ones(self.size))
            ahead = s["V"] * cb
            found |= {"u": ahead * ca, "v": s["V"] * sb, "w": ahead * sa}
        return found | {name: columns[name] for name in ("psi", *GROUND) if name in self.relations}

    def rates(self, s: Columns, measured: Columns) -> dict[str, Array]:
        """Relation -> (N,) rate of change by the other sensors."""
        (sf, cf), (st, ct) = self._sine("phi", s["phi"]), self._sine("theta", s["theta"])
        p, q, r, gravity = s["p"], s["q"], s["r"], self.layout.gravity
        turn = (q * sf + r * cf) / ct
        found = {"phi": p + st * turn, "theta": q * cf - r * sf, "psi": turn}
        if self.air:
            u, v, w, down = measured["u"], measured["v"], measured["w"], gravity * ct
            found |= {
                "u": r * v - q * w - gravity * st + s["ax"],
                "v": p * w - r * u + down * sf + s["ay"],
                "w": q * u - p * v + down * cf + s["az"],
            }
        if self.relations[-1] in GROUND:
            found |= self._in_earth_axes((s["ax"], s["ay"], s["az"]), s, measured)
            found["vd"] = found["vd"] + gravity
        return {name: found[name] for name in self.relations}

    def through_air(self, s: Columns, measured: Columns) -> dict[str, Array]:
        """Relation of GROUND that the air data tell -> (N,) velocity through the air in earth axes."""
        if self.relations[-1] not in GROUND:
            return {}
        still = np.zeros(self.size)
        u, v, w = (measured.get(name, still) for name in AIR) if self.air else (s["V"], still, still)
        found = self._in_earth_axes((u, v, w), s, measured)
        if not self.air:
            # Without vanes nobody knows whether what is pitched up climbs, and what yaws may slip.
            found = {name: found[name] - self.quick(found[name][None])[0] for name in ("vn", "ve")}
        return {name: one for name, one in found.items() if name in self.relations}

    def _in_earth_axes(self, body: tuple[Array, Array, Array], s: Columns, measured: Columns) -> dict[str, Array]:
        """North, east and down, by the names of GROUND, of a vector in body axes, by the measured attitude."""
        x, y, z = body
        (sf, cf), (st, ct) = self._sine("phi", s["phi"]), self._sine("theta", s["theta"])
        sp, cp = self._sine("psi", measured["psi"])
        lifted = sf * y + cf * z
        ahead, aside = ct * x + st * lifted, cf * y - sf * z
        return {"vn": cp * ahead - sp * aside, "ve": sp * ahead + cp * aside, "vd": ct * lifted - st * x}

    def _sine(self, name: str, angle: Array) -> tuple[Array, Array]:
        """Sine and cosine of an angle; the last of each name are kept, since most readings share their angles."""
        kept = self._sines.get(name)
        if kept is None or kept[0] is not angle:
            kept = self._sines[name] = (angle, np.sin(angle), np.cos(angle))
        return kept[1], kept[2]

    def gaps(self, columns: Columns, errors: Mapping[str, float]) -> dict[str, Array]:
        """Relation -> (rows,) measured minus integrated, slow motions taken out."""
        return self.gaps_of(self.states(columns, errors), columns)

    def gaps_of(self, s: Columns, columns: Columns) -> dict[str, Array]:
        """The same from the states `s` of the columns."""
        measured = self.measured(s, columns)
        predicted = self._integrals(self.rates(s, measured), columns)
        return self.fast({n: measured[n] - predicted[n] for n in self.relations})

    def predictions(self, columns: Columns) -> tuple[dict[str, Array], dict[str, Array]]:
        """Relation -> (N,) rate of change, and integrated side, from its first sample on."""
        s = self.states(columns, {})
        rates = self.rates(s, self.measured(s, columns))
        return rates, self._integrals(rates, columns)

    def given(self, columns: Columns) -> tuple[dict[str, Array], dict[str, Array]]:
        """The predictions; the last are kept, since many derivatives are taken of the same columns."""
        if self._given is None or self._given[0] is not columns:
            self._given = (columns, self.predictions(columns))
        return self._given[1]

    def _integrals(self, rates: Columns, columns: Columns) -> dict[str, Array]:
        stacked = np.stack([rates[name] for name in self.relations])
        integrals = np.empty_like(stacked)
        integrate(stacked, self.interval_s, integrals)
        found = dict(zip(self.relations, integrals, strict=True))
        late = columns.get(GROUND_DELAY)
        if late is not None:
            time = self.data.time_s
            found |= {n: np.interp(time - float(late), time, found[n]) for n in GROUND if n in found}
        return found

    def level(self, s: Columns) -> Array:
        """(3,) mean of what specific force the attitude and the motion `s` leave unexplained, m/s^2."""
        (sf, cf), (st, ct) = self._sine("phi", s["phi"]), self._sine("theta", s["theta"])
        gravity, turning = self.layout.gravity, s["V"]
        sums = np.array([
            np.sum(s["ax"]) - gravity * np.sum(st),
            np.sum(s["ay"]) + gravity * (ct @ sf) - turning @ s["r"],
            np.sum(s["az"]) + gravity * (ct @ cf) + turning @ s["q"],
        ])  # fmt: skip
        return np.asarray(sums / self.size)


def scale_slope(window: Window, columns: Columns, name: str) -> dict[str, Array]:
    """Derivative of every gap by a scale error of one signal (true = reading / (1 + scale)); 0 where it is not read."""
    if name not in columns:
        return {key: np.zeros(window.rows[key].size) for key in window.relations}
    _, before = window.given(columns)
    _, after = window.predictions({**columns, name: columns[name] / (1.0 + _STEP)})
    slope = {key: (before[key] - after[key]) / _STEP for key in before}
    for key in MEASURED_IN.get(name, ()):
        if key in slope:
            slope[key] = slope[key] - before[key]
    return window.fast(slope)


def delay_slope(window: Window, columns: Columns, names: Sequence[str]) -> dict[str, Array]:
    """Derivative of every gap by a delay, s, of some signals (true(t) = reading(t + delay)), of those that are read."""
    names = [name for name in names if name in columns]
    if not names:
        return {key: np.zeros(window.rows[key].size) for key in window.relations}
    rates, before = window.given(columns)
    ahead = {n: columns[n] + _STEP * np.gradient(columns[n], window.interval_s) for n in names if n not in GROUND}
    _, after = window.predictions({**columns, **ahead})
    slope = {key: (before[key] - after[key]) / _STEP for key in before}
    for name in names:
        for key in MEASURED_IN.get(name, ()):
            # Airspeed and vanes share a relation: the share of each is that of its own motion.
            if key in slope and not (key == "w" and name == "airspeed") and not (key == "v" and name == "airspeed"):
                slope[key] = slope[key] + rates[key]
    return window.fast(slope)


class KinematicResiduals:
    """All relations of all windows for one reading of the data: gaps and what sensor errors would do to them."""

    def __init__(self, windows: Sequence[Window], columns: Sequence[Columns]) -> None:
        self.windows, self.columns = windows, columns
        states = [w.states(c, {}) for w, c in zip(windows, columns, strict=True)]
        self.base = [w.gaps_of(s, c) for w, s, c in zip(windows, states, columns, strict=True)]
        # Regressors without the noise of the measurements, which they would else explain.
        self.smooth = [w.smoothed(c) for w, c in zip(windows, columns, strict=True)]
        base = [w.gaps(c, {}) for w, c in zip(windows, self.smooth, strict=True)]
        self.slopes: list[Slopes] = []
        for name in BIASES:
            moved = [w.gaps(c, {name: _STEP}) for w, c in zip(windows, self.smooth, strict=True)]
            self.slopes.append([
                {k: (m[k] - b[k]) / _STEP for k in b} for m, b in zip(moved, base, strict=True)
            ])  # fmt: skip
        stds = list(BIASES.values())
        self._scaled = [name for name in SCALES if any(name in c for c in columns)]
        for name, std in SCALES.items():
            if name in self._scaled:
                self.slopes.append([scale_slope(w, c, name) for w, c in zip(windows, self.smooth, strict=True)])
                stds.append(std)
        self.prior = np.array(stds) ** -2.0
        self.level_cost = level_cost(windows, states)
        self._null: dict[Sequence[str] | None, tuple[Fit, _Whitened]] = {}

    def null(self, relations: tuple[str, ...] | None = None) -> Fit:
        """The fit without extra parameters; relations: which count, None takes all."""
        return self._null_fit(relations)[0]

    def filters(self) -> dict[str, Array]:
        """Relation -> whitening filter of the fit without extra parameters."""
        white, sigma = self._null_fit(None)[1], self.null().sigma
        return {name: taps * sigma[name] for name, taps in white.filters.items()}

    def _null_fit(self, relations: tuple[str, ...] | None) -> tuple[Fit, _Whitened]:
        if relations not in self._null:
            self._null[relations] = self._solve((), relations)
        return self._null[relations]

    def score(self, extra: Slopes, relations: tuple[str, ...] | None = None) -> tuple[float, float]:
        """One Gauss-Newton step for one extra parameter from the fit without it: (value, standard error).

        extra: per window the derivative of every gap by it.
        """
        _, white = self._null_fit(relations)
        slope = white.whitened(self, extra)
        across = white.rows.T @ slope
        left = float(slope @ slope - across @ np.linalg.solve(white.information, across)) + _UNKNOWN**-2.0
        return -float(slope @ white.residual) / left, left**-0.5

    def fit(self, extra: Slopes, relations: tuple[str, ...] | None = None) -> Fit:
        """Sensor errors and one extra parameter by weighted least squares, whitened anew."""
        return self._solve((extra,), relations)[0]

    def _solve(self, extra: Sequence[Slopes], relations: Sequence[str] | None) -> tuple[Fit, _Whitened]:
        slopes = [*self.slopes, *extra]
        count = len(slopes)
        prior = np.concatenate((self.prior, np.full(count - self.prior.size, _UNKNOWN**-2.0)))
        names = [n for n in dict.fromkeys(n for b in self.base for n in b) if relations is None or n in relations]
        stacked = {
            name: [
                (b[name], np.column_stack([one[k][name] for one in slopes]))
                for k, b in enumerate(self.base)
                if name in b
            ]
            for name in names
        }
        theta = np.zeros(count)
        for turn in range(_ROUNDS + 1):
            cost, sigma, filters = 0.5 * float(prior @ theta**2) + self.level_cost, {}, {}
            targets, rows = [], []
            for name, parts in stacked.items():
                left = [gap + row @ theta for gap, row in parts]
                taps = autoregression(left, 1 if name in GROUND else _ORDER)
                white = np.concatenate([apply_whitening_filter(one, taps) for one in left])
                sigma[name] = max(float(np.sqrt(np.mean(white**2))), 1e-9)
                filters[name] = taps / sigma[name]
                cost += white.size * float(np.log(sigma[name]))
                targets.append(white / sigma[name])
                rows += [apply_whitening_filter(row, filters[name]) for _, row in parts]
            stack, target = np.concatenate(rows), np.concatenate(targets)
            information = np.diag(prior) + stack.T @ stack
            if turn < _ROUNDS:
                theta = theta - np.linalg.solve(information, stack.T @ target + prior * theta)
        std = np.sqrt(np.diag(np.linalg.inv(information)))
        first = self.prior.size
        scales = dict(zip(self._scaled, theta[len(BIASES) : first].tolist(), strict=True))
        fit = Fit(cost, theta[first:], std[first:], sigma, scales)
        return fit, _Whitened(filters, stack, target, information)


@dataclass(frozen=True)
class _Whitened:
    """A fit in units of its noise: filters per relation, rows (M, P) and residual (M,), information (P, P)."""

    filters: dict[str, Array]
    rows: Array
    residual: Array
    information: Array

    def whitened(self, comparison: KinematicResiduals, slope: Slopes) -> Array:
        """(M,) one more regressor, in the order of the rows."""
        parts = [
            apply_whitening_filter(slope[k][name], taps)
            for name, taps in self.filters.items()
            for k, base in enumerate(comparison.base)
            if name in base
        ]
        return np.concatenate(parts)


def quick_cost(windows: Sequence[Window], columns: Sequence[Columns], filters: Mapping[str, Array]) -> float:
    """Negative log likelihood without estimating any sensor error: enough to rank readings that differ much.

    filters: relation -> whitening filter, the same for all readings that are compared.
    """
    states = [w.states(c, {}) for w, c in zip(windows, columns, strict=True)]
    gaps = [w.gaps_of(s, c) for w, s, c in zip(windows, states, columns, strict=True)]
    cost = level_cost(windows, states)
    for name in dict.fromkeys(name for one in gaps for name in one):
        white = np.concatenate([apply_whitening_filter(one[name], filters[name]) for one in gaps if name in one])
        cost += white.size * 0.5 * float(np.log(max(white @ white / white.size, 1e-18)))
    return cost


def level_cost(windows: Sequence[Window], states: Sequence[Columns]) -> float:
    """Negative log likelihood of the mean specific force that the motion leaves unexplained."""
    levels = [w.level(s) for w, s in zip(windows, states, strict=True)]
    level = np.average(levels, axis=0, weights=[float(w.size) for w in windows])
    return 0.5 * float(np.sum((level / _LEVEL_STD) ** 2))

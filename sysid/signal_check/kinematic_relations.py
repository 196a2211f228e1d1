"""Kinematic relations between the sensors in closed form.

Every measured angle and velocity is compared with the integral of what drives it by the other sensors (Klein &
Morelli, "Aircraft System Identification", chapter 10):

    phi   = int p + tan(theta) (q sin(phi) + r cos(phi))     u = int r v - q w - g sin(theta) + ax
    theta = int q cos(phi) - r sin(phi)                      v = int p w - r u + g cos(theta) sin(phi) + ay
    psi   = int (q sin(phi) + r cos(phi)) / cos(theta)       w = int q u - p v + g cos(theta) cos(phi) + az

and the velocity over ground with the integral of the specific force in earth axes. Nothing is simulated, so a
reading of the data costs milliseconds. What varies slower than SLOW_HZ (drift, wind) is projected out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.fft import next_fast_len

from sim_vehicle.jit import jit
from sysid.arrays import Array
from sysid.compatibility.ekf_part import part_states
from sysid.signals.flight import FlightData
from sysid.signals.sensor_mounting import SensorMounting

SLOW_HZ = 0.15  # below which drift and wind are projected out
GROUND = ("vn", "ve", "vd")
AIR = ("u", "v", "w")
_LEAST_GROUND = 12  # GPS samples
# Weights of four samples in the integral of the cubic through them, between the first two and between the middle ones.
_END, _OUTER, _INNER = (9.0 / 24.0, 19.0 / 24.0, -5.0 / 24.0, 1.0 / 24.0), -1.0 / 24.0, 13.0 / 24.0
_FEWEST = 4

Columns = Mapping[str, Array]


@jit
def integrate(rates: Array, interval_s: float, out: Array) -> None:
    """Integrate uniform samples from the first one on, by the cubic through the four nearest ones.

    Parameters
    ----------
    rates : Array, shape (K, N)
        K signals of N >= 4 uniform samples, each in its own unit per second.
    interval_s : float
        Sampling interval, s.
    out : Array, shape (K, N)
        Result, written over: the integrals, 0 at the first sample, in the signals' units.
    """
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

    def __init__(self, data: FlightData, layout: SensorMounting) -> None:
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

    def states(self, columns: Columns) -> dict[str, Array]:
        """Signals at the centre of gravity."""
        data = FlightData(self.data.name, self.interval_s, self.data.time_s, dict(columns))
        return part_states(data, self.layout, {})

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
        """Relation of GROUND that the air data give -> (N,) velocity through the air in earth axes."""
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

    def gaps(self, s: Columns, columns: Columns) -> dict[str, Array]:
        """Relation -> (rows,) measured minus integrated, slow motions taken out. s: the columns' states."""
        measured = self.measured(s, columns)
        predicted = self._integrals(self.rates(s, measured))
        return self.fast({n: measured[n] - predicted[n] for n in self.relations})

    def _integrals(self, rates: Columns) -> dict[str, Array]:
        stacked = np.stack([rates[name] for name in self.relations])
        integrals = np.empty_like(stacked)
        integrate(stacked, self.interval_s, integrals)
        return dict(zip(self.relations, integrals, strict=True))

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

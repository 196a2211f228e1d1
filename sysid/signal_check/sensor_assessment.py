"""What the data compatibility check says of each sensor, in one short sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.compatibility.reconstruction import CompatibilityResult, SensorError
from sysid.signal_check.fault import Mistake

_IMU_BIAS = {
    "ax": "accel_bias_x", "ay": "accel_bias_y", "az": "accel_bias_z",
    "p": "gyro_bias_p", "q": "gyro_bias_q", "r": "gyro_bias_r",
}  # fmt: skip
_WIND = {"vn": "wind_north", "ve": "wind_east", "vd": "wind_down"}
# An error counts as seen from two standard errors on: 95 %.
_SEEN = 2.0


@dataclass(frozen=True)
class Verdict:
    """One sensor's: status is ok, corrected, mistake or unknown."""

    signal: str
    verdict: str
    status: str

    def to_json(self) -> dict[str, str]:
        """As results hold it."""
        return {"signal": self.signal, "verdict": self.verdict, "status": self.status}


def verdicts(result: CompatibilityResult, mistakes: Sequence[Mistake] = (), corrects: bool = True) -> list[Verdict]:
    """One verdict for every sensor that took part. corrects: whether the estimate takes the errors off the signals."""
    names = [*_IMU_BIAS, *result.after]
    return [_verdict(name, result, mistakes, corrects) for name in names]


def _verdict(name: str, result: CompatibilityResult, mistakes: Sequence[Mistake], corrects: bool) -> Verdict:
    wrong = [one for one in mistakes if name in one.signals]
    if wrong:
        return Verdict(name, "; ".join(one.sentence for one in wrong), "mistake")
    if not result.converged:  # where a search has run away, its errors and what is left are no sensor's
        return Verdict(name, f"{name}: not judged, since the data compatibility check did not settle", "unknown")
    if name in result.incompatible:
        gap, noise = result.after[name].rms, result.noise.get(name, math.nan)
        return Verdict(name, f"{name} disagrees with the other sensors by {gap:.2g} (noise {noise:.2g})", "mistake")
    bias, scale = _IMU_BIAS.get(name, f"{name}_bias"), f"{name}_scale"
    clauses = []
    if (found := result.parameters.get(scale)) is not None and _seen(found):
        clauses.append(f"reads {_plus_minus(1.0 + found.value, found.std)} of true")
    if (found := result.parameters.get(bias)) is not None and _seen(found):
        way = "high" if found.value > 0.0 else "low"
        size, std, unit = abs(found.value), found.std, found.unit
        if unit.startswith("rad"):
            size, std, unit = math.degrees(size), math.degrees(std), unit.replace("rad", "deg")
        clauses.append(f"reads {_plus_minus(size, std)} {unit} {way}")
    if clauses and not corrects:
        return Verdict(name, f"{name} {' and '.join(clauses)} by the kinematics alone: left as read", "unknown")
    if clauses:
        return Verdict(name, f"{name} {' and '.join(clauses)}: corrected", "corrected")
    unidentified = [entry for entry in result.refused if entry.name in (bias, scale, _WIND.get(name))]
    if unidentified and name in _IMU_BIAS:
        return Verdict(name, f"{name}: its bias is not identifiable: {unidentified[0].reason}", "unknown")
    if _WIND.get(name) in {entry.name for entry in unidentified}:
        return Verdict(name, f"{name}: without the wind it says nothing of the air data", "unknown")
    return Verdict(name, f"{name} agrees within its noise", "ok")


def _seen(error: SensorError) -> bool:
    return abs(error.value) > _SEEN * error.std


def _plus_minus(value: float, std: float) -> str:
    """Both with the digits that the standard error allows."""
    digits = max(0, 1 - math.floor(math.log10(std))) if 0.0 < std < math.inf else 3
    return f"{value:.{digits}f} ± {std:.{digits}f}"

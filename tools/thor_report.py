"""What the flight log of the Ultra Stick 25e told, beside the model published for it: a table and a picture.

    python tools/thor_report.py RESULT.json thor.mcap --vehicle thor.toml --image real-flight.png

RESULT.json comes from `gcs identify thor.mcap --vehicle thor.toml --method ee -o RESULT.json`. The picture shows the
coefficients with their 95 % intervals as shares of the published ones, what bands of frequency tell of four of them,
and how much of the measured moments the commands explain when they are taken as so much later than the log has them.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt

from gcs.analysis.postflight import read_flights
from gcs.errors import GcsError
from gcs.text.intervals import interval
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightData
from sysid.signals.resampling import resample

Array = NDArray[np.float64]

MAIN = (
    "CL_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip
BY_BAND = ("Cm_de", "Cm_q", "Cl_da", "Cl_p")
DELAYS = np.arange(0, 9) * 0.02
BAND_HZ = 6.0


def smooth(values: Array, interval_s: float) -> Array:
    """Without phase, up to BAND_HZ."""
    b, a = butter(3, 2.0 * BAND_HZ * interval_s)
    return np.asarray(filtfilt(b, a, values))


def explained(data: FlightData, vehicle: Vehicle, density: float) -> dict[str, list[float]]:
    """Share of rolling and pitching acceleration that motion and commands explain, per delay of the commands."""
    flown = np.isfinite(data["de"])
    step = data.interval_s
    part = {
        name: smooth(data[name][flown], step) for name in ("p", "q", "r", "alpha", "beta", "airspeed", "de", "da", "dr")
    }
    V = part["airspeed"] * np.sqrt(1.225 / density)
    moments = {"Cl": (np.gradient(part["p"], step), ("beta", "p", "r"), ("da", "dr"))}
    moments["Cm"] = (np.gradient(part["q"], step), ("alpha", "q"), ("de",))
    shares: dict[str, list[float]] = {}
    edge = round(2.0 / step)
    inside = slice(edge, -edge)
    for axis, (turn, motion, surfaces) in moments.items():
        y = (turn / V**2)[inside]
        for delay in DELAYS:
            late = [np.roll(part[name], round(delay / step)) for name in surfaces]
            terms = [part[name] / (V if name in ("p", "q", "r") else 1.0) for name in motion] + late
            X = np.column_stack([np.ones(y.size), *(term[inside] for term in terms)])
            left = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
            shares.setdefault(axis, []).append(float(1.0 - left.var() / y.var()))
    return shares


def table(found: dict[str, Any], published: dict[str, float]) -> list[str]:
    """Lines of a Markdown table: every coefficient that is published or was asked for."""
    lines = ["| coefficient | flight | 95 % interval | published |", "|---|---|---|---|"]
    for name, entry in found.items():
        stated = f"{published[name]:.4g}" if name in published else ""
        if "refused" in entry:
            lines.append(f"| {name} | refused | {entry['refused']} | {stated} |")
        else:
            low, high = interval(entry) or (np.nan, np.nan)
            lines.append(f"| {name} | {entry['value']:.4g} | {low:.4g} … {high:.4g} | {stated} |")
    return lines


def bands_of(result: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """What each band of frequency told of a coefficient; nothing where the result has no such block."""
    told = result["regression"][name.split("_")[0]]["terms"][name]["bands"]
    return [] if told is None else list(told["estimates"])


def band_table(result: dict[str, Any], published: dict[str, float]) -> list[str]:
    """Lines of a Markdown table: the coefficients of the picture's middle panel, band by band."""
    edges = [one["band_hz"] for one in bands_of(result, BY_BAND[0])]
    lines = ["| | " + " | ".join(f"{low:.2f} to {high:.2f} Hz" for low, high in edges) + " | published |"]
    lines.append("|---" * (len(edges) + 2) + "|")
    for name in BY_BAND:
        told = " | ".join(f"{one['value']:.3g} ± {one['std']:.2g}" for one in bands_of(result, name))
        lines.append(f"| {name} | {told} | {published[name]:.4g} |")
    return lines


def draw_bands(middle: Any, result: dict[str, Any], published: dict[str, float]) -> None:
    """Coefficients over frequency, as shares of the published ones."""
    for name in BY_BAND:
        told = bands_of(result, name)
        shares = [one["value"] / published[name] for one in told]
        bars = [1.96 * one["std"] / abs(published[name]) for one in told]
        middle.errorbar([float(np.mean(one["band_hz"])) for one in told], shares, bars, fmt="o-", ms=3, label=name)
    middle.axhline(1.0, color="black", lw=1.0)
    middle.set_xlabel("middle of the band, Hz")
    middle.set_ylabel("told by that band / published")
    middle.legend(fontsize=8)


def draw(result: dict[str, Any], published: dict[str, float], shares: dict[str, list[float]], image: Path) -> None:
    """The three panels."""
    found = result["model"]["coefficients"]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14.0, 4.2), width_ratios=(2.0, 1.2, 1.2))
    draw_bands(middle, result, published)
    for place, name in enumerate(MAIN):
        entry = found.get(name, {"refused": ""})
        if "refused" in entry:
            left.text(0.02, place, "refused", va="center", fontsize=8, transform=left.get_yaxis_transform())
            continue
        low, high = sorted(bound / published[name] for bound in interval(entry) or (np.nan, np.nan))
        left.plot([low, high], [place, place], color="tab:blue", lw=2.0)
        left.plot(entry["value"] / published[name], place, "o", color="tab:blue", ms=4)
    left.axvline(1.0, color="black", lw=1.0)
    left.axvspan(0.7, 1.3, color="0.92")
    left.set_yticks(range(len(MAIN)), MAIN)
    left.set_ylim(len(MAIN) - 0.5, -0.5)
    left.set_xlabel("flight / published; bars: 95 % intervals; grey: 30 % about the published value")
    for axis, values in shares.items():
        right.plot(1e3 * DELAYS, values, "o-", ms=3, label=f"{axis} from the log")
    right.set_xlabel("commands later than logged, ms")
    right.set_ylabel("share of the moment explained")
    right.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(image, dpi=110)


def main() -> int:
    """Print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--vehicle", type=Path, required=True)
    parser.add_argument("--image", type=Path, required=True)
    options = parser.parse_args()
    try:
        vehicle = load_vehicle(str(options.vehicle))
        data = resample(read_flights([options.recording], vehicle)[0])
    except GcsError as error:
        print(f"thor_report.py: {error}", file=sys.stderr)
        return 1
    result = json.loads(options.result.read_text(encoding="utf-8"))
    published = read_model("ultrastick25e").values()
    shares = explained(data, vehicle, vehicle.environment.air_density or 1.225)
    print("\n".join([*table(result["model"]["coefficients"], published), "", *band_table(result, published)]))
    for axis, values in shares.items():
        print(axis, ", ".join(f"{1e3 * delay:.0f} ms {share:.2f}" for delay, share in zip(DELAYS, values, strict=True)))
    draw(result, published, shares, options.image)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Figures of an identification's result: fits, residuals, noise spectra, frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gcs.report import histories
from gcs.report.svg import LIMIT, MEASURED, PREDICTED, Drawing, pages
from sim_vehicle.model.aerodynamic_terms import AXES
from sysid.arrays import Array

Result = Mapping[str, Any]
_Z95 = 1.96
_SYMBOLS = {axis: f"$C_{{{axis[1:]}}}$" for axis in AXES}
# Consecutive points further apart than this many usual steps belong to different stretches.
_BREAK = 8.0
_SPECTRA_IN_A_ROW = 4
_FEWEST_CORRELATED = 2
# From this coherence on a measured response is shown (Tischler & Remple, section 7.6).
_COHERENT = 0.6


def every(result: Result) -> list[Drawing]:
    """All figures of a result of schema identification/1, in the order of the report."""
    series = result.get("series") or {}
    return [
        *correlations(result["model"]), *repeatability(result.get("repeatability") or {}),
        *noise_spectra(result.get("noise_spectrum") or []), *histories.every(series),
        *flights(series),
        *residual_statistics(series), *bode(result.get("frequency_responses") or []),
    ]  # fmt: skip


def correlations(model: Result) -> list[Drawing]:
    """How the errors of the estimates depend on each other."""
    found = model.get("correlation")
    if not found or len(found["names"]) < _FEWEST_CORRELATED:
        return []
    side = 1.6 + 0.19 * len(found["names"])
    caption = "Correlation of the estimates' errors, -1 (blue) to 1 (red): what is dark is known together alone"
    return [Drawing("correlation", caption, (min(side + 0.6, 7.4), min(side, 6.8)), partial(_heat, found=found))]


def repeatability(found: Result) -> list[Drawing]:
    """Every coefficient by each of several flights alone, beside the scatter that their bars promise."""
    if not found:
        return []
    caption = (
        "Each dot is a flight by itself: its distance from the mean of all flights, in standard errors; 95 % belong in"
        " the grey band. At the right the scatter over the bars: 1 is right, 0.8 to 1.25 usual of ten flights"
    )
    return [Drawing("repeatability", caption, (7.4, 0.9 + 0.17 * len(found)), partial(_repeatability, found=found))]


def flights(series: Result) -> list[Drawing]:
    """Per flight measured against predicted coefficients, and the residual over time and over angle of attack."""
    found = []
    for index, flight in enumerate(series.get("flights", [])):
        axes, name = _ordered(flight["axes"]), flight["flight"]
        if not axes:
            continue
        height = 1.35 * len(axes) + 0.5
        found += [
            Drawing(f"fit{index}", f"Flight {name}: coefficients measured (blue) and predicted by the model (red) over "
                   "time", (7.4, height), partial(_fit, axes=axes)),
            Drawing(f"residual{index}", f"Flight {name}: residual, measured minus predicted, over time", (7.4, height),
                   partial(_residual, axes=axes)),
            Drawing(f"alpha{index}", f"Flight {name}: residual over angle of attack", (7.4, 2.1 * -(-len(axes) // 3)),
                   partial(_over_alpha, axes=axes)),
        ]  # fmt: skip
    return found


def residual_statistics(series: Result) -> list[Drawing]:
    """Autocorrelation and distribution of the coefficients' residuals, and autocorrelation of the outputs'."""
    found = []
    residuals = _ordered(series.get("residuals", {}))
    if residuals:
        size = (7.4, 2.1 * -(-len(residuals) // 3))
        found += [
            Drawing("acf", "Autocorrelation of the coefficients' residuals; dashed: 95 % limits of a white series",
                   size, partial(_autocorrelations, residuals=residuals)),
            Drawing("histogram", "Distribution of the coefficients' residuals; curve: normal density of the same mean "
                   "and standard deviation", size, partial(_histograms, residuals=residuals)),
        ]  # fmt: skip
    outputs = series.get("outputs", {})
    if outputs:
        size = (7.4, 1.7 * -(-len(outputs) // 4))
        found.append(
            Drawing("outputs", "Autocorrelation of the estimation's output residuals; dashed: 95 % limits of a white "
                   "series", size, partial(_autocorrelations, residuals=outputs, columns=4))
        )  # fmt: skip
    return found


def noise_spectra(spectra: list[Result]) -> list[Drawing]:
    """Per flight the spectrum of what the simulation leaves of each output, and the sensor's own noise."""
    found = []
    for index, flight in enumerate(dict.fromkeys(one["flight"] for one in spectra)):
        mine = [one for one in spectra if one["flight"] == flight]
        caption = f"Flight {flight}: amplitude spectrum of what the simulation leaves of each output, which weighs it; "
        if any(one["sensor"] is not None for one in mine):
            caption += (
                "dashed: the sensor's own noise by the vehicle file. What lies above it is gusts, vibration, or what "
                "the model lacks"
            )
        else:
            caption += "the vehicle file gives no sensor's noise that it could be compared with"
        size = (7.4, 2.0 * -(-len(mine) // _SPECTRA_IN_A_ROW))
        found.append(Drawing(f"noise{index}", caption, size, partial(_noise_spectra, spectra=mine)))
    return found


def bode(responses: list[Result]) -> list[Drawing]:
    """Gain and phase with 95 % bands, one figure for each input."""
    found = []
    for source in dict.fromkeys(one["input"] for one in responses):
        mine = [one for one in responses if one["input"] == source]
        measured = any("measured" in one for one in mine)
        caption = f"Frequency responses to {source}, with 95 % bands; gain in dB of output (SI units, rad) per rad" + (
            f"; dots: as the flight shows them where the coherence is above {_COHERENT}, and the coherence"
            if measured
            else ""
        )
        height = 5.8 if measured else 4.4
        found.append(Drawing(f"bode-{source}", caption, (7.4, height), partial(_bode, responses=mine)))
    return found


def _repeatability(made: Figure, found: Result) -> None:
    plot, names = made.subplots(), list(found)
    plot.axvspan(-_Z95, _Z95, color=LIMIT, alpha=0.15)
    for row, name in enumerate(names):
        value, std = np.array([(one["value"], one["std"]) for one in found[name]["flights"].values()]).T
        mean = np.average(value, weights=1.0 / std**2)
        plot.plot((value - mean) / std, np.full(value.size, row), ".", color=MEASURED, alpha=0.8)
        plot.annotate(
            f"{found[name]['ratio']:.2f}", (1.01, row), xycoords=("axes fraction", "data"), fontsize=7, va="center"
        )
    plot.set_yticks(range(len(names)), names, fontsize=7)
    plot.set_ylim(len(names) - 0.5, -0.5)
    plot.set_xlabel("distance from the mean of all flights, standard errors")


def _heat(made: Figure, found: Result) -> None:
    plot, names = made.subplots(), found["names"]
    image = plot.imshow(np.array(found["matrix"]), cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    plot.set_xticks(range(len(names)), names, rotation=90, fontsize=6)
    plot.set_yticks(range(len(names)), names, fontsize=6)
    plot.grid(visible=False)
    made.colorbar(image, shrink=0.7)


def _with_breaks(entry: Result, values: Array) -> tuple[Array, Array]:
    """Time and values with a gap where one stretch ends and another begins."""
    time = np.array(entry["time_s"])
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    places = np.flatnonzero(steps > _BREAK * max(usual, 1e-9)) + 1
    return np.insert(time, places, np.nan), np.insert(values, places, np.nan)


def _ordered(axes: Result) -> dict[str, Any]:
    """Forces before moments, as everywhere."""
    return {axis: axes[axis] for axis in AXES if axis in axes}


def _stack(made: Figure, axes: Result) -> list[tuple[Any, str, Result]]:
    plots = pages(made, len(axes), 1)
    for plot in plots[1:]:
        plot.sharex(plots[0])
    plots[-1].set_xlabel("time, s")
    for plot, axis in zip(plots, axes, strict=True):
        plot.set_ylabel(_SYMBOLS.get(axis, axis))
    return [(plot, axis, entry) for plot, (axis, entry) in zip(plots, axes.items(), strict=True)]


def _fit(made: Figure, axes: Result) -> None:
    for plot, _, entry in _stack(made, axes):
        plot.plot(*_with_breaks(entry, np.array(entry["measured"])), color=MEASURED, label="measured")
        plot.plot(*_with_breaks(entry, np.array(entry["predicted"])), color=PREDICTED, label="predicted")
    made.axes[0].legend(loc="upper right", ncols=2)


def _residual(made: Figure, axes: Result) -> None:
    for plot, _, entry in _stack(made, axes):
        plot.plot(*_with_breaks(entry, _difference(entry)), color=MEASURED)
        plot.axhline(0.0, color="black", linewidth=0.6)


def _over_alpha(made: Figure, axes: Result) -> None:
    for plot, (axis, entry) in zip(pages(made, len(axes), min(3, len(axes))), axes.items(), strict=True):
        plot.plot(np.degrees(entry["alpha"]), _difference(entry), ".", color=MEASURED, markersize=2.5)
        plot.axhline(0.0, color="black", linewidth=0.6)
        plot.set_title(_SYMBOLS.get(axis, axis), fontsize=9)
        plot.set_xlabel("α, deg")


def _difference(entry: Result) -> Array:
    return _floats(entry["measured"]) - _floats(entry["predicted"])


def _autocorrelations(made: Figure, residuals: Result, columns: int = 3) -> None:
    plots = pages(made, len(residuals), min(columns, len(residuals)))
    for plot, (name, entry) in zip(plots, residuals.items(), strict=True):
        rho = np.array(entry["autocorrelation"])
        plot.vlines(np.arange(rho.size) * entry["lag_step_s"], 0.0, rho, color=MEASURED, linewidth=1.0)
        for limit in (-entry["limit"], entry["limit"]):
            plot.axhline(limit, color=LIMIT, linestyle="--", linewidth=0.8)
        plot.axhline(0.0, color="black", linewidth=0.6)
        plot.set_title(_SYMBOLS.get(name, name), fontsize=9)
        plot.set_xlabel("lag, s")


def _histograms(made: Figure, residuals: Result) -> None:
    plots = pages(made, len(residuals), min(3, len(residuals)))
    for plot, (axis, entry) in zip(plots, residuals.items(), strict=True):
        low, high, counts = (entry["histogram"][key] for key in ("low", "high", "counts"))
        width = (high - low) / len(counts)
        middle = low + width * (np.arange(len(counts)) + 0.5)
        plot.bar(middle, np.array(counts) / (sum(counts) * width), width, color=MEASURED, alpha=0.6)
        x = np.linspace(low, high, 200)
        density = np.exp(-0.5 * ((x - entry["mean"]) / entry["std"]) ** 2) / (entry["std"] * np.sqrt(2.0 * np.pi))
        plot.plot(x, density, color=PREDICTED)
        plot.set_title(_SYMBOLS.get(axis, axis), fontsize=9)
        plot.set_xlabel("residual")
        plot.set_yticks([])
        plot.locator_params(axis="x", nbins=3)


def _noise_spectra(made: Figure, spectra: list[Result]) -> None:
    for plot, one in zip(pages(made, len(spectra), min(_SPECTRA_IN_A_ROW, len(spectra))), spectra, strict=True):
        plot.loglog(one["frequency_hz"], _floats(one["density"]), color=MEASURED)
        if one["sensor"] is not None:
            plot.axhline(one["sensor"], color=LIMIT, linestyle="--", linewidth=0.8)
        plot.set_title(f"{one['output']}, {one['unit'].replace('^2', '²').replace('sqrt(Hz)', '√Hz')}", fontsize=9)
        plot.set_xlabel("frequency, Hz")


def _bode(made: Figure, responses: list[Result]) -> None:
    rows = 3 if any("measured" in one for one in responses) else 2
    plots = made.subplots(rows, len(responses), squeeze=False, sharex=True)
    for column, one in enumerate(responses):
        hz = np.array(one["frequency_hz"])
        gain, phase = _floats(one["gain_db"]), np.degrees(np.unwrap(_floats(one["phase_rad"])))
        for plot, values, std in (
            (plots[0, column], gain, _floats(one["gain_std_db"])),
            (plots[1, column], phase, np.degrees(_floats(one["phase_std_rad"]))),
        ):
            plot.fill_between(hz, values - _Z95 * std, values + _Z95 * std, color=PREDICTED, alpha=0.3, linewidth=0.0)
            plot.semilogx(hz, values, color=PREDICTED)
        if "measured" in one:
            _measured_response(plots[:, column], one["measured"], hz, phase)
        plots[0, column].set_title(f"{one['output']} / {one['input']}", fontsize=9)
        plots[-1, column].set_xlabel("frequency, Hz")
    plots[0, 0].set_ylabel("gain, dB")
    plots[1, 0].set_ylabel("phase, deg")
    if rows == 3:
        plots[2, 0].set_ylabel("coherence")


def _measured_response(plots: Any, found: Result, hz: Array, phase: Array) -> None:
    """Gain and phase with 95 % bars where they hang together with the input, and the coherence."""
    there, coherence = np.array(found["frequency_hz"]), np.array(found["coherence"])
    good = coherence > _COHERENT
    # Turned by whole turns to where the model's phase is.
    near = np.interp(there, hz, phase)
    angle = np.degrees(_floats(found["phase_rad"]))
    angle = angle + 360.0 * np.round((near - angle) / 360.0)
    bars = (_floats(found["gain_std_db"]), np.degrees(_floats(found["phase_std_rad"])))
    for plot, values, std in zip(plots[:2], (_floats(found["gain_db"]), angle), bars, strict=True):
        plot.errorbar(there[good], values[good], _Z95 * std[good], fmt="o", markersize=2.5, linewidth=0.7,
                      color=MEASURED)  # fmt: skip
    plots[2].semilogx(there, coherence, "o", markersize=2.5, color=MEASURED)
    plots[2].set_ylim(0.0, 1.05)


def _floats(values: list[float | None]) -> Array:
    """Numbers, NaN where the file has null."""
    return np.array(values, dtype=np.float64)

"""Results of identification and discrepancy analysis as tables for a terminal."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gcs.text.files import write_whole
from gcs.text.intervals import interval
from gcs.text.jsontext import dumps
from gcs.text.nuisance_text import STATED, unknown_words
from gcs.text.probability_text import p_text, probability_text
from gcs.text.quality import flights_words, quality_lines, repeatability_words

_AGREE = {True: "yes", False: "no", None: "not known, the check did not settle"}


def _number(value: Any, digits: int = 5) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _estimate_row(name: str, entry: dict[str, Any], unit: str = "") -> str:
    value, std, ends = entry.get("value"), entry.get("std"), interval(entry)
    between = "" if ends is None else f"{_number(ends[0])} … {_number(ends[1])}"
    error = f"± {_number(std, 3)}" if std is not None else ""
    alone = entry.get("statistical_std")
    own = unit if alone is None else f"± {_number(alone, 2)}"
    return f"  {name:<24} {_number(value):>12} {error:<14} {between:<26} {own}".rstrip()


def _model_lines(model: dict[str, Any]) -> list[str]:
    entries = model.get("coefficients", {}).values()
    head = "of the flight" if any("statistical_std" in entry for entry in entries) else ""
    lines = [f"  {'name':<24} {'value':>12} {'std':<14} {'95 % interval':<26} {head}".rstrip()]
    for name, entry in model.get("coefficients", {}).items():
        if "refused" in entry:
            lines.append(f"  {name:<24} {'refused':>12} {entry['refused']}")
        else:
            lines.append(_estimate_row(name, entry))
    for effect in model.get("effects", []):
        lines.append(f"  effect {effect['name']}")
        lines += [_estimate_row(name, entry) for name, entry in effect.get("parameters", {}).items()]
    return lines


def _systematic_lines(model: dict[str, Any]) -> list[str]:
    """What std holds beside what the flight leaves open."""
    names = {name for entry in model.get("coefficients", {}).values() for name in entry.get("systematic", {})}
    stated = {name for name in names if name.endswith(STATED)}
    held = "  std and interval hold what"
    lines = [f"{held} usual errors of the vehicle file change: {', '.join(sorted(names - stated))}"]
    lines += [f"{held} the vehicle file says of its own errors: {', '.join(sorted(stated))}"]
    return [line for line, named in zip(lines, (names - stated, stated), strict=True) if named]


def _bench_lines(model: dict[str, Any]) -> list[str]:
    """What the standard errors hold of the bench's own errors."""
    sources: dict[str, float] = {}
    for entry in model.get("coefficients", {}).values():
        for source, share in entry.get("bench", {}).items():
            sources[source] = max(sources.get(source, 0.0), share / entry["std"] if entry.get("std") else 0.0)
    if not sources:
        return []
    shares = ", ".join(f"{source} (up to {share:.0%})" for source, share in sources.items())
    return ["  std holds the bench's own errors, and the share of them in it: " + shares]


def _unknown_lines(entries: Sequence[dict[str, Any]]) -> list[str]:
    """What stands between aircraft and log, as estimated beside the coefficients."""
    if not entries:
        return []
    wide = max(36, *(len(unknown_words(entry)[0]) + 2 for entry in entries))
    head = f"  {'unknown':<{wide}}{'axes':<14}{'value':>10} {'std':<12} known before to"
    lines = ["", "between aircraft and log:", head]
    for entry in entries:
        words, unit, factor = unknown_words(entry)
        value, std, prior = (_number(factor * entry[key], 3) for key in ("value", "std", "prior_std"))
        known = f"{prior} {unit if unit != '1' else ''}"
        lines.append(f"  {words:<{wide}}{entry['group']:<14}{value:>10} ± {std:<10} {known}".rstrip())
    return lines


def _score_lines(outputs: dict[str, dict[str, Any]]) -> list[str]:
    columns = ("tic", "r2", "residual_mean", "residual_std")
    lines = ["  " + f"{'output':<12}" + "".join(f"{column:>15}" for column in (*columns, "gaussian_p"))]
    for name, entry in outputs.items():
        cells = [*(_number(entry.get(column), 4) for column in columns), p_text(entry.get("gaussian_p"), 4)]
        lines.append("  " + f"{name:<12}" + "".join(f"{cell:>15}" for cell in cells))
    return lines


def _derivative_lines(found: dict[str, dict[str, Any]]) -> list[str]:
    """What control engineers use, and what needs neither mass nor moments of inertia."""
    lines = [_estimate_row(name, entry, entry["unit"]) for name, entry in found.items()]
    return ["", "dimensional derivatives about the flight's mean (per rad):", *lines] if lines else []


def _mode_lines(modes: Any) -> list[str]:
    """The modes of the motion about the flight's mean airspeed."""
    if not isinstance(modes, list):
        return ["", f"modes: none: {modes['refused']}"] if modes else []
    lines = ["", "modes:", f"  {'name':<28} {'frequency, Hz':<22} {'damping ratio':<22} time constant, s"]
    for mode in modes:
        cells = []
        for key in ("frequency_hz", "damping_ratio", "time_constant_s"):
            entry = mode[key]
            cells.append("-" if entry is None else f"{_number(entry['value'], 4)} ± {_number(entry['std'], 2)}")
        lines.append(f"  {mode['name']:<28} {cells[0]:<22} {cells[1]:<22} {cells[2]}")
    return lines


def _regression_lines(report: dict[str, Any] | None) -> list[str]:
    """How well each axis is explained, and what cannot be distinguished."""
    if not report:
        return []
    lines = ["", "regression:", f"  {'axis':<6}{'R2':>9}{'condition':>11}   R2 in frequency, band   terms by stepwise"]
    for axis, entry in report.items():
        frequency = entry["frequency_domain"]
        band = "-"
        if "band_hz" in frequency:
            low, high = frequency["band_hz"]
            band = f"{frequency['r2']:.4f}, {low:.2f} to {high:.2f} Hz"
        chosen = " ".join(entry["structure"].get("stepwise", []))
        lines.append(f"  {axis:<6}{entry['r2']:>9.4f}{entry['condition']:>11.1f}   {band:<22}  {chosen}".rstrip())
        lines += [f"    {words}" for words in entry["collinear"]]
    return lines


def _warning_lines(result: dict[str, Any]) -> list[str]:
    warnings = result.get("warnings", [])
    return [*(f"warning: {warning}" for warning in warnings), ""] if warnings else []


def identification_text(result: dict[str, Any]) -> str:
    """A result of schema identification/1 as lines."""
    # First what makes the rest doubtful: a vehicle file in grams refuses dozens of coefficients.
    lines = [*_warning_lines(result), *quality_lines(result.get("quality"))]
    lines += [f"flights: {flights_words(result)}"]
    lines += [f"thrust: {source}" for source in dict.fromkeys((result.get("thrust") or {}).values())]
    for segment in result.get("segments", []):
        if isinstance(segment, dict):
            lines.append("segment: " + ", ".join(f"{key} {_plain(value)}" for key, value in segment.items()))
    lines += [
        "",
        f"model {result['model'].get('name', '')}:",
        *_model_lines(result["model"]),
        *_bench_lines(result["model"]),
        *_systematic_lines(result["model"]),
    ]
    if words := repeatability_words(result):
        lines += ["", f"repeatability: {words}"]
    lines += _unknown_lines(result.get("nuisances") or [])
    lines += _regression_lines(result.get("regression"))
    lines += _derivative_lines(result.get("dimensional") or {})
    lines += _mode_lines(result.get("modes"))
    by_map = result.get("method") == "map"
    if result.get("sensor_errors"):
        lines += ["", "sensor errors and wind:"]
        lines += [_estimate_row(name, e, e.get("unit", "")) for name, e in result["sensor_errors"].items()]
    compatibility = result.get("compatibility") or {}
    if compatibility:
        corrected = "by the kinematics alone" if by_map else "after correction"
        lines += ["", f"data compatible {corrected}: {_AGREE[compatibility.get('compatible')]}"]
        lines += [f"  {entry['verdict']}" for entry in compatibility.get("verdicts", [])]
    for refusal in result.get("refused", []):
        manoeuvre = f"; fly the manoeuvre {refusal['manoeuvre']}" if refusal.get("manoeuvre") else ""
        lines.append(f"refused: {refusal['name']}: {refusal['reason']}{manoeuvre}")
    validation = result.get("validation") or {}
    if validation.get("outputs"):
        verdict = {True: "acceptable", False: "not acceptable: fly again", None: "not judged"}
        outliers = validation.get("outliers")
        if outliers:
            verdict[True] += " by TIC, not down to the noise"
        lines += ["", f"validation: {verdict[_truth(validation.get('acceptable'))]}"]
        lines += [*_score_lines(validation["outputs"]), *([f"  {outliers}"] if outliers else [])]
    return "\n".join(lines)


def _truth(value: Any) -> bool | None:
    """`acceptable` stands as a boolean, or as an object with the limit it was judged by."""
    if isinstance(value, dict):
        value = value.get("acceptable", value.get("value"))
    return value if isinstance(value, bool) else None


def _plain(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) and math.isfinite(value) else str(value)


def discrepancy_text(result: dict[str, Any]) -> str:
    """A result of schema discrepancy/1 as lines."""
    lines = [*_warning_lines(result), *quality_lines(result.get("quality"))]
    lines += [result["sentence"], ""] if result.get("sentence") else []
    by = f" (method {result['method']})" if result.get("method") else ""
    lines += [f"verdict: {result['verdict']}{by}", *(f"  {reason}" for reason in result.get("reasons", []))]
    if result.get("ruled_out"):
        lines.append(f"  ruled out beforehand: {', '.join(result['ruled_out'])}")
    for place in result.get("where", []):
        lines.append(
            f"where: {place['axis']} over {place['variable']}, share {_number(place.get('share'), 3)},"
            f" p {p_text(place.get('p_value'))}"
        )
    for effect in result.get("effects", []):
        lines += ["", f"effect {effect['name']}, probability {probability_text(effect.get('probability'))}"]
        for name, entry in effect.get("parameters", {}).items():
            unit = f" [{entry['unit']}]" if entry.get("unit", "1") != "1" else ""
            lines.append(_estimate_row(f"{name}{unit}", entry))
        for other in effect.get("alternatives", []):
            lines.append(f"  or {other['name']}, probability {probability_text(other.get('probability'))}")
        if effect.get("alternatives") and effect.get("separating_manoeuvre"):
            lines.append(f"  would distinguish them: {effect['separating_manoeuvre']}")
            lines.append("  an effect that a test on the ground clears is ruled out with --rule-out EFFECT")
    for flights, gap in (result.get("gap") or {}).items():
        if gap:
            lines += ["", f"gap on the {flights} flights (RMS):", *_gap_lines(gap, bool(result.get("effects")))]
    return "\n".join(lines)


def _gap_lines(gap: dict[str, dict[str, Any]], added: bool) -> list[str]:
    # Where nothing was added, "after" repeats "before".
    stages = ("given", "before", "after", "noise_floor") if added else ("given", "before", "noise_floor")
    columns = [column for column in stages if gap.get(column)]
    outputs = list(dict.fromkeys(name for column in columns for name in gap[column]))
    lines = ["  " + f"{'output':<10}" + "".join(f"{column:>13}" for column in columns)]
    for name in outputs:
        cells = "".join(f"{_number(gap[column].get(name), 4):>13}" for column in columns)
        lines.append(f"  {name:<10}{cells}")
    return lines


def no_values(result: dict[str, Any]) -> str:
    """That an identification has no coefficient with a value, and the first reason, in a line; "" where it has one."""
    entries = result["model"]["coefficients"].values()
    if any(entry.get("value") is not None for entry in entries):
        return ""
    reason = next((entry["refused"] for entry in entries if entry.get("refused")), "the model has none")
    return f"no coefficient could be identified: {reason}"


def write_identification(
    result: dict[str, Any], output: Path | None, model: Path | None, *, as_json: bool, command: str
) -> int:
    """Print and write an identification. The exit code: 1, with a line on standard error, where none has a value."""
    write_results(result, output, model, as_json=as_json, text=identification_text)
    if words := no_values(result):
        print(f"gcs {command}: {words}", file=sys.stderr)
    return 1 if words else 0


def write_results(
    result: dict[str, Any],
    output: Path | None,
    model: Path | None,
    *,
    as_json: bool,
    text: Callable[[dict[str, Any]], str],
) -> None:
    """Print a result, and write it and its model to files where asked for: a full disk does not cost what was found."""
    print(dumps(result, indent=2) if as_json else text(result), flush=True)
    if output is not None:
        write_whole(output, dumps(result, indent=2) + "\n")
    if model is not None:
        write_whole(model, dumps(result["model"], indent=2) + "\n")


def calibration_text(result: dict[str, Any]) -> str:
    """A calibration of schema calibration/1 as lines."""
    lines = [f"form {result['form']}, unit {result['unit'] or 'as given'}"]
    lines += [_estimate_row(entry["name"], entry) for entry in result["coefficients"]]
    low, high = result["range"]
    lines.append(f"  residual (RMS) {_number(result['residual_rms'])}, hysteresis {_number(result['hysteresis'])}")
    lines.append(f"  readings from {_number(low)} to {_number(high)}")
    return "\n".join(lines)

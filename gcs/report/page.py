"""The page of a result: what stands in it, and in what order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from gcs.errors import ReportError
from gcs.report import tables
from gcs.report.markup import contents, folded, listing, paragraph, section, text
from gcs.report.side_by_side import headings, side_by_side
from gcs.report.symbols import LEGEND, equations
from gcs.text.generator import GENERATOR
from gcs.text.quality import flights_words, repeatability_words, verdict_words
from gcs.version import VERSION

Result = Mapping[str, Any]
_METHODS = {
    "map": "output error with an estimated noise spectrum (maximum a posteriori)",
    "ee": "equation error (linear regression)",
    "oe": "output error (maximum likelihood, calm air)",
    "fe": "filter error (maximum likelihood, turbulence as process noise)",
}
_UNACCEPTABLE = "Not acceptable, fly again"


def report(result: Any, beside: Sequence[Any] = ()) -> str:
    """One HTML document of a result of schema identification/1, discrepancy/1, coast/1 or performance/1.

    beside: results whose coefficients stand beside those of an identification. Raises ReportError for any other.
    """
    schema = result.get("schema") if isinstance(result, dict) else None
    pages = {
        "identification/1": lambda one: _identification(one, beside),
        "discrepancy/1": _discrepancy,
        "coast/1": _coast,
        "performance/1": _performance,
    }
    if beside:
        headings([result, *beside])
    if not isinstance(schema, str) or schema not in pages:
        reason = f"its schema is {schema!r}" if schema is not None else "it names no schema"
        raise ReportError(f"this is no result that a report can be made of: {reason}; give one of gcs identify -o")
    try:
        return pages[schema](result)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise ReportError(
            f"the result does not hold what schema {schema} says ({type(error).__name__}: {error}); make it again"
        ) from error


def _identification(result: Result, beside: Sequence[Result]) -> str:
    from gcs.report import figures, histories
    from gcs.report.svg import element

    model, series = result["model"], result.get("series") or {}
    name = str(model.get("name", ""))
    flights = ", ".join(str(one) for one in result["flights"] if str(one) != name)
    fits = figures.flights(series)
    rest = [
        folded("Axes", tables.axes(result)),
        folded("Validation", tables.validation(result)),
        folded(
            "Model",
            *(f'<p class="equation">{line}</p>' for line in equations(model["coefficients"])),
            paragraph(LEGEND),
            paragraph(_correlated(result)),
            tables.validity(model),
            tables.coefficients(model),
            tables.systematic(model),
            tables.refused(result),
            *map(element, figures.correlations(model)),
        ),
        folded("Repeatability", paragraph(repeatability_words(result)),
               *map(element, figures.repeatability(result.get("repeatability") or {}))),
        folded("Dimensional derivatives", tables.derivatives(result.get("dimensional") or {})),
        folded("Sensors", _compatible(result), tables.verdicts(result), tables.compatibility(result),
               tables.sensor_errors(result)),
        folded("Mistakes and delays", _mistakes(result), tables.nuisances(result),
               *map(element, figures.noise_spectra(result.get("noise_spectrum") or []))),
        folded("Time histories", *map(element, histories.every(series))),
        folded("Residuals", *map(element, fits[1:]), *map(element, figures.residual_statistics(series))),
        folded("Frequency responses", *map(element, figures.bode(result.get("frequency_responses") or []))),
        folded("How it was made", tables.segments(result), _made(result)),
    ]  # fmt: skip
    return document(
        f"Flight model of {name}" + (f" from {flights}" if flights else ""),
        _facts(result),
        _quality(result),
        _warnings(result),
        _validation_words(result),
        section("Main derivatives", tables.main_derivatives(model)),
        section("Modes", tables.modes(result)),
        section("Measured and predicted", paragraph(_series_words(series)), *map(element, fits[:1])),
        section("To fly next", listing([text(one) for one in _next(result)])),
        side_by_side([result, *beside]),
        contents(rest),
        *rest,
    )


def _discrepancy(result: Result) -> str:
    from gcs.report import discrepancy, discrepancy_figures
    from gcs.report.svg import element

    verdict = result["verdict"].replace("_", " ")
    facts = {"Flights": ", ".join(map(str, result.get("flights", []))), "Verdict": verdict}
    if result.get("method"):
        facts["Method"] = _METHODS.get(result["method"], result["method"])
    if result.get("ruled_out"):
        facts["Ruled out beforehand"] = ", ".join(result["ruled_out"])
    return document(
        f"What the flight model lacks: {verdict}",
        _definitions(facts),
        f'<p class="verdict">{text(result["sentence"])}</p>' if result.get("sentence") else "",
        _quality(result),
        _warnings(result),
        section("Reasons", listing([text(one) for one in result.get("reasons", [])])),
        section("Where", discrepancy.where(result), *map(element, discrepancy_figures.residual_curves(result))),
        section("Effects", *discrepancy.effects(result)),
        section("Gap", *map(element, discrepancy_figures.gap_bars(result)), *discrepancy.gaps(result)),
        section("Measured and simulated", *map(element, discrepancy_figures.simulations(result))),
        section("Model", *(f'<p class="equation">{e}</p>' for e in equations(result["model"]["coefficients"])),
                paragraph(LEGEND), tables.coefficients(result["model"])),
        section("How it was made", _made(result)),
    )  # fmt: skip


def _coast(result: Result) -> str:
    from gcs.analysis.coast import coast_text
    from gcs.report import coast
    from gcs.report.svg import element

    head, *lines = coast_text({**result, "warnings": []}).splitlines()
    facts = {"Vehicle": result["vehicle"], "Model": result["model"], "Flight": result["flight"]}
    bad = "" if result["inside"] else " bad"
    return document(
        f"Without GPS: {result['flight']}",
        _definitions(facts),
        f'<p class="verdict{bad}">{text(head)}</p>',
        listing([text(line.strip()) for line in lines]),
        _warnings(result),
        *(element(one) for one in coast.every(result)),
        section("How it was made", _made(result)),
    )


def _performance(result: Result) -> str:
    from gcs.report import performance
    from gcs.report.svg import element

    at = f"{result['mass']:.4g} kg at {result['altitude']:.0f} m ({result['air_density']:.3f} kg/m³)"
    battery = result.get("battery")
    facts = {"Model": result["model"], "Flown with": at, "Battery": "" if battery is None else f"{battery:g} Wh"}
    return document(
        f"How it performs: {result['vehicle']}",
        _definitions(facts),
        _warnings(result),
        performance.figures(result),
        *(element(one) for one in performance.every(result)),
        section("How it was made", _made(result)),
    )


def _quality(result: Result) -> str:
    """What the flight is worth, and why."""
    found = result.get("quality")
    if not found:
        return ""
    bad = " bad" if found["verdict"] == "poor" else ""
    words = f'<p class="verdict{bad}">The flight is {text(verdict_words(found))}</p>'
    return words + listing([text(one) for one in found["reasons"]])


def _next(result: Result) -> list[str]:
    """Manoeuvres that would identify what was refused, each with what it is flown for."""
    wanted: dict[str, list[str]] = {}
    for one in result.get("refused", []):
        if one.get("manoeuvre"):
            wanted.setdefault(one["manoeuvre"], []).append(one["name"])
    flown = [f"{manoeuvre}: for {', '.join(names)}" for manoeuvre, names in wanted.items()]
    alone = [] if result.get("validation") else ["another flight, to judge the model by (gcs identify --validate)"]
    return [*flown, *alone]


def _warnings(result: Result) -> str:
    """Before the rest, which they may make doubtful."""
    return section("Warnings", listing([text(one) for one in result.get("warnings", [])]))


def document(title: str, *parts: str) -> str:
    """A page with its style in it. parts: HTML."""
    style = files("gcs.report").joinpath("style.css").read_text(encoding="utf-8")
    body = "\n".join(part for part in parts if part)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"{GENERATOR}\n"
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{text(title)}</title>\n'
        f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n<h1>{text(title)}</h1>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _definitions(entries: Mapping[str, str]) -> str:
    rows = "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in entries.items() if value)
    return f"<dl>{rows}</dl>"


def _facts(result: Result) -> str:
    """What one wants to know first."""
    entries = result["model"]["coefficients"].values()
    estimated = sum(entry.get("value") is not None for entry in entries)
    judges = (result.get("validation") or {}).get("flights", [])
    return _definitions(
        {
            "Vehicle": result["model"].get("name", ""),
            "Flights": flights_words(result),
            "Validated on": ", ".join(map(str, judges)) or "no other flight",
            "Method": _METHODS.get(result.get("method", ""), str(result.get("method", "not given"))),
            "Turbulence": _turbulence(result),
            "Thrust": ", ".join(dict.fromkeys((result.get("thrust") or {}).values())),
            "Coefficients": f"{estimated} estimated, {len(entries) - estimated} refused",
            "Made": (result.get("made") or {}).get("utc", ""),
        }
    )


def _turbulence(result: Result) -> str:
    """Intensities of the filter, or what the compatibility check saw."""
    filtered = result.get("turbulence")
    if filtered:
        return ", ".join(f"{name} {entry['value']:.3g} {entry['unit']}" for name, entry in filtered.items())
    seen = (result.get("compatibility") or {}).get("turbulence")
    return "none seen" if not seen else f"{seen:.2g} m/s by the kinematics"


def _validation_words(result: Result) -> str:
    found = result.get("validation")
    if not found:
        return '<p class="verdict">Not judged: no other flight was named to validate on.</p>'
    good = found.get("acceptable")
    outliers = found.get("outliers")
    # TIC forgives what is short: a fit that is good by it may be off by many times the noise where a surface steps.
    words = ("Acceptable by TIC, not down to the noise" if outliers else "Acceptable") if good else _UNACCEPTABLE
    verdict = f'<p class="verdict{"" if good else " bad"}">{words}: {text(found.get("reason", ""))}.</p>'
    return verdict + paragraph(f"{outliers}." if outliers else "")


def _compatible(result: Result) -> str:
    found = result.get("compatibility") or {}
    if "compatible" not in found:
        return ""
    good = found["compatible"]
    if good is None:
        return paragraph(
            "Whether the sensors agree on one motion is not known: the check by the kinematics did not settle."
        )
    words = "After correction the sensors agree on one motion." if good else "The sensors do not agree on one motion."
    if result.get("method") == "map":
        words = f"By the kinematics alone the sensors {'agree' if good else 'do not agree'} on one motion."
        words += " The estimate corrects none of them by it."
    return f'<p class="verdict{"" if good else " bad"}">{words}</p>'


def _correlated(result: Result) -> str:
    held = "correlation" in result["model"]
    return "The result file holds the correlations of these estimates under model.correlation." if held else ""


def _mistakes(result: Result) -> str:
    found = result.get("mistakes", [])
    if not found:
        delays = "Delays are among what is estimated beside the coefficients, below." if result.get("nuisances") else ""
        return f"<p>No unit, sign or axis was found wrong beyond doubt, and no signal was changed. {delays}</p>"
    return listing([f"{text(one['signal'])} ({text(one['kind'])}): {text(one['sentence'])}" for one in found])


def _series_words(series: Result) -> str:
    if not series:
        return "The result holds no curves; identify the flight again with this version to have them."
    if series.get("refused"):
        return f"No curves: {series['refused']}."
    if series["use"] == "validation":
        return "On the flights that the model was not fitted to. Extremes are kept, points between left out."
    return "On the flights that the model was fitted to. Extremes are kept, points between left out."


def _made(result: Result) -> str:
    """Settings, files and versions that repeat the result."""
    made = result.get("made") or {}
    software = made.get("software", {})
    entries = {"Result made with": ", ".join(f"{name} {number}" for name, number in software.items())}
    entries |= {"Settings": ", ".join(f"{name} {value}" for name, value in made.get("settings", {}).items())}
    entries |= {f"SHA-256 of {one['name']}": one["sha256"] for one in made.get("files", [])}
    return _definitions({**entries, "Page made with": f"gcs {VERSION}"})

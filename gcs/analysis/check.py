"""Whether flights are good for identification: the job behind `gcs check`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.analysis.postflight import load_flown, read_flights, senders_of
from gcs.text.quality import quality_lines
from sysid.errors import SysidError


def check(
    paths: Sequence[Path],
    vehicle: Path,
    *,
    system: int | None = None,
    as_recorded: Sequence[str] = (),
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> dict[str, Any]:
    """What flights are worth; the JSON of schema check/1.

    paths: MCAP recordings. as_recorded: signals that are right whatever seems. A flight that nothing can be identified
    from is poor, with the reason. Raises GcsError, SysidError, SimVehicleError in one line where one cannot be read.
    """
    from sysid.identification.result_file import result_json
    from sysid.identify import identify
    from sysid.signal_check.corrected_faults import require_searched

    craft = load_flown(vehicle, paths, system)
    require_searched([*as_recorded, *craft.as_recorded])
    progress(0.0, "reading the recordings")
    flights = read_flights(paths, craft, system)
    found: dict[str, Any] = {
        "schema": "check/1",
        "flights": [flight.name for flight in flights],
        "vehicle": craft.name,
        "senders": senders_of(flights),
        "rates": {
            flight.name: {name: round(one.rate_hz, 2) for name, one in flight.signals.items()} for flight in flights
        },
    }
    try:
        result = result_json(identify(flights, craft, method="map", as_recorded=as_recorded, progress=progress))
    except SysidError as error:
        poor = {"verdict": "poor", "reasons": [str(error)], "axes": {}}
        warnings = [*craft.warnings, *(line for flight in flights for line in flight.warnings)]
        return {**found, "quality": poor, "expected": {}, "refused": [], "mistakes": [], "warnings": warnings}
    expected = {
        name: {"value": entry["value"], "std": entry["std"]}
        for name, entry in result["model"]["coefficients"].items()
        if entry.get("value") is not None
    }
    kept = {key: result[key] for key in ("quality", "refused", "mistakes", "segments")}
    return {
        **found,
        **kept,
        "expected": expected,
        "warnings": list(dict.fromkeys([*craft.warnings, *result["warnings"]])),
    }


def check_text(found: Mapping[str, Any]) -> str:
    """A result of schema check/1 as lines."""
    lines = [*quality_lines(found["quality"])]
    if axes := found["quality"]["axes"]:
        lines += ["axis  verdict  standard errors to expect", *(_axis_line(axis, found) for axis in axes), ""]
    for flight, rates in found["rates"].items():
        slow = {rate: [name for name, one in rates.items() if one == rate] for rate in sorted(set(rates.values()))}
        words = "; ".join(f"{', '.join(names)} {rate:g} Hz" for rate, names in reversed(slow.items()))
        lines.append(f"{flight}: {words}")
    return "\n".join([*lines, *(f"warning: {one}" for one in found["warnings"])])


def _axis_line(axis: str, found: Mapping[str, Any]) -> str:
    known = [
        f"{name} ±{entry['std']:.2g}"
        for name, entry in found["expected"].items()
        if name.startswith(f"{axis}_") and entry["std"]
    ]
    lost = [one["name"] for one in found["refused"] if one["name"].startswith(f"{axis}_")]
    words = ", ".join(known) + (f"{'; ' if known else ''}refused: {', '.join(lost)}" if lost else "")
    return f"{axis:<5} {found['quality']['axes'][axis]['verdict']:<8} {words}".rstrip()

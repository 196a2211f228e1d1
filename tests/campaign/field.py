"""What identification is worth in the field: flights of JSBSim's seen as the field sees them, identified and judged.

Families: mild, typical, rough, short (8 to 12 s), closed-loop, slow (10 Hz), odd (dead channels, one axis), stock
(aircraft that come with JSBSim). `--steps` takes textbook flights with one imperfection at a time instead, `--rates`
aircraft that come with JSBSim with textbook sensors and measured surfaces at 20, 50 and 100 Hz. Methods are
those of `sysid.identify`, and `ls`, plain least squares with one delay. Each line of the store is one flight by one
method; a run that is broken off goes on where it stopped, and sources that changed are estimated anew.
Run: make campaign NAME=field, or for 14 flights make campaign NAME=field SHORT=1
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from field_flight import FAMILIES, STEPS, STOCK_RATES, FieldFlight, field_flight
from field_least_squares import least_squares
from other_engine import version
from own_bars import own_bar

from sysid.errors import SysidError
from sysid.identify import identify

SUPPORT = Path(__file__).parents[1] / "support"
SHORT = [(family, seed) for seed in range(2) for family in FAMILIES if (family, seed) not in (("slow", 1), ("mild", 1))]
SEEDS = 15
LIMIT = 240.0  # s of one estimate
Line = dict[str, Any]


class TimeIsUpError(BaseException):
    """Raised by the alarm; no handler of the product's catches it."""


def _time_is_up(number: int, frame: FrameType | None) -> None:
    raise TimeIsUpError


def digest() -> str:
    """Short digest of the flights' sources."""
    paths = sorted([*SUPPORT.glob("field_*.py"), SUPPORT / "jsbsim_flight.py", SUPPORT / "jsbsim_twin.py"])
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


def estimate(flight: FieldFlight, method: str) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of what a method reports."""
    if method == "ls":
        return least_squares(flight.signals, flight.vehicle)
    found = identify([flight.signals], flight.vehicle, method=method)
    return {
        name: (entry.value, own_bar(entry))
        for name, entry in found.model.coefficients.items()
        if entry.value is not None and entry.std is not None
    }


def judge(flight: FieldFlight, method: str, limit: float) -> Line:
    """One flight by one method: what goes into the store beside its key."""
    line: Line = {"seconds": flight.seconds, "truth": flight.truth, "excited": flight.excited}
    began = sum(os.times()[:4])
    signal.signal(signal.SIGALRM, _time_is_up)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        line["estimate"] = estimate(flight, method)
    except TimeIsUpError:
        line["error"] = f"not done after {limit:.0f} s"
    except SysidError as error:
        line["error"] = str(error)
    except Exception as error:  # A crash is an answer that must be seen, and must not end the campaign.
        line["error"], line["crashed"] = f"{type(error).__name__}: {error}", True
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return {**line, "cpu": sum(os.times()[:4]) - began}


def read(store: Path, how: str = "method") -> dict[tuple[str, int, str, str], Line]:
    """Lines of the store by flight, `how` it was taken and sources; a last line that was cut off is left out."""
    lines = {}
    for text in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        lines[line["family"], line["seed"], line[how], line["version"]] = line
    return lines


def row(lines: Sequence[Line]) -> str:
    """One row of the table."""
    good = [line for line in lines if "error" not in line]
    asked, scores = 0, []
    for line in good:
        told = [name for name in line["excited"] if name in line["estimate"]]
        asked += len(line["excited"])
        for name in told:
            (value, std), (low, high) = line["estimate"][name], line["truth"][name]
            scores.append((max(low - value, value - high, 0.0), std, max(abs(low + high) / 2.0, 1e-6)))
    crashed = sum(line.get("crashed", False) for line in lines)
    text = f"{len(lines):>8}{len(good):>9}{crashed:>8}"
    cost = np.median([line["cpu"] / line["seconds"] for line in lines]) if lines else np.nan
    if not scores:
        return f"{text}{'':>52}{cost:>9.3f}"
    off, std, size = np.array(scores).T
    error, bar = np.median(off / size), np.median(std / size)
    held, far = np.mean(off <= 1.96 * std), np.mean(off > 5 * std)
    return (
        f"{text}{len(scores) / asked:>10.0%}{held:>9.1%}{error:>9.1%}{far:>9.1%}"
        f"{bar / max(1.4826 * error, 1e-9):>15.2f}{cost:>9.3f}"
    )


def report(method: str, lines: Iterable[Line]) -> None:
    """Print a method's table: by family and in all."""
    lines = list(lines)
    heads = ("flights", "answered", "crashed", "reported", "hold", "error", "beyond 5", "bar/error", "CPU s/s")
    wide = (8, 9, 8, 10, 9, 9, 9, 15, 9)
    print(f"\n{method}\n{'':<24}{''.join(f'{head:>{width}}' for head, width in zip(heads, wide, strict=True))}")
    for family in dict.fromkeys(line["family"] for line in lines):
        print(f"{family:<24}{row([line for line in lines if line['family'] == family])}")
    print(f"{'all':<24}{row(lines)}")


def wanted_flights(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Families and seeds asked for."""
    if options.steps:
        names = [f"step/{name}{gusts}" for name in STEPS for gusts in ("", "+gusts")]
        return [(name, seed) for name in names for seed in range(options.seeds or 2)]
    if options.rates:
        return [(name, seed) for name in STOCK_RATES for seed in range(options.seeds or 6)]
    families = FAMILIES if options.families == "all" else tuple(options.families.split(","))
    if options.short:
        return [(family, seed) for family, seed in SHORT if family in families]
    return [(family, seed) for seed in range(options.seeds or SEEDS) for family in families]


def main() -> None:
    """Fly and estimate what is missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", default="auto,ls")
    parser.add_argument("--families", default="all", help=f"of {', '.join(FAMILIES)}")
    parser.add_argument("--seeds", type=int, help=f"flights of each family ({SEEDS})")
    parser.add_argument("--short", action="store_true", help="14 flights over all families")
    parser.add_argument("--steps", action="store_true", help="textbook flights with one imperfection at a time")
    parser.add_argument("--rates", action="store_true", help="stock aircraft, textbook sensors at 20, 50, 100 Hz")
    parser.add_argument("--limit", type=float, default=LIMIT, help="s of one estimate")
    parser.add_argument("--store", type=Path, default=Path("campaign-output/field/flights.jsonl"))
    parser.add_argument("--tlog", type=Path, help="write the flights as telemetry logs there, estimate nothing")
    options = parser.parse_args()
    flights = wanted_flights(options)
    if options.tlog:
        write(flights, options.tlog)
        return
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines, sources, methods = read(options.store), f"{version()}-{digest()}", options.methods.split(",")
    for place, (family, seed) in enumerate(flights, 1):
        missing = [method for method in methods if (family, seed, method, sources) not in lines]
        if not missing:
            continue
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            flight = field_flight(family, seed, Path(folder))
        flown = time.monotonic() - began
        for method in missing:
            key = {"family": family, "seed": seed, "method": method, "version": sources}
            line = {**key, **judge(flight, method, options.limit)}
            lines[family, seed, method, sources] = line
            with options.store.open("a", encoding="utf-8") as store:
                store.write(json.dumps(line) + "\n")
            said = line.get("error", "")[:100]
            print(
                f"{place}/{len(flights)} {family} {seed} {method}: {flight.seconds:.0f} s flown in {flown:.1f} s, "
                f"CPU {line['cpu']:.1f} s {said}",
                file=sys.stderr,
                flush=True,
            )
    for method in methods:
        report(method, [lines[f, s, method, sources] for f, s in flights if (f, s, method, sources) in lines])


def write(flights: Iterable[tuple[str, int]], folder: Path) -> None:
    """Write the flights as telemetry logs, each with its vehicle file and its truth."""
    from field_wire import write_flight

    folder.mkdir(parents=True, exist_ok=True)
    for family, seed in flights:
        with tempfile.TemporaryDirectory() as scratch:
            flight = field_flight(family, seed, Path(scratch))
        write_flight(flight, folder / f"{family.replace('/', '-')}-{seed}")


if __name__ == "__main__":
    main()

"""Are effects named that another engine flies? Run: make campaign NAME=jsbsim-effects

Each flight is JSBSim's, with one effect written in JSBSim's own terms (tests/support/jsbsim_effects.py), sensors of the
reference paper's Table II and calm air, or servos, air, sensors and link of a family of field flights (--families), or
textbook sensors in a flight of many manoeuvres (plans, with more effects, and some that no catalogue holds).
The job gets its signals, the vehicle file, and a baseline that lacks the effect and is off by up to 5 % in every
coefficient. One line for each flight is kept in campaign-output/jsbsim-effects,
in a file named after the sources, so that a campaign that was stopped goes on where it was. Prints a table in markdown.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from field_effects import ALL, CLEAN, TABLES, HiddenFlight, hidden_flight
from field_flight import FAMILIES
from jsbsim_effects import NAMES, Hidden, hidden
from jsbsim_flight import drawn_aircraft, fly, measure, table_aircraft
from planned_flights import EFFECTS, UNLISTED, planned_flight
from seed_lines import end_line, fingerprint, keyed_lines, progress

from sysid.discrepancy import discrepancy
from sysid.errors import SysidError

OUTPUT = Path(__file__).resolve().parents[2] / "campaign-output" / "jsbsim-effects"
SOURCES = (
    *("sysid", "sim_vehicle", "jsbsim_effects", "jsbsim_flight", "jsbsim_twin", "field_effects", "field_flight"),
    *("field_plant", "field_sensors", "field_air", "field_inputs", "planned_flights"),
)
SECONDS = 20.0
OFF = 0.05
SURE = 0.9
TEXTBOOK, PLANS = "textbook", "plans"
HEAD = (
    "effect",
    "family",
    "aircraft",
    "seed",
    "flown",
    "verdict",
    "first name",
    "probability",
    "estimate",
    "or",
    "CPU s",
)


@dataclass(frozen=True)
class Case:
    """One flight. size: share of the effect's usual one. aircraft: number of the one drawn, 0 for the linear one.

    unlisted: whether the effect is taken out of the catalogue, so that nothing in it is right.
    """

    effect: str
    size: float
    family: str
    aircraft: int
    seed: int
    unlisted: bool

    @property
    def key(self) -> str:
        """Name of the flight in the store."""
        return f"{self.effect}@{self.size:g}-{self.family}-{self.aircraft}-{self.seed}{'-unlisted' * self.unlisted}"

    def fly(self, folder: Path) -> HiddenFlight:
        """Fly it."""
        if self.family == PLANS:
            return planned_flight(self.effect, self.aircraft, self.seed, folder, OFF, self.size)
        if self.family != TEXTBOOK:
            return hidden_flight(self.effect, self.family, self.seed, folder, OFF, self.size)
        base = drawn_aircraft(self.aircraft)
        if self.effect == CLEAN:
            effect = Hidden(CLEAN, {}, base, base.vehicle, base.model)
        elif self.effect == TABLES:
            effect = Hidden(TABLES, {}, table_aircraft(), base.vehicle, base.model)
        else:
            effect = hidden(self.effect, self.size, base)
        seed = self.seed + 1000 * self.aircraft
        signals, _ = measure(fly(folder, effect.flown, seed, SECONDS), seed, self.key)
        return HiddenFlight(signals, effect.vehicle, effect.baseline(seed, OFF), dict(effect.parameters))


def one(case: Case) -> dict[str, Any]:
    """Fly one effect and ask what is missing: a line of the store."""
    with tempfile.TemporaryDirectory() as folder:
        flown = case.fly(Path(folder))
    line: dict[str, Any] = {"key": case.key, **asdict(case), "flown": dict(flown.parameters)}
    began = time.process_time()
    try:
        ruled_out = (case.effect,) if case.unlisted else ()
        found = discrepancy([flown.signals], flown.vehicle, flown.model, ruled_out=ruled_out)
    except SysidError as error:
        line |= {"verdict": f"refused: {error}", "named": [], "reasons": []}
    else:
        line |= {"verdict": found["verdict"], "named": found["effects"], "reasons": found["reasons"]}
        line |= {"method": found["method"], "nearest": found["nearest"], "left": found["left"]}
    return line | {"cpu_seconds": round(time.process_time() - began, 1)}


def is_right(line: Mapping[str, Any]) -> bool:
    """Whether the effect that was flown is the first that is named, and none where nothing of the catalogue was."""
    if line["unlisted"] or line["effect"] == TABLES:
        return line["verdict"] == "unexplained" and not line["named"]
    if line["effect"] in UNLISTED:
        return not line["named"] and not line["verdict"].startswith("refused")
    if line["effect"] == CLEAN:
        return line["verdict"] in ("none", "parameter_error")
    return bool(line["named"]) and line["named"][0]["name"] == line["effect"]


def row(line: Mapping[str, Any]) -> list[str]:
    """One flight in the table."""
    flown = ", ".join(f"`{name}` {value:g}" for name, value in line["flown"].items())
    head = [
        f"`{line['effect']}`",
        f"{line['family']}, {line.get('method', '')}",
        str(line["aircraft"]),
        str(line["seed"]),
        flown,
    ]
    if not line["named"]:
        return [*head, line["verdict"], "", "", "", "", f"{line['cpu_seconds']:.0f}"]
    first, *more = line["named"]
    estimates = ", ".join(
        f"`{name}` {entry['value']:.4g} ± {entry['std']:.2g}" for name, entry in first["parameters"].items()
    )
    others = [f"{one['name']} {one['probability']:.2f}" for one in first["alternatives"]]
    others += [f"and {one['name']} {one['probability']:.2f}" for one in more]
    return [
        *head, line["verdict"], f"`{first['name']}`", f"{first['probability']:.4g}", estimates,
        "; ".join(others), f"{line['cpu_seconds']:.0f}",
    ]  # fmt: skip


def table(lines: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: a row for each flight, and how many were named right."""
    rows = [HEAD, tuple("---" for _ in HEAD), *(row(line) for line in lines)]
    told = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    right = [line for line in lines if is_right(line)]
    effects = {line["effect"] for line in right}
    alone = sum(len(line["named"]) == 1 for line in right)
    wrong = sum(any(is_false(line, named) for named in line["named"]) for line in lines)
    return (
        f"{told}\n\n{len(right)} of {len(lines)} flights right, {alone} with that name alone; {len(effects)} effects;"
        f" {wrong} flights with a wrong name above {SURE}."
    )


def is_false(line: Mapping[str, Any], named: Mapping[str, Any]) -> bool:
    """Whether a name that is given as sure is of something that was not flown."""
    return bool(named["name"] != line["effect"] and named["probability"] > SURE and line["effect"] != TABLES)


def main() -> int:
    """Fly what is missing and print the table."""
    parser = argparse.ArgumentParser(description="Naming of missing effects that JSBSim flies.")
    parser.add_argument("--effects", default="all", help=f"names with commas between, of: {', '.join(NAMES)}")
    parser.add_argument("--sizes", default="1", help="shares of the usual sizes, with commas between (default 1)")
    parser.add_argument("--seeds", type=int, default=1, help="flights of each effect (default 1)")
    parser.add_argument(
        "--families",
        default=TEXTBOOK,
        help=f"{TEXTBOOK} (default), {PLANS}, or of field flights: {', '.join(FAMILIES[:6])}",
    )
    parser.add_argument("--aircraft", default="0", help="numbers of aircraft, 0 (default): the linear one, else drawn")
    parser.add_argument("--unlisted", action="store_true", help="take each effect out of the catalogue")
    parser.add_argument("--table", action="store_true", help="fly nothing, print what is there of these sources")
    given = parser.parse_args()
    families = given.families.split(",")
    flown = EFFECTS if families == [PLANS] else (*NAMES, CLEAN, TABLES)
    every = EFFECTS if families == [PLANS] else NAMES
    names = every if given.effects == "all" else tuple(given.effects.split(","))
    unknown = [name for name in names if name not in flown]
    names = tuple(name for name in names if {TEXTBOOK, PLANS} & set(families) or name in (*ALL, TABLES))
    if unknown:
        parser.error(f"JSBSim flies no effect {unknown[0]!r}; there are {', '.join(every)}")
    path = OUTPUT / f"{fingerprint(SOURCES)}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    end_line(path)
    sizes = [float(size) for size in given.sizes.split(",")]
    wanted = [
        Case(name, size, family, number, seed, given.unlisted)
        for seed in range(given.seeds)
        for number in map(int, given.aircraft.split(","))
        for family in families
        for size in sizes
        for name in names
    ]
    done = keyed_lines(path, "key")
    missing = [] if given.table else [case for case in wanted if case.key not in done]
    begin = time.monotonic()
    for count, case in enumerate(missing, 1):
        line = one(case)
        done[line["key"]] = line
        with path.open("a", encoding="utf-8") as store:
            store.write(json.dumps(line) + "\n")
        progress(count, len(missing), time.monotonic() - begin)
    shown = [case.key for case in sorted(wanted, key=lambda case: names.index(case.effect))]
    print(table([done[key] for key in shown if key in done]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A campaign of flights by family and seed: each is a line of JSON in a store, and what is there is not flown again."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from field import read
from other_engine import version

Line = dict[str, Any]


def resumable(
    kind: str,
    about: str | None,
    families: Sequence[str],
    seeds: int,
    fly: Callable[[str, int], Line],
    report: Callable[[Sequence[Line]], None],
) -> None:
    """Fly what is missing, and print the table. kind: of the lines, and the folder of the store. seeds: of a family."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", default=",".join(families))
    parser.add_argument("--seeds", type=int, default=seeds, help="flights of each family")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--store", type=Path, default=Path(f"campaign-output/{kind}/flights.jsonl"))
    options = parser.parse_args()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines, now = read(options.store, "kind"), version()
    wanted = [
        (family, seed, kind, now)
        for seed in range(options.first, options.first + options.seeds)
        for family in options.families.split(",")
    ]
    for key in wanted:
        if key in lines:
            continue
        family, seed, _, _ = key
        line = lines[key] = {"family": family, "seed": seed, "kind": kind, "version": now, **fly(family, seed)}
        with options.store.open("a", encoding="utf-8") as store:
            store.write(json.dumps(line) + "\n")
        print(f"{family} {seed}", file=sys.stderr, flush=True)
    report([lines[key] for key in wanted if key in lines])

"""The discrepancy campaign as markdown: figures against their goals, the confusion matrix, and single misses."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from discrepancy_parts import PARTS, row, share
from discrepancy_scores import (
    CLASSES,
    HIDDEN_TO_ALL,
    IN_A_SET,
    SEPARABLE,
    Score,
    calibration_error,
    score,
)

Lines = Sequence[Mapping[str, Any]]
Truth = Mapping[str, Mapping[str, Any]]


def report(part: str, lines: Lines, truth: Truth) -> str:
    """The tables of a part. truth: by the key of a case what its flight tells."""
    if not lines:
        return "no cases of these sources yet"
    if part in PARTS:
        return PARTS[part](lines, truth)
    scores = [score(line, truth[line["key"]]["effects"][name]) for line in lines for name in line["hidden"]]
    tables = (_figures(scores, lines), _matrix(scores), _reliability(scores), _away(scores), _misses(scores, lines))
    return "\n\n".join(tables)


def _figures(scores: Sequence[Score], lines: Lines) -> str:
    by = {kind: [one for one in scores if one.kind == kind] for kind in CLASSES}
    easy, tied, mute = by[SEPARABLE], by[IN_A_SET], by[HIDDEN_TO_ALL]
    large = {one.hidden for one in easy if one.share == 1.0 and one.gust == 0.0}
    calm = any(one.gust == 0.0 and one.share == 1.0 for one in scores)
    told = [one for one in tied if one.chosen]
    sizes = [len(one.chosen) / len(one.true_set) for one in told]
    gaps = [one.gap for one in scores if math.isfinite(one.gap)]
    inside = [abs(away) <= 1.96 for one in scores for away in one.away.values()]
    spread = [value for one in scores for value in one.spread.values()]
    error, _ = calibration_error([pair for one in scores for pair in one.named])
    wrong = sum(bool(one.wrong_confident) for one in scores)
    seconds = [one.seconds for one in scores if math.isfinite(one.seconds)]
    rows = [
        f"{len(scores)} cases: {len(easy)} detectable and separable, {len(tied)} detectable but not separable, "
        f"{len(mute)} not detectable.",
        "",
        "| figure | found | goal | |",
        "|---|---|---|---|",
        share("separable: right name first", sum(s.right for s in easy), len(easy), ">= 95 %", lambda x: x >= 0.95),
        share("not separable: set holds truth", sum(s.holds for s in tied), len(tied), ">= 95 %", lambda x: x >= 0.95),
        row("mean size of the set over the truth's", f"{np.mean(sizes):.2f}" if sizes else "no case", "<= 1.5",
             bool(np.mean(sizes) <= 1.5) if sizes else None),
        share("separating manoeuvre named", sum(s.manoeuvre for s in told), len(told), "always", lambda x: x == 1.0),
        share("not detectable: none or parameter_error", sum(s.silent for s in mute), len(mute), "",
               lambda x: x >= 0.98),
        share("not detectable: an effect named", sum(bool(s.chosen) and not s.silent for s in mute), len(mute),
               "<= 2 %", lambda x: x <= 0.02),
        share("wrong name above 0.9", wrong, len(scores), "<= 1 %", lambda x: x <= 0.01),
        row("effects separable in calm air at the largest size", str(len(large)), ">= 25",
             len(large) >= 25 if calm else None),
        share("gap held out <= 1.15x the true model's", sum(g <= 1.15 for g in gaps), len(gaps), ">= 95 %",
               lambda x: x >= 0.95),
        share("95 % intervals hold the effect's parameters", sum(inside), len(inside), "90 to 98 %",
               lambda x: 0.9 <= x <= 0.98),
        row("median std of those over the bound", f"{np.median(spread):.2f}" if spread else "none", "<= 1.5",
             bool(np.median(spread) <= 1.5) if spread else None),
        row("expected calibration error", f"{error:.3f}", "<= 0.05", error <= 0.05 if math.isfinite(error) else None),
        row("seconds a case", f"median {np.median(seconds):.0f}, longest {max(seconds):.0f}" if seconds else "",
             "<= 60", bool(max(seconds) <= 60.0) if seconds else None),
        row("flights without a result", str(sum(bool(line["failure"]) for line in lines)), "", None),
    ]  # fmt: skip
    return "\n".join(rows)


def _matrix(scores: Sequence[Score]) -> str:
    """Confusion matrix, empty places left out: a row per hidden effect and class, with what stood first."""
    rows = ["| hidden | class | sigma | right first | in the set | instead |", "|---|---|---|---|---|---|"]
    for name in dict.fromkeys(one.hidden for one in scores):
        for kind in CLASSES:
            own = [one for one in scores if one.hidden == name and one.kind == kind]
            if not own:
                continue
            sigma = f"{min(s.detect for s in own):.1f} to {max(s.detect for s in own):.0f}"
            instead = Counter(one.first for one in own if not one.right)
            listed = ", ".join(f"{what} {count}" for what, count in instead.most_common())
            more = Counter(what for one in own if one.right for what in one.extra)
            added = "; besides: " + ", ".join(f"{what} {count}" for what, count in more.items()) if more else ""
            rows.append(
                f"| {name} | {kind} | {sigma} | {sum(s.right for s in own)} of {len(own)} | "
                f"{sum(s.holds for s in own)} | {listed}{added} |"
            )
    return "\n".join(rows)


def _reliability(scores: Sequence[Score]) -> str:
    _, rows = calibration_error([pair for one in scores for pair in one.named])
    text = ["| stated probability | names | share right |", "|---|---|---|"]
    return "\n".join([*text, *(f"| {mean:.2f} | {count} | {share:.2f} |" for count, mean, share in rows)])


def _away(scores: Sequence[Score]) -> str:
    """Parameters outside their intervals."""
    text = ["| parameter outside its interval | errors over std | std over bound |", "|---|---|---|"]
    for one in scores:
        for name, away in one.away.items():
            if abs(away) > 1.96:
                spread = f"{one.spread[name]:.2f}" if name in one.spread else ""
                text.append(f"| {one.hidden}@{one.share:g}/{one.gust:g} {name} | {away:+.1f} | {spread} |")
    return "\n".join(text)


def _misses(scores: Sequence[Score], lines: Lines) -> str:
    """Every case that missed its goal, with the job's reasons."""
    text = ["| missed case | class | told apart least | answer | gap ratio | seconds |", "|---|---|---|---|---|---|"]
    for one, line in zip(scores, lines, strict=True):
        good = {SEPARABLE: one.right, IN_A_SET: one.holds, HIDDEN_TO_ALL: one.silent}[one.kind]
        if good and not one.wrong_confident and not one.gap > 1.15:
            continue
        names = ", ".join(
            f"{each['name']} {each['probability']:.2f}"
            + "".join(f" / {other['name']} {other['probability']:.2f}" for other in each["alternatives"])
            for each in line["named"]
        )
        answer = line["failure"] or f"{line['verdict']}: {names}; {'; '.join(line.get('reasons', ()))}"
        text.append(
            f"| {line['key']} | {one.kind} | {' '.join(one.true_set[1:])} | {answer[:400]} | {one.gap:.2f} "
            f"| {one.seconds:.0f} |"
        )
    return "\n".join(text)

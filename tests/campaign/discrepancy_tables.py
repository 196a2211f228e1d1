"""The discrepancy campaign as markdown: figures against their goals, the confusion matrix, and single misses."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
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
    if part == "none":
        return _nothing_hidden(lines, truth)
    scores = [score(line, truth[line["key"]]["effects"][name]) for line in lines for name in line["hidden"]]
    return "\n\n".join([_figures(scores, lines), _matrix(scores), _reliability(scores), _misses(scores, lines)])


def _row(what: str, value: str, goal: str, met: bool | None) -> str:
    return f"| {what} | {value} | {goal} | {'' if met is None else 'met' if met else 'MISSED'} |"


def _share(what: str, hits: int, of: int, goal: str, enough: Callable[[float], bool]) -> str:
    if of == 0:
        return _row(what, "no case", goal, None)
    return _row(what, f"{hits} of {of} ({hits / of:.1%})", goal, enough(hits / of))


def _figures(scores: Sequence[Score], lines: Lines) -> str:
    by = {kind: [one for one in scores if one.kind == kind] for kind in CLASSES}
    easy, tied, mute = by[SEPARABLE], by[IN_A_SET], by[HIDDEN_TO_ALL]
    large = {one.hidden for one in easy if one.share == 1.0 and one.gust == 0.0}
    calm = any(one.gust == 0.0 and one.share == 1.0 for one in scores)
    told = [one for one in tied if one.chosen]
    sizes = [len(one.chosen) / len(one.true_set) for one in told]
    gaps = [one.gap for one in scores if math.isfinite(one.gap)]
    inside = [held for one in scores for held in one.inside.values()]
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
        _share("separable: right name first", sum(s.right for s in easy), len(easy), ">= 95 %", lambda x: x >= 0.95),
        _share("not separable: set holds truth", sum(s.holds for s in tied), len(tied), ">= 95 %", lambda x: x >= 0.95),
        _row("mean size of the set over the truth's", f"{np.mean(sizes):.2f}" if sizes else "no case", "<= 1.5",
             bool(np.mean(sizes) <= 1.5) if sizes else None),
        _share("separating manoeuvre named", sum(s.manoeuvre for s in told), len(told), "always", lambda x: x == 1.0),
        _share("not detectable: none or parameter_error", sum(s.silent for s in mute), len(mute), "",
               lambda x: x >= 0.98),
        _share("not detectable: an effect named", sum(bool(s.chosen) and not s.silent for s in mute), len(mute),
               "<= 2 %", lambda x: x <= 0.02),
        _share("wrong name above 0.9", wrong, len(scores), "<= 1 %", lambda x: x <= 0.01),
        _row("effects separable in calm air at the largest size", str(len(large)), ">= 25",
             len(large) >= 25 if calm else None),
        _share("gap held out <= 1.15x the true model's", sum(g <= 1.15 for g in gaps), len(gaps), ">= 95 %",
               lambda x: x >= 0.95),
        _share("95 % intervals hold the effect's parameters", sum(inside), len(inside), "90 to 98 %",
               lambda x: 0.9 <= x <= 0.98),
        _row("median std of those over the bound", f"{np.median(spread):.2f}" if spread else "none", "<= 1.5",
             bool(np.median(spread) <= 1.5) if spread else None),
        _row("expected calibration error", f"{error:.3f}", "<= 0.05", error <= 0.05 if math.isfinite(error) else None),
        _row("seconds a case", f"median {np.median(seconds):.0f}, longest {max(seconds):.0f}" if seconds else "",
             "<= 60", bool(max(seconds) <= 60.0) if seconds else None),
        _row("flights without a result", str(sum(bool(line["failure"]) for line in lines)), "", None),
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


def _nothing_hidden(lines: Lines, truth: Truth) -> str:
    named = [line for line in lines if line["named"]]
    exact = [line for line in lines if line["exact"]]
    off = [line for line in lines if not line["exact"]]
    clear = [line for line in off if truth[line["key"]]["error_sigma"] >= 5.0]
    verdicts = Counter(line["verdict"] or "failed" for line in lines)
    rows = [
        f"{len(lines)} flights without a missing effect: " + ", ".join(f"{k} {n}" for k, n in verdicts.most_common()),
        "",
        "| figure | found | goal | |",
        "|---|---|---|---|",
        _share("an effect named", len(named), len(lines), "<= 1 %", lambda x: x <= 0.01),
        _share("exact baseline: none", sum(line["verdict"] == "none" for line in exact), len(exact), ">= 97 %",
               lambda x: x >= 0.97),
        _share("coefficients off: none or parameter_error", sum(line["verdict"] in ("none", "parameter_error")
               for line in off), len(off), "always", lambda x: x == 1.0),
        _share("of those that stand out: parameter_error", sum(line["verdict"] == "parameter_error" for line in clear),
               len(clear), ">= 95 %", lambda x: x >= 0.95),
        "",
        *(f"- {line['key']}: {line['failure'] or line['verdict']} {[each['name'] for each in line['named']]} "
          f"{'; '.join(line.get('reasons', ()))}" for line in lines if line["named"] or line["failure"]
          or line["verdict"] == "unexplained" or (line["exact"] and line["verdict"] != "none")),
    ]  # fmt: skip
    return "\n".join(rows)

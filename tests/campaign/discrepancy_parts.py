"""The discrepancy campaign's further parts as markdown: nothing hidden, two effects at once, effects off the list."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from discrepancy_scores import CONFIDENT, HIDDEN_TO_ALL, SEPARABLE, class_of

Lines = Sequence[Mapping[str, Any]]
Truth = Mapping[str, Mapping[str, Any]]


def row(what: str, value: str, goal: str, met: bool | None) -> str:
    """A line of a table of figures; met: whether the goal is, None where nothing is asked."""
    return f"| {what} | {value} | {goal} | {'' if met is None else 'met' if met else 'MISSED'} |"


def share(what: str, hits: int, of: int, goal: str, enough: Callable[[float], bool]) -> str:
    """The line of a share."""
    if of == 0:
        return row(what, "no case", goal, None)
    return row(what, f"{hits} of {of} ({hits / of:.1%})", goal, enough(hits / of))


def nothing_hidden(lines: Lines, truth: Truth) -> str:
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
        share("an effect named", len(named), len(lines), "<= 1 %", lambda x: x <= 0.01),
        share("exact baseline: none", sum(line["verdict"] == "none" for line in exact), len(exact), ">= 97 %",
               lambda x: x >= 0.97),
        share("coefficients off: none or parameter_error", sum(line["verdict"] in ("none", "parameter_error")
               for line in off), len(off), "always", lambda x: x == 1.0),
        share("of those that stand out: parameter_error", sum(line["verdict"] == "parameter_error" for line in clear),
               len(clear), ">= 95 %", lambda x: x >= 0.95),
        "",
        *(f"- {line['key']}: {line['failure'] or line['verdict']} {[each['name'] for each in line['named']]} "
          f"{'; '.join(line.get('reasons', ()))}" for line in lines if line["named"] or line["failure"]
          or line["verdict"] == "unexplained" or (line["exact"] and line["verdict"] != "none")),
    ]  # fmt: skip
    return "\n".join(rows)


def pairs(lines: Lines, truth: Truth) -> str:
    """Two effects at once: both found, where the flight tells each beside the other."""
    rows, misses = [], []
    both, asked, wrong = 0, 0, 0
    for line in lines:
        told = truth[line["key"]]["effects"]
        named = {each["name"]: each["probability"] for each in line["named"]}
        false = [name for name, probability in named.items() if name not in told and probability > CONFIDENT]
        wrong += bool(false)
        if any(class_of(told[name], name)[0] != SEPARABLE for name in told):
            continue
        asked += 1
        both += set(told) <= set(named)
        if not set(told) <= set(named) or false:
            misses.append(f"- {line['key']}: {_answer(line)}")
    rows = [
        f"{len(lines)} flights with two effects, {asked} of them with each to be told beside the other.",
        "",
        "| figure | found | goal | |",
        "|---|---|---|---|",
        share("both found", both, asked, ">= 85 %", lambda x: x >= 0.85),
        share("wrong name above 0.9", wrong, len(lines), "<= 1 %", lambda x: x <= 0.01),
        "",
        *misses,
    ]
    return "\n".join(rows)


def off_list(lines: Lines, truth: Truth) -> str:
    """Effects that the job's catalogue lacks, and made-up ones: unexplained, or what cannot be told from them."""
    good, asked, confident, misses = 0, 0, 0, []
    for line in lines:
        allowed: set[str] = set()
        if not line["made_up"]:
            ((name, told),) = truth[line["key"]]["effects"].items()
            kind, true_set = class_of(told, name)
            if kind == HIDDEN_TO_ALL:
                continue
            allowed = set(true_set)
        asked += 1
        wrong = [each for each in line["named"] if each["name"] not in allowed]
        right = not wrong and (bool(line["named"]) or line["verdict"] == "unexplained")
        good += right
        confident += any(each["probability"] > CONFIDENT for each in wrong)
        if not right:
            misses.append(f"- {line['key']}: {_answer(line)}")
    rows = [
        f"{asked} flights that show what is not on the list.",
        "",
        "| figure | found | goal | |",
        "|---|---|---|---|",
        share("unexplained, or what cannot be told from it", good, asked, ">= 90 %", lambda x: x >= 0.9),
        share("wrong name above 0.9", confident, asked, "never", lambda x: x == 0.0),
        "",
        *misses,
    ]
    return "\n".join(rows)


def separating(lines: Lines, truth: Truth) -> str:
    """Effects that one flight could not tell alone, after what the job itself has named to separate them.

    Where a test on the ground measures the very effect that is hidden, the test has told it: the job is handed a model
    with it and must name nothing else.
    """
    measured = [line for line in lines if line.get("bench") in line["hidden"]]
    asked = [line for line in lines if line not in measured]
    right = [line for line in asked if line["named"] and line["named"][0]["name"] in line["hidden"]]
    alone = [line for line in right if not line["named"][0]["alternatives"]]
    silent = [line for line in measured if line["verdict"] in ("none", "parameter_error")]
    flown = sum(bool(line["also"]) for line in asked)
    rows = [
        "| figure | found | goal | |",
        "|---|---|---|---|",
        share(f"right name afterwards ({flown} flown, {len(asked) - flown} with an effect ruled out on the ground)",
              len(right), len(asked), ">= 90 %", lambda x: x >= 0.9),
        share("and alone in its set", len(alone), len(asked), "", lambda x: x >= 0.9),
        share("measured on the ground and put into the model: nothing else is named", len(silent), len(measured), "",
              lambda x: x >= 0.9),
        "",
        *(f"- {line['key']}: {_answer(line)}" for line in lines if line not in right and line not in silent),
    ]  # fmt: skip
    return "\n".join(rows)


def _answer(line: Mapping[str, Any]) -> str:
    names = ", ".join(f"{each['name']} {each['probability']:.2f}" for each in line["named"])
    return f"{line['failure'] or line['verdict']} {names}; {'; '.join(line.get('reasons', ()))[:300]}"


PARTS: Mapping[str, Callable[[Lines, Truth], str]] = {
    "none": nothing_hidden,
    "pairs": pairs,
    "off-list": off_list,
    "separating": separating,
}

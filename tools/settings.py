"""Print docs/reference/settings.md: every number that an analysis rests on, with what the code says of it."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

HEAD = """# Settings of an analysis

Every number that an analysis in `sysid` rests on and that no vehicle file or option gives: limits, sizes of priors,
lengths of time. This page is printed by `python tools/settings.py` from the code, where each stands beside what uses
it; to try another one, change it there. A recording, a vehicle file and a version of this software give the same
result again, since none of these is chosen anew for a flight. Figures without a source were set on simulated flights,
as [methods.md](../explanation/methods.md) and the pages on accuracy say.
"""

_FUNCTIONS = ("np.log", "np.exp", "np.sqrt", "np.radians", "np.deg2rad", "math.log", "math.radians", "float")


@dataclass(frozen=True)
class Group:
    """Settings that share what is said of them. entries: name and value as written."""

    entries: tuple[tuple[str, str], ...]
    meaning: str


def is_number(node: ast.expr | None) -> bool:
    """Whether an expression is a number, or numbers alone."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    if isinstance(node, ast.Tuple | ast.List):
        return bool(node.elts) and all(map(is_number, node.elts))
    if isinstance(node, ast.Dict):
        return bool(node.values) and all(map(is_number, node.values))
    return isinstance(node, ast.Call) and ast.unparse(node.func) in _FUNCTIONS and all(map(is_number, node.args))


def _named(node: ast.Assign | ast.AnnAssign) -> list[tuple[str, str]]:
    """Names of an assignment beside their values."""
    assert node.value is not None
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
        return [
            (ast.unparse(name), ast.unparse(value)) for name, value in zip(target.elts, node.value.elts, strict=True)
        ]
    return [(ast.unparse(target), ast.unparse(node.value))]


def _comment_above(lines: list[str], line: int) -> str:
    """The comment that ends just above a line counted from 1."""
    first = line - 1
    while first > 0 and lines[first - 1].startswith("#"):
        first -= 1
    return " ".join(text.lstrip("#: ") for text in lines[first : line - 1])


def groups(text: str) -> list[Group]:
    """Settings of a module: its numbers by name, and those of its records of numbers."""
    lines = text.splitlines()
    found: list[Group] = []
    end = -1
    for node in ast.parse(text).body:
        if isinstance(node, ast.ClassDef):
            fields = [one for one in node.body if isinstance(one, ast.AnnAssign) and one.value is not None]
            if fields and len(fields) == sum(isinstance(one, ast.AnnAssign) for one in node.body):
                entries = [entry for one in fields if is_number(one.value) for entry in _named(one)]
                if len(entries) == len(fields):
                    found.append(Group(tuple(entries), " ".join((ast.get_docstring(node) or "").split())))
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not is_number(node.value):
            continue
        entries = _named(node)
        _, mark, beside = lines[node.end_lineno - 1].partition("  # ") if node.end_lineno else ("", "", "")
        above = _comment_above(lines, node.lineno)
        if node.lineno == end + 1 and not above and not mark and found:
            found[-1] = Group((*found[-1].entries, *entries), found[-1].meaning)
        else:
            found.append(Group(tuple(entries), beside if mark else above))
        end = node.end_lineno or -1
    return found


def settings() -> dict[str, list[Group]]:
    """Settings of every module of sysid."""
    paths = sorted((ROOT / "sysid").rglob("*.py"))
    every = {path.relative_to(ROOT).as_posix(): groups(path.read_text(encoding="utf-8")) for path in paths}
    return {path: found for path, found in every.items() if found}


def page() -> str:
    """The page as text."""
    rows = [HEAD]
    folder = ""
    for path, found in settings().items():
        if Path(path).parent.as_posix() != folder:
            folder = Path(path).parent.as_posix()
            rows += [f"## {folder}", ""]
        rows += [f"### {Path(path).name}", "", "| setting | value | what it is |", "|---|---|---|"]
        for group in found:
            names = "<br>".join(f"`{name.lstrip('_')}`" for name, _ in group.entries)
            values = "<br>".join(f"`{value}`" for _, value in group.entries)
            rows.append(f"| {names} | {values} | {group.meaning.replace('|', '&#124;')} |")
        rows.append("")
    return "\n".join(rows).rstrip() + "\n"


if __name__ == "__main__":
    print(page(), end="")

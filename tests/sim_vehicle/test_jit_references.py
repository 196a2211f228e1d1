"""Which compiled functions may leave references to arrays uncounted."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LEAN, COUNTING = {"jit", "jit_fused", "jit_inlined"}, {"jit_arrays", "jit_fused_arrays"}


def called(node: ast.Call) -> str:
    """Bare name of what is called, of a module's attribute too."""
    return node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")


def compiled() -> dict[tuple[str, str], tuple[str, set[str], str]]:
    """Every compiled function by module and name: how it is compiled, what it calls, and what it returns."""
    found = {}
    for package in ("sim_vehicle", "sysid", "gcs"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    calls = {called(one) for one in ast.walk(node) if isinstance(one, ast.Call)}
                    returns = ast.unparse(node.returns) if node.returns else ""
                    for mark in {getattr(one, "id", "") for one in node.decorator_list} & (LEAN | COUNTING):
                        found[str(path), node.name] = (mark, calls, returns)
    return found


def test_who_does_not_count_references_is_never_given_an_array_to_keep() -> None:
    """One that is made or returned there would be freed twice, or never."""
    functions = compiled()
    lean = {name: one for name, one in functions.items() if one[0] in LEAN}
    counting = {name for (_, name), one in functions.items() if one[0] in COUNTING}
    assert len(lean) > 100
    assert len(counting) > 20
    assert {name: calls & counting for name, (_, calls, _) in lean.items() if calls & counting} == {}
    parts = {part for _, _, returns in lean.values() for part in re.findall(r"\w+", returns)}
    assert parts <= {"None", "float", "int", "bool", "tuple", "Int"}

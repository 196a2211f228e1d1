"""Which compiled functions may leave references to arrays uncounted."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
LEAN, COUNTING = {"jit", "jit_fused", "jit_inlined"}, {"jit_arrays", "jit_fused_arrays"}


def compiled() -> dict[str, tuple[str, set[str], str]]:
    """Every compiled function: how it is compiled, what it calls, and what it returns."""
    found = {}
    for package in ("sim_vehicle", "sysid", "gcs"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    marks = {getattr(one, "id", "") for one in node.decorator_list} & (LEAN | COUNTING)
                    calls = {
                        one.func.id
                        for one in ast.walk(node)
                        if isinstance(one, ast.Call) and isinstance(one.func, ast.Name)
                    }
                    returns = ast.unparse(node.returns) if node.returns else ""
                    for mark in marks:
                        found[node.name] = (mark, calls, returns)
    return found


def test_who_does_not_count_references_is_never_given_an_array_to_keep() -> None:
    """One that is made or returned there would be freed twice, or never."""
    functions = compiled()
    lean = {name: one for name, one in functions.items() if one[0] in LEAN}
    counting = {name for name, one in functions.items() if one[0] in COUNTING}
    assert len(lean) > 100
    assert len(counting) > 20
    assert {name: calls & counting for name, (_, calls, _) in lean.items() if calls & counting} == {}
    assert [name for name, (_, _, returns) in lean.items() if "rray" in returns] == []

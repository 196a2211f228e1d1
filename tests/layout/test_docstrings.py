"""Numerical functions that other rooms call say shapes, units and errors in the sections that numpydoc knows."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("sim_vehicle", "sysid", "gcs", "flightmodel")
SECTIONS = ("Parameters", "Returns", "Yields", "Raises", "Notes", "References", "Examples")


def modules() -> dict[str, Path]:
    """Module name -> file."""
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in files}


def rooms_that_call(paths: dict[str, Path]) -> dict[tuple[str, str], set[Path]]:
    """(module, name) -> folders whose modules import it."""
    found: dict[tuple[str, str], set[Path]] = defaultdict(set)
    for path in paths.values():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module in paths:
                for alias in node.names:
                    found[node.module, alias.name].add(path.parent)
    return found


def functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions of the numerical packages that take or give arrays and that another room imports."""
    paths = modules()
    called = rooms_that_call(paths)
    for module, path in paths.items():
        if module.startswith("gcs"):
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
                continue
            signature = ast.unparse(node.args) + (ast.unparse(node.returns) if node.returns else "")
            if "Array" in signature and called[module, node.name] - {path.parent}:
                yield f"{module}.{node.name}", node


def sections(docstring: str) -> dict[str, list[str]]:
    """Section -> its lines."""
    lines, found = docstring.splitlines(), {}
    places = [
        i for i, line in enumerate(lines[:-1]) if line in SECTIONS and lines[i + 1] == "-" * len(line)
    ]  # fmt: skip
    for begin, end in zip(places, [*places, len(lines)][1:], strict=True):
        found[lines[begin]] = lines[begin + 2 : end]
    return found


def parameters(node: ast.FunctionDef) -> list[str]:
    """Names of a function's parameters in order."""
    args = node.args
    every = [*args.posonlyargs, *args.args, *([args.vararg] if args.vararg else []), *args.kwonlyargs]
    return [one.arg for one in every if one.arg != "self"]


def faults(node: ast.FunctionDef) -> Iterator[str]:
    """What a function's docstring leaves out or says of what is not there."""
    stated = sections(ast.get_docstring(node) or "")
    lines = stated.get("Parameters", [])
    heads = [line for line in lines if line and not line.startswith(" ")]
    described = [one.strip().lstrip("*") for line in heads for one in line.partition(" : ")[0].split(",")]
    if described != parameters(node):
        yield f"describes {described}, takes {parameters(node)}"
    # Each head is followed by what the parameter is.
    for line in heads:
        after = lines[lines.index(line) + 1 :]
        if " : " not in line or not after or not after[0].startswith("    "):
            yield f"says nothing of {line!r}"
    gives = node.returns is not None and ast.unparse(node.returns) != "None"
    if ("Returns" in stated) != gives:
        yield f"Returns is {'missing' if gives else 'there for nothing'}"
    raised = {
        ast.unparse(one.exc.func if isinstance(one.exc, ast.Call) else one.exc)
        for one in ast.walk(node)
        if isinstance(one, ast.Raise) and one.exc is not None
    }
    if unsaid := raised - {line.strip() for line in stated.get("Raises", [])}:
        yield f"raises {sorted(unsaid)} without a word"


def test_a_numerical_function_describes_what_it_takes_and_gives() -> None:
    found = dict(functions())
    assert len(found) > 60
    said = {name: list(faults(node)) for name, node in found.items()}
    assert {name: what for name, what in said.items() if what} == {}

"""What modules import, by their syntax trees: nothing is executed, so imports in functions and for types count too."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path


def module_name(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path, root: Path, *, at_import_only: bool) -> Iterator[str]:
    """Every dotted name a module imports; `at_import_only` leaves out functions and TYPE_CHECKING blocks."""
    package = path.relative_to(root).parent.parts

    def walk(node: ast.AST) -> Iterator[str]:
        if at_import_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            return
        if at_import_only and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join((*package[: len(package) - node.level + 1], *filter(None, [node.module])))
            base = base if node.level else node.module or ""
            yield from (f"{base}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            yield from walk(child)

    return walk(ast.parse(path.read_text(encoding="utf-8")))


def modules_of(root: Path, package: str) -> list[Path]:
    """Every module of a package, which is named with dots, and of what is in it."""
    return sorted(root.joinpath(*package.split(".")).rglob("*.py"))


def part_of(name: str, package: str) -> str:
    """Which part of a package a dotted name belongs to; empty for the package itself and for names outside it."""
    return name.removeprefix(package + ".").split(".")[0] if name.startswith(package + ".") else ""


def upward_imports(root: Path, package: str, parts: Sequence[str]) -> list[str]:
    """Imports between the parts of a package that do not go to one named before; a part that is not named is last."""
    place = {part: i for i, part in enumerate(parts)}
    found = []
    for path in modules_of(root, package):
        module = module_name(path, root)
        own = part_of(module, package)
        for name in imported(path, root, at_import_only=False):
            part = part_of(name, package)
            inside = name == package or part
            if inside and part != own and place.get(part, len(parts)) >= place.get(own, len(parts)):
                found.append(f"{module} imports {name}")
    return found

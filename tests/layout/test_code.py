"""What holds in every module: effects named where they act, inverses where they are scaled, functions one can call."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest

from sim_vehicle.effects import EFFECTS

ROOT = Path(__file__).resolve().parents[2]
# Where an effect's equation stands, its derivative, and its place in the filter.
ACT = (
    *("sim_vehicle/effects", "sim_vehicle/physics", "sim_vehicle/sensitivities", "sim_vehicle/flight"),
    "sysid/filter_error",
)
# What a model is flown with, reported with, or cannot be differentiated by; columns of a record that bear an effect's
# name; and the estimator with priors, one of whose unknowns is called as an effect is.
NAMED_BESIDE = {
    *("sim_vehicle/vehicle/packed_model.py", "sysid/problem/sensitivities.py", "sysid/live/posterior_window.py"),
    *(f"sysid/posterior/{name}.py" for name in ("estimates", "group_model", "nuisance_priors", "stated_priors")),
    *("sysid/signals/record.py", "sysid/identification/result_file.py", "sysid/design/simulated_flight.py"),
    *("sysid/discrepancy/analysis.py", "sysid/discrepancy/spectrum/comparison.py"),
}
# Inverses outside sysid.numerics: of triangular factors, of scaled matrices, of what has a prior in every direction.
INVERSE = re.compile(r"linalg\.inv\(|pinvh?\(")
INVERT = {
    *("sysid/design/multisine_spectrum.py", "sysid/signals/calibration.py"),
    *("sysid/compatibility/gauss_newton.py", "sysid/live/recursive/spectral_least_squares.py"),
    *("sysid/equation_error/frequency_domain.py", "sysid/equation_error/least_squares.py"),
    *("sysid/equation_error/coefficient_tables.py", "sysid/posterior/smoothing.py", "sysid/posterior/likelihood.py"),
    *("sysid/posterior/analysis.py", "sysid/output_error/structure_error.py"),
}
# A call that nobody reads has more arguments by position.
MOST_ARGUMENTS = 8
MANY_ARGUMENTS = {
    *("output_or_filter_error.maximum_likelihood", "free_run.noise_floor", "sensitivities.tangents"),
    *(
        "predictor._simulate",
        "group_model.__init__",
        "analysis.estimate",
        "analysis._start_search",
        "flight_loop.__init__",
    ),
}


def modules(root: Path, *packages: str) -> Iterator[Path]:
    for package in packages:
        yield from sorted((root / package).rglob("*.py"))


def within(path: Path, root: Path, folders: tuple[str, ...]) -> bool:
    return path.relative_to(root).as_posix().startswith(tuple(f"{folder}/" for folder in folders))


def effects_named(root: Path, excepted: Collection[str] = NAMED_BESIDE) -> list[str]:
    """Modules that name an effect as a literal, where none acts."""
    found = set()
    for path in modules(root, "sim_vehicle", "sysid"):
        if within(path, root, ACT):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in EFFECTS:
                found.add(path.relative_to(root).as_posix())
    return sorted(found - set(excepted))


def inverses(root: Path, excepted: Collection[str] = INVERT) -> list[str]:
    """Modules of sysid that invert a matrix by themselves."""
    found = [path for path in modules(root, "sysid") if not within(path, root, ("sysid/numerics",))]
    texts = {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in found}
    return [name for name, text in texts.items() if INVERSE.search(text) and name not in excepted]


def crowded_calls(root: Path, excepted: Collection[str] = MANY_ARGUMENTS) -> list[str]:
    """Functions that are not compiled and take more arguments by position than a reader counts."""
    found = []
    for path in modules(root, "sim_vehicle", "sysid"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            names = [one.arg for one in (*node.args.posonlyargs, *node.args.args)]
            count = len(names) - (names[:1] in (["self"], ["cls"]))
            compiled = any("jit" in ast.unparse(one) for one in node.decorator_list)
            if count > MOST_ARGUMENTS and not compiled:
                found.append(f"{path.stem}.{node.name}")
    return [name for name in found if name not in excepted]


@pytest.mark.parametrize("check", [effects_named, inverses, crowded_calls])
def test_it_holds_everywhere(check: object) -> None:
    assert callable(check)
    assert check(ROOT) == []


@pytest.mark.parametrize(
    ("check", "path", "text", "found"),
    [
        (effects_named, "sysid/live/a.py", 'X = "stall"\n', ["sysid/live/a.py"]),
        (effects_named, "sim_vehicle/physics/a.py", 'X = "stall"\n', []),
        (inverses, "sysid/live/a.py", "y = np.linalg.inv(A)\n", ["sysid/live/a.py"]),
        (inverses, "sysid/live/a.py", "y = scipy.linalg.pinvh(A)\n", ["sysid/live/a.py"]),
        (inverses, "sysid/numerics/a.py", "y = np.linalg.inv(A)\n", []),
        (crowded_calls, "sysid/live/a.py", "def f(a, b, c, d, e, f, g, h, i): ...\n", ["a.f"]),
        (crowded_calls, "sysid/live/a.py", "@jit\ndef f(a, b, c, d, e, f, g, h, i): ...\n", []),
        (crowded_calls, "sysid/live/a.py", "class A:\n    def f(self, a, b, c, d, e, f, g, h, *, i): ...\n", []),
    ],
)
def test_each_check_sees_what_it_is_for(tmp_path: Path, check: object, path: str, text: str, found: list[str]) -> None:
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).write_text(text, encoding="utf-8")
    assert callable(check)
    assert check(tmp_path) == found


def test_no_exception_is_left_that_is_not_needed() -> None:
    assert set(effects_named(ROOT, ())) == NAMED_BESIDE
    assert set(inverses(ROOT, ())) == INVERT
    assert set(crowded_calls(ROOT, ())) == MANY_ARGUMENTS

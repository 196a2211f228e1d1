"""The folders of sysid and sim_vehicle: their order, what one may import of the other, their size, their names."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from import_walk import imported, module_name, modules_of, part_of, upward_imports

ROOT = Path(__file__).resolve().parents[2]
# Modules and folders of each package (docs/explanation/architecture.md): one may import those named before it.
ORDER = {
    "sysid": (
        *(
            "arrays",
            "errors",
            "numerics",
            "signals",
            "tables",
            "compatibility",
            "signal_check",
            "equation_error",
            "problem",
        ),
        *(
            "output_error",
            "filter_error",
            "posterior",
            "uncertainty",
            "validation",
            "quality",
            "identification",
            "discrepancy",
            "design",
        ),
        "live",
    ),
    "sysid.live": (
        "signals",
        "recursive",
        "signal_requirements",
        "bias_correction",
        "posterior_window",
        "watch",
        "wording",
        "identifier",
    ),
    "sim_vehicle": (
        *(
            "errors",
            "constants",
            "jit",
            "effects",
            "model",
            "manoeuvres",
            "physics",
            "vehicle",
            "sensitivities",
            "flight",
        ),
        *("mavlink", "sitl", "cli"),
    ),
}
# Standard gravity, density at sea level, gas constant of air: in sim_vehicle/constants.py alone.
PHYSICAL_CONSTANTS = (9.80665, 1.225, 287.05287)
# Second names, for users of the library, of modules in the folders. They come last: nothing in a package imports them.
ALIASES = {"sysid": {"calibration", "identify"}, "sim_vehicle": {"__main__"}, "sysid.live": set[str]()}
# What all of sysid may import of sim_vehicle, and what a folder or a module may beside that.
SHARED = ("errors", "constants", "jit", "effects", "model", "physics", "vehicle", "sensitivities")
BESIDE = {
    "sysid.design": ("flight", "manoeuvres"),
    "sysid.identification.linear_model": ("flight.plant", "flight.state", "flight.trim"),
    "sysid.problem.free_run": ("flight.wind",),
}
MOST_MODULES = 16
# One file an effect, so that a new one is a new file.
OF_ANY_SIZE = {"sim_vehicle/effects"}


def within(name: str, packages: Iterable[str]) -> bool:
    """Whether a dotted name is one of the packages or in one of them."""
    return any(name == package or name.startswith(package + ".") for package in packages)


def forbidden_of_the_simulator(root: Path) -> list[str]:
    """Imports of sim_vehicle in sysid that are not allowed to the module they stand in."""
    found = []
    for path in modules_of(root, "sysid"):
        module = module_name(path, root)
        allowed = [*SHARED, *(part for place, more in BESIDE.items() if within(module, [place]) for part in more)]
        for name in imported(path, root, at_import_only=False):
            if within(name, ["sim_vehicle"]) and not within(name, [f"sim_vehicle.{part}" for part in allowed]):
                found.append(f"{module} imports {name}")
    return found


def crowded_folders(root: Path) -> list[str]:
    """Folders with more modules than a reader takes in; `__init__` does not count."""
    found = []
    for package in ("sysid", "sim_vehicle"):
        counts: dict[str, int] = defaultdict(int)
        for path in modules_of(root, package):
            counts[path.parent.relative_to(root).as_posix()] += path.name != "__init__.py"
        found += [f"{folder}: {n}" for folder, n in counts.items() if n > MOST_MODULES and folder not in OF_ANY_SIZE]
    return found


def classes_named_twice(root: Path) -> list[str]:
    """Names of classes that mean two things in sysid, with the modules that define them."""
    places: dict[str, list[str]] = defaultdict(list)
    for path in modules_of(root, "sysid"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module_name(path, root))
    return [f"{name}: {', '.join(modules)}" for name, modules in places.items() if len(modules) > 1]


def unplaced(root: Path) -> list[str]:
    """Modules and folders that the order does not name: a new module belongs in a folder."""
    found: set[str] = set()
    for package, parts in ORDER.items():
        names = {part_of(module_name(path, root), package) for path in modules_of(root, package)}
        found |= {f"{package}.{name}" for name in names - {"", *parts} - ALIASES[package]}
    return sorted(found)


def against_the_order(root: Path) -> list[str]:
    return [line for package, parts in ORDER.items() for line in upward_imports(root, package, parts)]


@pytest.mark.parametrize("package", list(ORDER))
def test_the_order_names_folders_and_modules_that_there_are(package: str) -> None:
    names = {part_of(module_name(path, ROOT), package) for path in modules_of(ROOT, package)}
    assert {*ORDER[package], *ALIASES[package]} <= names


def test_imports_go_one_way_among_the_folders() -> None:
    assert against_the_order(ROOT) == []


def test_identification_imports_of_the_simulator_what_it_simulates_with() -> None:
    assert forbidden_of_the_simulator(ROOT) == []


def test_a_folder_holds_no_more_modules_than_a_reader_takes_in() -> None:
    assert crowded_folders(ROOT) == []


def test_the_name_of_a_class_means_one_thing_in_identification() -> None:
    assert classes_named_twice(ROOT) == []


def test_every_module_stands_in_a_folder() -> None:
    assert unplaced(ROOT) == []


MANY = {f"sysid/signals/m{i}.py": "" for i in range(MOST_MODULES)}


@pytest.mark.parametrize(
    ("check", "files", "found"),
    [
        (
            against_the_order,
            {"sysid/numerics/a.py": "from sysid.live import b\n"},
            ["sysid.numerics.a imports sysid.live.b"],
        ),
        (
            against_the_order,
            {"sysid/signals/a.py": "def late():\n    from ..design import b\n"},
            ["sysid.signals.a imports sysid.design.b"],
        ),
        (
            against_the_order,
            {"sim_vehicle/model/a.py": "if TYPE_CHECKING:\n    import sim_vehicle.cli.main\n"},
            ["sim_vehicle.model.a imports sim_vehicle.cli.main"],
        ),
        (
            against_the_order,
            {"sysid/live/signals/a.py": "from sysid.live.recursive.b import C\n"},
            ["sysid.live.signals.a imports sysid.live.recursive.b.C"],
        ),
        (
            against_the_order,
            {"sysid/live/a.py": "from sysid.identify import identify\n"},
            ["sysid.live.a imports sysid.identify.identify"],
        ),
        (
            against_the_order,
            {"sysid/live/identifier.py": "import sysid.numerics.b\nfrom sysid.live import wording\n"},
            [],
        ),
        (
            forbidden_of_the_simulator,
            {"sysid/live/a.py": "from sim_vehicle.flight.wind import W\nfrom sim_vehicle.jit import jit\n"},
            ["sysid.live.a imports sim_vehicle.flight.wind.W"],
        ),
        (
            forbidden_of_the_simulator,
            {"sysid/design/a.py": "import sim_vehicle.flight\nfrom sim_vehicle.manoeuvres import b, c\n"},
            [],
        ),
        (
            forbidden_of_the_simulator,
            {"sysid/problem/free_run.py": "from sim_vehicle.flight import wind\nfrom sim_vehicle.flight import trim\n"},
            ["sysid.problem.free_run imports sim_vehicle.flight.trim"],
        ),
        (
            forbidden_of_the_simulator,
            {"sysid/signals/a.py": "def late():\n    import sim_vehicle.modelling\n"},
            ["sysid.signals.a imports sim_vehicle.modelling"],
        ),
        (crowded_folders, {**MANY, "sysid/signals/__init__.py": ""}, []),
        (crowded_folders, {**MANY, "sysid/signals/one_more.py": ""}, [f"sysid/signals: {MOST_MODULES + 1}"]),
        (crowded_folders, {name.replace("sysid/signals", "sim_vehicle/effects"): "" for name in [*MANY, "x.py"]}, []),
        (
            classes_named_twice,
            {
                "sysid/signals/a.py": "class One:\n    class Two: ...\n",
                "sysid/live/b.py": "def f():\n    class Two: ...\n",
            },
            ["Two: sysid.live.b, sysid.signals.a"],
        ),
        (
            unplaced,
            {"sysid/new.py": "", "sysid/identify.py": "", "sim_vehicle/more/a.py": "", "sysid/live/b.py": ""},
            ["sim_vehicle.more", "sysid.live.b", "sysid.new"],
        ),
    ],
)
def test_each_check_sees_what_it_is_for(
    tmp_path: Path, check: Callable[[Path], list[str]], files: dict[str, str], found: list[str]
) -> None:
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert check(tmp_path) == found


def constants_written_out(root: Path) -> list[str]:
    """Places in the code where a physical constant stands as a number."""
    found = []
    for package in ("gcs", "sysid", "sim_vehicle"):
        for path in sorted((root / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            numbers = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and type(node.value) is float)
            found += [
                f"{path.relative_to(root)}:{node.lineno} {node.value}"
                for node in numbers
                if node.value in PHYSICAL_CONSTANTS and path.relative_to(root) != Path("sim_vehicle/constants.py")
            ]
    return found


def test_physical_constants_are_defined_once() -> None:
    assert constants_written_out(ROOT) == []


def test_a_constant_written_out_is_found(tmp_path: Path) -> None:
    for package in ("gcs", "sysid", "sim_vehicle"):
        (tmp_path / package).mkdir()
    (tmp_path / "sysid" / "weight.py").write_text("def weight(mass):\n    return mass * 9.80665\n")
    assert constants_written_out(tmp_path) == ["sysid/weight.py:2 9.80665"]


def test_the_stages_of_identification_name_modules_that_are_there() -> None:
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    stages = text.split("## Parts of identification")[1].split("Imports go down")[0]
    named = set(re.findall(r"\b([a-z_]+)\.([a-z_]+)\b", stages))
    assert len(named) > 5
    assert [f"{room}.{module}" for room, module in named if not (ROOT / "sysid" / room / f"{module}.py").exists()] == []

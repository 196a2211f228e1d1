"""Imports go one way, sim_vehicle <- sysid <- gcs <- flightmodel and among gcs' parts; no module needs itself."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from import_walk import imported, module_name, upward_imports

ROOT = Path(__file__).resolve().parents[2]
MAY_IMPORT = {
    "sim_vehicle": {"sim_vehicle"},
    "sysid": {"sim_vehicle", "sysid"},
    "gcs": {"sim_vehicle", "sysid", "gcs"},
    "flightmodel": {"sim_vehicle", "sysid", "gcs", "flightmodel"},
}
# The parts of gcs (docs/explanation/architecture.md): each may import those named before it.
PARTS = (
    *(
        "errors",
        "version",
        "allocator",
        "portable",
        "text",
        "mavlink",
        "links",
        "clock",
        "recording",
        "settings",
        "flights",
        "analysis",
    ),
    *(
        "importers",
        "formats",
        "inspection",
        "report",
        "exports",
        "tuning",
        "catalogue",
        "vehicles",
        "priors",
        "design",
        "jobs",
        "station",
        "live",
        "page",
        "access",
        "fleet",
    ),
    *("api", "serve", "client", "demo", "options", "commands", "cli", "__main__"),
)


def sources(root: Path) -> list[Path]:
    return [path for package in MAY_IMPORT for path in sorted((root / package).rglob("*.py"))]


def wrong_directions(root: Path) -> list[str]:
    return [
        f"{module_name(path, root)} imports {name}"
        for path in sources(root)
        for name in imported(path, root, at_import_only=False)
        if (top := name.split(".")[0]) in MAY_IMPORT and top not in MAY_IMPORT[path.relative_to(root).parts[0]]
    ]


def import_cycle(root: Path) -> list[str]:
    """Modules of one cycle of imports, or nothing. A package's __init__ counts only where named itself."""
    modules = {module_name(path, root): path for path in sources(root)}
    graph: dict[str, set[str]] = {}
    for module, path in modules.items():
        found = set()
        for name in imported(path, root, at_import_only=True):
            target = name if name in modules else name.rpartition(".")[0]
            if target in modules and target != module:
                found.add(target)
        graph[module] = found
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_imports_go_one_way() -> None:
    assert len(sources(ROOT)) > 5
    assert wrong_directions(ROOT) == []


def test_imports_go_one_way_among_the_parts_of_the_ground_station() -> None:
    folder = ROOT / "gcs"
    named = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert named - {"__init__"} == set(PARTS)
    assert upward_imports(ROOT, "gcs", PARTS) == []


def test_no_module_imports_itself_through_others() -> None:
    assert import_cycle(ROOT) == []


def test_the_walk_sees_wrong_directions_and_cycles(tmp_path: Path) -> None:
    for name, text in {
        "sim_vehicle/a.py": "from sim_vehicle import b\n",
        "sim_vehicle/b.py": "def late():\n    from sim_vehicle import a\n    import gcs.c\n",
        "sysid/d.py": "from . import e\n",
        "sysid/e.py": "if True:\n    from sysid.d import thing\n",
        "gcs/c.py": "import sysid.d\n",
        "gcs/low/f.py": "def late():\n    from gcs.high import g\n",
        "gcs/high/g.py": "from gcs.low.f import late\nfrom gcs.high import h\nfrom gcs.new import i\n",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert wrong_directions(tmp_path) == ["sim_vehicle.b imports gcs.c"]
    upward = ["gcs.high.g imports gcs.new.i", "gcs.low.f imports gcs.high.g"]
    assert upward_imports(tmp_path, "gcs", ("c", "low", "high")) == upward
    assert sorted(set(import_cycle(tmp_path))) == ["sysid.d", "sysid.e"]

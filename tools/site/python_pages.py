"""The reference of the Python packages: a page for each module, made from its docstrings, and one that lists them."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGES = ("flightmodel", "sim_vehicle", "sysid", "gcs")
_HEAD = """# Python

Four packages, imports one way: `sim_vehicle <- sysid <- gcs <- flightmodel`
([architecture](../../explanation/architecture.md)).
Arrays are numpy's, in SI units and radians; `(n,)` and the like in a docstring are shapes. What begins with an
underscore is internal. `flightmodel` is the public face ([how to use it](../../howto/python.md)); what stands there
changes with major versions alone. Where to begin:

| to | use |
|---|---|
| go from a table or a log to a model | [`flightmodel`](flightmodel.md) |
| identify a model from signals | [`sysid.identify`](sysid.identification.identify.md) |
| name what a model lacks | [`sysid.discrepancy`](sysid.discrepancy.analysis.md) |
| fit a bench curve | [`sysid.calibration`](sysid.signals.calibration.md) |
| predict a flight's error bars | [`sysid.design`](sysid.design.prediction.md) |
| read a recording | [`gcs.recording.reader`](gcs.recording.reader.md) |
| get the signals of a flight | [`gcs.flights.signals`](gcs.flights.signals.md) |
| run a job as the commands do | [`gcs.analysis.postflight`](gcs.analysis.postflight.md) |
| ask a running station | [`gcs.client`](gcs.client.md) |
| simulate | [`sim_vehicle.physics.simulation`](sim_vehicle.physics.simulation.md) |
| fly a plan | [`sim_vehicle.flight.flight_loop`](sim_vehicle.flight.flight_loop.md) |
| read models | [`sim_vehicle.model.model_file`](sim_vehicle.model.model_file.md) |
| read vehicle files | [`sim_vehicle.vehicle.vehicle_file`](sim_vehicle.vehicle.vehicle_file.md) |
"""
_PAGE = """# {name}

::: {name}
    options:
      show_root_heading: false
"""


def pages(root: Path) -> dict[str, str]:
    """Every page by its path in the site's sources. root: folder of the packages."""
    made: dict[str, str] = {}
    index = [_HEAD]
    for package in PACKAGES:
        index.append(f"## {package}\n\n| module | |\n|---|---|")
        for path in sorted((root / package).rglob("*.py")):
            name = _module(path.relative_to(root))
            if name.rsplit(".", 1)[-1].startswith("_"):
                continue
            index.append(f"| [`{name}`]({name}.md) | {_first_line(path)} |")
            made[f"reference/python/{name}.md"] = _PAGE.format(name=name)
        index.append("")
    made["reference/python/index.md"] = "\n".join(index)
    return made


def _module(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _first_line(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ").replace("|", "\\|")

"""Folders of XML that programs read as an aircraft."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from gcs.errors import ExportError
from sim_vehicle.vehicle.controls import Control
from sim_vehicle.vehicle.vehicle_file import Vehicle

#: Travel of a surface of which the vehicle file has deflections alone, rad.
USUAL_TRAVEL = 0.5


def file_name(vehicle: Vehicle) -> str:
    """The vehicle's name as one that files and programs take."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", vehicle.name).strip("-") or "aircraft"


def travel_of(control: Control) -> tuple[float, float]:
    """The least and largest deflection, rad."""
    return control.limits if control.servos else (-USUAL_TRAVEL, USUAL_TRAVEL)


def write_folder(folder: Path, trees: Mapping[str, ElementTree.Element]) -> None:
    """Write documents by their places in the folder. Raises ExportError where that cannot be."""
    try:
        for place, tree in trees.items():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            ElementTree.indent(tree)
            ElementTree.ElementTree(tree).write(folder / place, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise ExportError(f"{folder}: cannot be written: {error.strerror}; give another place") from None

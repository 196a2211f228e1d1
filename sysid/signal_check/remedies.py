"""What to do about a signal that a bench calibration gives: its scale stands there, and not in [signals]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from sim_vehicle.vehicle.sensors import CalibrationSource
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signal_check.fault import Mistake
from sysid.signals.calibration import UNITS
from sysid.signals.preparation import Prepared
from sysid.signals.sensor_groups import joined

# A factor is known about as well as the units that were tried for it lie apart.
_NEAR = 0.1


def named_cures(found: Sequence[Mistake], flight: Prepared, vehicle: Vehicle) -> list[Mistake]:
    """The mistakes, those of calibrated signals with the keys of the vehicle file that mend them."""
    return [_cured(one, vehicle) if set(one.signals) <= set(flight.calibrations) else one for one in found]


def _cured(mistake: Mistake, vehicle: Vehicle) -> Mistake:
    tables = {name: table for name in mistake.signals if (table := _table(name, vehicle)) is not None}
    if len(tables) < len(mistake.signals):
        return mistake
    alone = len(tables) == 1
    what = joined(mistake.signals)
    comes = f"{'comes' if alone else 'come'} from {joined([f'[calibration.{key}]' for key, _ in tables.values()])}"
    if mistake.kind == "sign":
        wrong = f"{'has' if alone else 'have'} the wrong sign"
        cure = "change the sign of the references there"
    elif mistake.kind == "axis":
        wrong, cure = "are exchanged", "exchange the sources there"
    elif mistake.kind in ("unit", "scale") and mistake.found > 0.0:
        wrong = f"{'is' if alone else 'are'} {1.0 / mistake.found:.3g} times what the motion asks for"
        units = "; ".join(_unit_words(name, source, mistake.found) for name, (_, source) in tables.items())
        cure = f"check unit ({units}) and bench points there"
    else:
        return mistake
    return replace(mistake, sentence=f"{what} {wrong} and {comes}: {cure}")


def _table(name: str, vehicle: Vehicle) -> tuple[str, CalibrationSource] | None:
    """The table of the vehicle file that a signal comes from: airspeed may come from a calibrated pressure."""
    keys = (name, "differential_pressure") if name == "airspeed" else (name,)
    return next(((key, vehicle.calibration[key]) for key in keys if key in vehicle.calibration), None)


def _unit_words(name: str, source: CalibrationSource, factor: float) -> str:
    """The unit as given, and that of the same quantity which would make up for the factor."""
    quantity, given = UNITS[source.unit]
    root = 0.5 if name == "airspeed" and quantity == "Pa" else 1.0
    for unit, (other, size) in UNITS.items():
        if unit and other == quantity and unit != source.unit:
            change = (size / given) ** root
            if abs(math.log(change / factor)) < _NEAR:
                return f"{source.unit} is given, {unit} would fit"
    return f"{source.unit or 'none'} is given"

"""A calibrated signal's mistake is mended where its calibration stands."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import pytest

from sim_vehicle.vehicle.sensors import CalibrationSource
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.signal_check.fault import Mistake
from sysid.signal_check.remedies import named_cures
from sysid.signals.preparation import Prepared


class Flight:
    """What is asked of a prepared flight."""

    calibrations = dict.fromkeys(("airspeed", "alpha", "beta", "thrust"))


def told(mistake: Mistake, **calibration: str) -> str:
    """The sentence where these signals are calibrated in these units."""
    tables = {key: CalibrationSource("adc0", "linear", (), unit) for key, unit in calibration.items()}
    vehicle = replace(load_vehicle("iitb-mav"), calibration=tables)
    (one,) = named_cures([mistake], cast(Prepared, Flight()), vehicle)
    return one.sentence


def mistake(kind: str, found: float, *signals: str) -> Mistake:
    return Mistake(signals[0], kind, found, "", "scale it in [signals]", signals)


@pytest.mark.parametrize(
    ("found", "calibration", "words"),
    [
        (
            mistake("unit", 0.3048, "airspeed"),
            {"airspeed": "mmH2O"},
            "airspeed is 3.28 times what the motion asks for and comes from [calibration.airspeed]: check unit (mmH2O"
            " is given, Pa would fit) and bench points there",
        ),
        (
            mistake("unit", 0.3048, "airspeed"),
            {"differential_pressure": "mmH2O"},
            "[calibration.differential_pressure]",
        ),
        (mistake("unit", 0.00981, "thrust"), {"thrust": "N"}, "(N is given, gf would fit)"),
        (mistake("unit", 0.0175, "alpha"), {"alpha": "rad"}, "(rad is given, deg would fit)"),
        (mistake("scale", 0.7, "alpha"), {"alpha": "deg"}, "alpha is 1.43 times what the motion asks for"),
        (mistake("sign", float("nan"), "beta"), {"beta": "deg"}, "change the sign of the references there"),
        (
            mistake("axis", float("nan"), "alpha", "beta"),
            {"alpha": "deg", "beta": "deg"},
            "alpha and beta are exchanged and come from [calibration.alpha] and [calibration.beta]: exchange",
        ),
        (mistake("unit", 57.3, "alpha"), {"beta": "deg"}, "scale it in [signals]"),
        (mistake("unit", 57.3, "p"), {"beta": "deg"}, "scale it in [signals]"),
    ],
)
def test_the_cure_names_the_calibration(found: Mistake, calibration: dict[str, str], words: str) -> None:
    assert words in told(found, **calibration)

"""Units as people write them, against factors from the definitions (NIST SP 811)."""

import math

import pytest

from sysid.errors import TableError
from sysid.tables.units import is_unit, unit_of


@pytest.mark.parametrize(
    ("text", "wanted", "value", "si"),
    [
        ("deg", "rad", 180.0, math.pi),
        ("°", "rad", 90.0, math.pi / 2),
        ("deg/s", "rad/s", 1.0, math.pi / 180.0),
        ("rad_sec", "rad/s", 2.0, 2.0),
        ("rad s-1", "rad/s", 2.0, 2.0),
        ("ft/sec^2", "m/s^2", 1.0, 0.3048),
        ("g", "m/s^2", -1.0, -9.80665),
        ("g", "N", 125.0, 1.2258312),
        ("m/s/s", "m/s^2", 3.0, 3.0),
        ("kts", "m/s", 1.0, 0.514444),
        ("KIAS", "m/s", 1.0, 0.514444),
        ("mph", "m/s", 1.0, 0.44704),
        ("km/h", "m/s", 36.0, 10.0),
        ("ft/min", "m/s", 1000.0, 5.08),
        ("psf", "Pa", 1.0, 47.88026),
        ("psi", "Pa", 1.0, 6894.757),
        ("inHg", "Pa", 29.92, 101320.7),
        ("slug/ft^3", "kg/m^3", 0.0023769, 1.225),
        ("degC", "K", 15.0, 288.15),
        ("degF", "K", 59.0, 288.15),
        ("R", "K", 518.67, 288.15),
        ("lbf", "N", 1.0, 4.4482216),
        ("rpm", "1/min", 100.0, 100.0),
        ("rad/s", "1/min", 2.0 * math.pi, 60.0),
        ("%", "1", 50.0, 0.5),
        ("ms", "s", 20.0, 0.02),
        ("us", "us", 1500.0, 1500.0),
        ("percent", "1", 50.0, 0.5),
        ("seconds", "s", 2.0, 2.0),
        ("deg/second", "rad/s", 180.0, math.pi),
        ("degrees per second", "rad/s", 180.0, math.pi),
        ("us", "s", 1e6, 1.0),
    ],
)
def test_a_unit_is_what_its_definition_says(text: str, wanted: str, value: float, si: float) -> None:
    unit = unit_of(text, wanted, "x")
    assert unit.si == wanted
    assert unit.factor * value + unit.offset == pytest.approx(si, rel=1e-5)


@pytest.mark.parametrize(("text", "wanted"), [("furlong", "m"), ("deg", "m/s"), ("norm", "rad"), ("", "rad")])
def test_what_is_no_unit_of_it_is_refused_with_those_that_are(text: str, wanted: str) -> None:
    with pytest.raises(TableError, match="usual ones are") as refused:
        unit_of(text, wanted, "alpha")
    assert str(refused.value).startswith("alpha")


def test_words_that_are_no_units_are_none() -> None:
    assert [text for text in ("deg", "left", "raw", "m/s", "vane") if is_unit(text)] == ["deg", "m/s"]

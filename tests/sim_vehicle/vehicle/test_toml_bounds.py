"""Texts of vehicle files that would take gigabytes to read, refused before they are."""

import time
from pathlib import Path

import pytest

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.toml_bounds import check_bounds
from sim_vehicle.vehicle.vehicle_file import VEHICLES, load_vehicle, vehicle_from_text

_DOTTED = ".".join(40_000 * "a")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{_DOTTED} = 1", "a key has more than 8 dots in line 1"),
        (f"\n[{_DOTTED}]", "a key has more than 8 dots in line 2"),
        (f"x = {{ {_DOTTED} = 1 }}", "a key has more than 8 dots in line 1"),
        (" . ".join(20_000 * ['"a"']) + " = 1", "a key has more than 8 dots in line 1"),
        (f"#\r{_DOTTED} = 1", "a key has more than 8 dots in line 1"),
        (f'x = "\\""\n{_DOTTED} = 1', "a key has more than 8 dots in line 2"),
        (f'x = {{ y = """"""", {_DOTTED} = 1 }}', "a key has more than 8 dots in line 1"),
        (f"x = {{ y = ''''''', {_DOTTED} = 1 }}", "a key has more than 8 dots in line 1"),
        ("".join(f"a.b.c.d.e.f.g.h.k{k} = 1\n" for k in range(4000)), "more than 50 keys have dots in line 51"),
        (f"x = {90_000 * '['}", "its lists are nested too deep in line 1"),
        (f"x = {30_000 * '{a='}", "its lists are nested too deep in line 1"),
        (50_000 * "\n", "it has more than 20000 lines"),
    ],
    ids=[
        "key",
        "header",
        "inline",
        "quoted",
        "return",
        "escape",
        "quotes",
        "apostrophes",
        "many",
        "lists",
        "tables",
        "lines",
    ],
)
def test_what_would_take_gigabytes_is_refused_in_a_line(text: str, said: str) -> None:
    began = time.process_time()
    with pytest.raises(VehicleFileError) as refused:
        vehicle_from_text(text, Path("plane.toml"))
    assert str(refused.value).startswith(f"plane.toml: is not a vehicle file: {said}; ")
    assert "\n" not in str(refused.value)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize("text", [99_999 * '"', 99_999 * "'", 50_000 * '"\\', 20_000 * '"""a', 20_000 * "'''a"])
def test_a_text_that_never_ends_is_looked_at_once(text: str) -> None:
    began = time.process_time()
    check_bounds(text, "plane.toml")
    assert time.process_time() - began < 1.0


def test_dots_and_brackets_in_texts_and_remarks_are_none_of_keys() -> None:
    held = 100 * ".[{"
    check_bounds(f"# {held}\na.b.c.d.e.f.g.h.i = \"{held}\"\nb = '''\n{held}'''\nc = [{2000 * '1.5, '}]", "plane.toml")
    for path in VEHICLES.glob("*.toml"):
        assert load_vehicle(path).name

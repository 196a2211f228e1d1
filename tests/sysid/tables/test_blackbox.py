"""Logs of INAV's and Betaflight's Blackbox as CSV, laid out by hand as blackbox_decode writes them.

Fields, units and axes: INAV's blackbox.c and imu.c (forward, left, up; pitch nose down; velocities north, east, up).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importers.table import import_table
from sysid.errors import TableError
from sysid.signals.flight import FlightSignals
from sysid.tables.files import read_table
from sysid.tables.flight_table import flight_from_table

HEAD = (
    "loopIteration,time (us),axisRate[0],axisP[0],rcCommand[0],rcCommand[3],vbat (V),BaroAlt (cm),AirSpeed,"
    "gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],accSmooth[1],accSmooth[2],attitude[0],attitude[1],attitude[2],"
    "motor[0],servo[0],servo[2],navState,navPos[0],navPos[1],navPos[2],navVel[0],navVel[1],navVel[2],"
    "flightModeFlags (flags),stateFlags (flags),failsafePhase (flags)"
)
ROW = (
    "{i},{t},0,1,0,1450,12.1,{alt},1830,"
    "{p},-20,30,205,102,-2048,-150,-35,3590,"
    "1500,1490,1610,1,100,200,12345,1200,-300,150,"
    "{flags},GPS_FIX,IDLE"
)
ACC = "# H acc_1G:2048\n"


def written(tmp_path: Path, before: str = ACC, head: str = HEAD, glue: str = ",", row: str = ROW) -> Path:
    lines = [
        # Of a mode no word is there but "0" while none is on.
        row.format(i=i, t=16_131_890 + 10_000 * i, alt=12_000 + i, p=i % 7, flags="ANGLE_MODE" if i == 5 else "0")
        for i in range(60)
    ]
    text = "\n".join([head.replace(",", glue), *(line.replace(",", glue) for line in lines)])
    path = tmp_path / "LOG00001.01.csv"
    path.write_text(before + text + "\n")
    return path


def flight(path: Path, **given: object) -> FlightSignals:
    table = read_table(path)
    return flight_from_table(table.name, *table.matched(**given))  # type: ignore[arg-type]


def middle(found: FlightSignals) -> dict[str, float]:
    return {key: float(one.values[7]) for key, one in found.signals.items()}


EXPECTED = {
    "p": 0.0,
    "q": np.radians(20.0),
    "r": np.radians(-30.0),
    "ax": 205 * 9.80665 / 2048,
    "ay": -102 * 9.80665 / 2048,
    "az": 9.80665,
    "phi": np.radians(-15.0),
    "theta": np.radians(3.5),
    "psi": np.radians(359.0),
    "airspeed": 18.30,
    "altitude": 120.07,
    "vn": 12.0,
    "ve": -3.0,
    "vd": -1.5,
    "servo1": 1490.0,
    "servo3": 1610.0,
}


@pytest.mark.parametrize("glue", [",", ", "])
def test_fields_are_signals_in_our_axes_and_si_units(tmp_path: Path, glue: str) -> None:
    found = middle(flight(written(tmp_path, glue=glue)))
    assert found == pytest.approx(EXPECTED, rel=1e-12, abs=1e-12)


def test_settings_before_the_header_as_blackbox_explorer_writes_them(tmp_path: Path) -> None:
    before = '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"acc_1G","2048"\n'
    head = ",".join(f'"{cell.split(" (")[0]}"' for cell in HEAD.split(","))
    assert middle(flight(written(tmp_path, before, head))) == pytest.approx(EXPECTED, rel=1e-12, abs=1e-12)


def test_an_accelerometer_without_its_scale_is_no_guess(tmp_path: Path) -> None:
    path = written(tmp_path, before="")
    with pytest.raises(TableError, match=r"acc_1G.*'accSmooth\[0\]': 'g/2048'") as caught:
        flight(path)
    assert "\n" not in str(caught.value)
    given = dict.fromkeys(("ax", "ay", "az"), "g/512")
    found = middle(flight(path, units=given))
    assert found["az"] == pytest.approx(4 * 9.80665)
    assert found["ay"] == pytest.approx(-102 * 9.80665 / 512)


def test_the_import_says_what_to_write_in_the_file_of_columns(tmp_path: Path) -> None:
    path = written(tmp_path, before="")
    with pytest.raises(ImportFileError, match=r"acc_1G.*--columns.*\"accSmooth\[0\]\" = \"g/2048\"") as caught:
        import_table(path, tmp_path / "a.mcap")
    assert "\n" not in str(caught.value)
    mapping = tmp_path / "map.toml"
    mapping.write_text('[units]\nax = "g/2048"\nay = "g/2048"\naz = "g/2048"\n')
    import_table(path, tmp_path / "a.mcap", columns=mapping)


def test_units_that_the_decoder_turned_are_those_of_the_header(tmp_path: Path) -> None:
    head = HEAD.replace("time (us)", "time (s)").replace("BaroAlt (cm)", "BaroAlt (m)")
    for axis in range(3):
        head = head.replace(f"gyroADC[{axis}]", f"gyroADC[{axis}] (rad/s)")
        head = head.replace(f"accSmooth[{axis}]", f"accSmooth[{axis}] (m/s/s)")
    row = ROW.replace("{t},", "{i}.0,").replace("-20,30,205,102,-2048", "-0.2,0.3,1.0,0.5,9.7")
    found = flight(written(tmp_path, "", head, row=row))
    values = middle(found)
    assert (values["q"], values["r"], values["ay"], values["az"]) == pytest.approx((0.2, -0.3, -0.5, -9.7))
    assert values["altitude"] == pytest.approx(12_007.0)
    assert found.signals["q"].time_s[-1] == pytest.approx(59.0)


BETAFLIGHT = "loopIteration,time (us),axisP[0],setpoint[0],gyroADC[0],gyroADC[1],gyroADC[2],motor[0]"
BETAFLIGHT_ROW = "{i},{t},1,0,{p},-20,30,1500"


def test_the_gyro_of_betaflight_has_the_unit_of_its_settings(tmp_path: Path) -> None:
    path = written(tmp_path, "", BETAFLIGHT, row=BETAFLIGHT_ROW)
    with pytest.raises(TableError, match=r"--unit-rotation deg/s.*'gyroADC\[0\]': 'deg/s'"):
        flight(path)
    for setting, scale in (("0", 1.0), ("1", 0.1)):
        path = written(tmp_path, f"H blackbox_high_resolution:{setting}\n", BETAFLIGHT, row=BETAFLIGHT_ROW)
        assert middle(flight(path))["q"] == pytest.approx(scale * np.radians(20.0))


def test_what_the_user_names_goes_before(tmp_path: Path) -> None:
    path = written(tmp_path)
    found = middle(flight(path, columns={"servo9": "motor[0]", "altitude": "navPos[2]"}, units={"servo9": "us"}))
    assert (found["servo9"], found["altitude"]) == pytest.approx((1500.0, 123.45))
    assert middle(flight(path, columns={"phi": "attitude[0]"}))["phi"] == pytest.approx(np.radians(-15.0))
    with pytest.raises(TableError, match="units = 'SI' out"):
        flight(path, units="SI")

"""A second sensor of a kind is one row of one table: flown, sent, recorded, known to tables, averaged with the first.

The packages are copied, since tables that hang on it are made when they are imported.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAST = '    "airspeed2": SecondSensor("airspeed", "airspeed", "airspeed2", "m/s"),\n'
ROW = '    "q2": SecondSensor("q", "gyro", "gyro2", "rad/s"),\n'
JOB = """
import json, subprocess, sys
from pathlib import Path
import numpy as np
from gcs.flights.signals import extract
from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main as sim_vehicle
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.signals.preparation import prepare

folder = Path(load_vehicle("iitb-mav").path).parent
text = (folder / "iitb-mav.toml").read_text()
at = text.index("[sensors]") + len("[sensors]")
text = text[:at] + "\\nairspeed2 = { position = [0.05, 0.3, 0.0] }\\ngyro2 = { position = [0.0, 0.0, 0.0] }" + text[at:]
Path("two.toml").write_text(text)
for name in folder.iterdir():
    if name.suffix in (".toml", ".csv") and not Path(name.name).exists():
        Path(name.name).write_bytes(name.read_bytes())
sim_vehicle(["fly", "--vehicle", "two.toml", "--model", "iitb-mav", "--manoeuvre", "multisine", "--duration", "20",
             "--record", "flight.mcap"])
vehicle = load_vehicle("two.toml")
flight = extract(Recording(Path("flight.mcap")), vehicle)
prepared = prepare(flight, vehicle)
print(json.dumps({
    "rates": {n: flight.signals[n].time_s.size / 20.0 for n in ("airspeed2", "q2")},
    "units": {n: flight.signals[n].unit for n in ("airspeed2", "q2")},
    "shares": {n: prepared.shares[n] for n in ("airspeed", "airspeed2", "q", "q2")},
    "between": float(np.std(np.interp(flight.signals["airspeed"].time_s, flight.signals["airspeed2"].time_s,
                                      flight.signals["airspeed2"].values) - flight.signals["airspeed"].values)),
}))
"""


@pytest.mark.whole_flight
def test_a_second_sensor_is_one_row(tmp_path: Path) -> None:
    for package in ("sim_vehicle", "sysid", "gcs"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    table = tmp_path / "sim_vehicle" / "vehicle" / "second_sensors.py"
    text = table.read_text(encoding="utf-8")
    assert text.count(LAST) == 1
    table.write_text(text.replace(LAST, LAST + ROW), encoding="utf-8")
    there = {**os.environ, "PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    ran = subprocess.run(
        [sys.executable, "-c", JOB], check=False, cwd=tmp_path, env=there, capture_output=True, text=True, timeout=550
    )
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout.splitlines()[-1])
    assert found["units"] == {"airspeed2": "m/s", "q2": "rad/s"}
    assert min(found["rates"].values()) > 40.0
    # Noise of the first one: half of each.
    assert found["shares"] == pytest.approx({"airspeed": 0.5, "airspeed2": 0.5, "q": 0.5, "q2": 0.5}, abs=0.1)
    # The arm of 0.3 m at a yaw rate of some tenths of a rad/s, beside noise of 0.02 m/s in each.
    assert 0.02 * 2**0.5 < found["between"] < 0.3

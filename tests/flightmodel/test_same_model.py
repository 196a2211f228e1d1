"""One flight as a MAVLink recording, as JSBSim's CSV and as SIDPAC's .mat gives one model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas
import pytest
from scipy.io import loadmat

from flightmodel import Aircraft, Flight, Identification, identify
from gcs.analysis.postflight import identify as identify_recordings
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.recording.reader import Recording
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight
OF_JSBSIM = {
    "airspeed": "velocities/vc-kts", "thrust": "propulsion/engine/thrust-lbs", "rpm": "propulsion/engine/engine-rpm",
    "throttle": "fcs/throttle-pos",
}  # fmt: skip
UNITS = {"airspeed": "kn", "thrust": "lbf", "rpm": "rpm"}
WITHIN = 1e-6  # of a standard error
MAP = """[columns]
airspeed = "velocities/vc-kts"
thrust = "propulsion/engine/thrust-lbs"
rpm = "propulsion/engine/engine-rpm"
throttle = "fcs/throttle-pos"
[units]
airspeed = "kn"
thrust = "lbf"
rpm = "rpm"
"""


def apart(one: dict[str, float], other: dict[str, float], stds: dict[str, float]) -> float:
    assert one.keys() == other.keys()
    return max(abs(one[name] - other[name]) / stds[name] for name in stds)


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return Aircraft.read("ultrastick25e")


def test_the_table_of_jsbsim_gives_the_recording_s_model(
    jsbsim_csv: Path, identified: Identification, aircraft: Aircraft
) -> None:
    flight = Flight.from_frame(pandas.read_csv(jsbsim_csv), columns=OF_JSBSIM, units=UNITS)
    found = identify(flight, aircraft, progress=False)
    assert len(found.values) > 20
    assert apart(found.values, identified.values, identified.stds) < WITHIN
    assert apart(found.stds, identified.stds, identified.stds) < WITHIN


def test_so_it_does_once_it_was_imported(
    jsbsim_csv: Path, recording: Path, recorded: FlightSignals, aircraft: Aircraft, tmp_path: Path
) -> None:
    columns, target = tmp_path / "map.toml", tmp_path / "flight.mcap"
    columns.write_text(MAP)
    import_file(jsbsim_csv, target, columns=columns)
    imported = extract(Recording([target]), aircraft.vehicle)
    for name in ("ax", "q", "phi", "alpha", "airspeed", "vn", "thrust", "rpm", "de", "throttle", "air_density"):
        one, other = imported.signals[name], recorded.signals[name]
        assert one.time_s == pytest.approx(other.time_s, abs=1e-12), name
        assert one.values == pytest.approx(other.values, rel=1e-12, abs=1e-14), name
    results = [identify_recordings([path], aircraft.vehicle.path) for path in (recording, target)]
    ours, theirs = (result["model"]["coefficients"] for result in results)
    stds = {name: entry["std"] for name, entry in theirs.items() if "std" in entry}
    assert len(stds) > 20
    assert (
        apart(
            *({name: entry["value"] for name, entry in one.items() if "std" in entry} for one in (ours, theirs)), stds
        )
        < WITHIN
    )
    assert results[1]["senders"][target.stem]["type"] == "fixed wing"


def test_the_array_of_sidpac_gives_the_recording_s_model(
    sidpac_mat: Path, recorded: FlightSignals, aircraft: Aircraft
) -> None:
    """The array has no ground velocity, pressure, throttle or rpm: the recording is asked without them too."""
    flight = Flight.read(sidpac_mat)
    kept = {name: one for name, one in recorded.signals.items() if name in {*flight.signals.signals, "airspeed"}}
    there = Flight(replace(recorded, signals=kept), aircraft=aircraft)
    # By a quick method: what is compared is what it gets.
    ours, theirs = (identify(one, aircraft, method="oe", progress=False) for one in (flight, there))
    assert len(theirs.stds) > 20
    assert apart(ours.values, theirs.values, theirs.stds) < WITHIN


def test_the_array_of_sidpac_describes_its_aircraft(sidpac_mat: Path, aircraft: Aircraft) -> None:
    found = Aircraft.from_fdata(loadmat(sidpac_mat)["fdata"])
    assert (found.mass, found.span, found.chord) == pytest.approx(
        (aircraft.mass, aircraft.span, aircraft.chord), rel=1e-9
    )
    assert found.area == pytest.approx(aircraft.area, rel=1e-9)
    assert found.vehicle.mass.Iyy == pytest.approx(aircraft.vehicle.mass.Iyy, rel=1e-9)

"""Folders of topics' CSV files: PX4's as pyulog's ulog2csv writes them, ROS' laid out as `rostopic echo -p` does."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pyulog.ulog2csv import convert_ulog2csv
from ulog_writer import a_log

from gcs.cli import main
from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.importers import ulog
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals


def read(source: Path, target: Path, **given: Path) -> FlightSignals:
    import_file(source, target, **given)  # type: ignore[arg-type]
    return extract(Recording(target), Vehicle.unknown())


@pytest.fixture
def px4(tmp_path: Path) -> Path:
    (tmp_path / "log_12.ulg").write_bytes(a_log().bytes())
    folder = tmp_path / "exported"
    folder.mkdir()
    convert_ulog2csv(str(tmp_path / "log_12.ulg"), "", str(folder), ",", None, None)
    return folder


def test_px4_topics_are_the_flight_of_the_log_that_they_come_from(px4: Path, tmp_path: Path) -> None:
    assert (px4 / "log_12_vehicle_attitude_0.csv").is_file()
    expected = read(tmp_path / "log_12.ulg", tmp_path / "a.mcap")
    found = read(px4, tmp_path / "b.mcap")
    assert found.signals.keys() == expected.signals.keys() >= {"p", "az", "phi", "airspeed", "static_pressure"}
    for key, one in expected.signals.items():
        # Stamps are on UTC in both; values passed through as many digits as the exporter writes.
        np.testing.assert_allclose(found.signals[key].time_s, one.time_s, atol=1e-9)
        np.testing.assert_allclose(found.signals[key].values, one.values, rtol=1e-6, atol=1e-6, err_msg=key)
    notes = Recording(tmp_path / "b.mcap").metadata()["import"]
    assert notes["not_mapped"] == "log_12_cpuload_0"
    (attached,) = Recording(tmp_path / "b.mcap").attachments()
    assert attached.name == "exported.tar.zst"


def test_commands_take_the_folder(px4: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(px4)]) == 0
    assert "ATTITUDE" in capsys.readouterr().out


def test_two_logs_in_a_folder_are_refused(px4: Path, tmp_path: Path) -> None:
    (px4 / "log_13_vehicle_attitude_0.csv").write_text((px4 / "log_12_vehicle_attitude_0.csv").read_text())
    with pytest.raises(ImportFileError, match="same topic of two logs: one log in a folder"):
        import_file(px4, tmp_path / "a.mcap")
    assert not (tmp_path / "a.mcap").exists()


START_NS = 1_531_943_611_000_000_000
LOG = "carbonZ_2018-07-18-15-53-31_1_engine_failure"


def topic(folder: Path, name: str, fields: dict[str, object], hz: float, stamped: bool = True) -> None:
    """A topic received 20 ms after its stamp; fields: what a row holds, or a function of its time."""
    folder.mkdir(exist_ok=True)
    head = ["%time", *(["field.header.seq", "field.header.stamp", "field.header.frame_id"] if stamped else [])]
    lines = [",".join([*head, *(f"field.{key}" for key in fields)])]
    for i in range(int(4 * hz)):
        stamp = START_NS + round(1e9 * i / hz)
        cells = [stamp + 20_000_000, *([i, stamp, "base_link"] if stamped else [])]
        cells += [value(i / hz) if callable(value) else value for value in fields.values()]
        lines.append(",".join(map(str, cells)))
    (folder / f"{LOG}-{name}.csv").write_text("\n".join(lines) + "\n")


IMU: dict[str, object] = {
    # Forward, left, up over east, north, up: nose up by 0.2 rad to the north is a turn about z, then about y.
    **{"orientation.x": 0.0, "orientation.y": 0.0, "orientation.z": 0.0, "orientation.w": 1.0},
    **{f"orientation_covariance{i}": 0.0 for i in range(9)},
    **{"angular_velocity.x": 0.1, "angular_velocity.y": 0.2, "angular_velocity.z": lambda t: 0.3 * t},
    **{f"angular_velocity_covariance{i}": 0.0 for i in range(9)},
    **{"linear_acceleration.x": 1.0, "linear_acceleration.y": 2.0, "linear_acceleration.z": 9.8},
    **{f"linear_acceleration_covariance{i}": 0.0 for i in range(9)},
}


@pytest.fixture
def ros(tmp_path: Path) -> Path:
    folder = tmp_path / "flight"
    topic(folder, "mavros-imu-data", IMU, 50.0)
    topic(folder, "mavros-imu-atm_pressure", {"fluid_pressure": lambda t: 95_000.0 + t, "variance": 0.0}, 20.0)
    topic(folder, "mavros-rc-out", {f"channels{i}": 1500 + i if i < 4 else 0 for i in range(8)}, 25.0)
    topic(folder, "mavros-rc-in", {"rssi": 90, **{f"channels{i}": 1100 for i in range(8)}}, 25.0)
    hud = {"airspeed": 18.5, "groundspeed": 17.0, "heading": 90, "throttle": 0.5, "altitude": 90.0, "climb": 0.0}
    topic(folder, "mavros-vfr_hud", hud, 25.0)
    topic(folder, "mavros-nav_info-roll", {"commanded": 5.0, "measured": lambda t: 3.0 + t}, 25.0)
    topic(folder, "failure_status-engines", {"data": 1}, 5.0, stamped=False)
    return folder


def test_ros_topics_are_signals_at_their_own_stamps(ros: Path, tmp_path: Path) -> None:
    found = read(ros, tmp_path / "a.mcap")
    values = {key: float(one.values[5]) for key, one in found.signals.items()}
    expected = {"p": 0.1, "q": -0.2, "r": -0.03, "ax": 1.0, "ay": -2.0, "az": -9.8, "phi": 0.0, "theta": 0.0}
    expected |= {"psi": np.pi / 2, "static_pressure": 95_000.25, "airspeed": 18.5, "servo1": 1500.0, "servo4": 1503.0}
    assert {key: values[key] for key in expected} == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert not {"servo5", "de", "temperature"} & values.keys()
    np.testing.assert_allclose(np.diff(found.signals["q"].time_s), 0.02, atol=2e-6)
    np.testing.assert_allclose(np.diff(found.signals["static_pressure"].time_s), 0.05, atol=2e-6)
    assert Recording(tmp_path / "a.mcap").start_ns == pytest.approx(START_NS, abs=10**9)
    unused = Recording(tmp_path / "a.mcap").metadata()["import"]["unused"]
    assert unused == "/failure_status/engines, /mavros/nav_info/roll, /mavros/rc/in"


def test_a_field_that_no_message_defines_the_unit_of_is_named_by_the_user(ros: Path, tmp_path: Path) -> None:
    columns = tmp_path / "map.toml"
    columns.write_text('[columns]\nphi = "/mavros/nav_info/roll.measured"\n[units]\nphi = "deg"\n')
    found = read(ros, tmp_path / "a.mcap", columns=columns)
    assert found.signals["phi"].values[25] == pytest.approx(np.radians(4.0))
    columns.write_text('[columns]\nphi = "/mavros/nav_info/roll.measured"\n')
    with pytest.raises(ImportFileError, match=r"unit of /mavros/nav_info/roll\.measured is not known"):
        import_file(ros, tmp_path / "b.mcap", columns=columns)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"a.txt": "x"}, "is a folder; name a file in it, or a folder of a log's topics"),
        ({"a.csv": "time,alpha_deg\n0,1\n"}, "no topics of PX4 .* nor of ROS"),
        ({"a.csv": ""}, "no topics of PX4"),
        ({"l_vehicle_attitude_0.csv": "timestamp,q[0]\n1,2\n1\n1,2\n"}, "row 3 has 1 cells, the header 2"),
        ({"l_vehicle_attitude_0.csv": "timestamp,q[0]\n"}, "holds no message that can be read"),
        ({"l_imu.csv": "%time,field.x\n1000,2\n"}, "none of its messages is one of sensor_msgs/Imu"),
    ],
)
def test_other_folders_are_refused_in_one_line(tmp_path: Path, files: dict[str, str], words: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    with pytest.raises(ImportFileError, match=words) as caught:
        import_file(folder, tmp_path / "a.mcap")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "a.mcap").exists()


def test_every_topic_that_px4s_mapping_asks_for_is_known_by_its_files_name(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = set()

    def note(self: object, name: str, *fields: str, number: int = 0) -> None:
        asked.add(name)

    monkeypatch.setattr(ulog._Mapping, "_topic", note)
    log = SimpleNamespace(
        data_list=[], initial_parameters={}, changed_parameters=[], logged_messages=[], dropouts=[],
        file_corruption=False, start_timestamp=0,
    )  # fmt: skip
    ulog.mapped(log)
    assert {"vehicle_attitude", "airspeed_validated", "sensor_gps"} < asked
    assert asked | {"actuator_outputs"} == set(ulog.TOPICS)

"""PX4's onboard logs come in as standard messages, held against the values written by the format's specification."""

import random
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog
from ulog_writer import BOOT_US, UTC_US, UlogWriter, a_log

from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import export_file, import_file
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import load_vehicle


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    source = tmp_path / "flight.ulg"
    source.write_bytes(a_log().bytes())
    import_file(source, tmp_path / "flight.mcap")
    return Recording(tmp_path / "flight.mcap")


def test_the_log_made_here_is_one_to_pyulog(tmp_path: Path) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(a_log().bytes())
    log = ULog(str(path))
    assert not log.file_corruption
    assert {entry.name for entry in log.data_list} >= {"sensor_combined", "actuator_outputs", "cpuload"}


def test_every_message_has_the_values_and_units_of_the_log(recording: Recording) -> None:
    (imu,) = recording.columns("HIGHRES_IMU", system=9)
    moved = imu.fields[(imu["fields_updated"] & 0b111111) == 0b111111]
    t = 0.01 * np.arange(400)
    assert moved["time_usec"].tolist() == [BOOT_US + 10_000 * i for i in range(400)]
    np.testing.assert_allclose(moved["ygyro"], -0.2 * t, atol=1e-6)
    np.testing.assert_allclose(moved["zacc"], -9.8, rtol=1e-6)
    (attitude,) = recording.columns("ATTITUDE")
    np.testing.assert_allclose(attitude["yaw"], 0.5 * t[::5], atol=1e-6)
    (main, aux) = (c.fields for c in [recording.columns("SERVO_OUTPUT_RAW")[0]] for _ in range(2))
    assert main[main["port"] == 0]["servo1_raw"].tolist() == list(range(1100, 1500, 5))
    assert set(main[main["port"] == 0]["servo5_raw"].tolist()) == {0}  # only four outputs are in use
    assert set(aux[aux["port"] == 1]["servo1_raw"].tolist()) == {1900}
    (gps,) = recording.columns("GPS_RAW_INT")
    assert {name: int(gps[name][0]) for name in ("lat", "lon", "alt", "vel", "cog", "epv")} == {
        **{"lat": 453_000_000, "lon": -1_228_000_000, "alt": 85_000, "vel": 1250, "cog": 27_000, "epv": 110},
    }
    (parameters,) = recording.columns("PARAM_VALUE")
    values = dict(zip(parameters.text("param_id"), parameters.fields, strict=True))
    assert values["FW_AIRSPD_TRIM"]["param_value"] == 15.5
    assert values["MAV_SYS_ID"]["param_value"].view(np.int32) == 9
    assert (values["MAV_SYS_ID"]["param_type"], values["FW_AIRSPD_TRIM"]["param_type"]) == (6, 9)
    (texts,) = recording.columns("STATUSTEXT")
    assert (texts.text("text")[0], texts["severity"][0]) == ("[commander] Arming denied", 4)


def test_the_signals_are_those_of_a_flight(recording: Recording) -> None:
    signals = extract(recording, load_vehicle("iitb-mav")).signals
    np.testing.assert_allclose(signals["airspeed"].values, 14.0 + 0.05 * np.arange(80), rtol=1e-6)
    np.testing.assert_allclose(signals["differential_pressure"].values, 120.0, rtol=1e-6)
    np.testing.assert_allclose(signals["static_pressure"].values, 100_125.0, rtol=1e-6)
    np.testing.assert_allclose(signals["temperature"].values, 293.15, atol=0.01)  # the air's, not the barometer's
    np.testing.assert_allclose(signals["altitude"].values, 101.5)
    np.testing.assert_allclose(signals["vd"].values, -0.125)
    np.testing.assert_allclose(signals["servo4"].values, 1400.0)


def imported(tmp_path: Path, log: UlogWriter) -> Recording:
    source, target = tmp_path / "own.ulg", tmp_path / "own.mcap"
    source.write_bytes(log.bytes())
    import_file(source, target)
    return Recording(target)


def airspeed_log(raw_every: int, validated_every: int) -> UlogWriter:
    """Ten seconds in steps of 50 ms: the sensor indicates 15 m/s, which is calibrated to 18, selected is sensor 2."""
    log = UlogWriter()
    log.topic("airspeed", "float indicated_airspeed_m_s", "float air_temperature_celsius", instances=2)
    log.topic(
        "airspeed_validated",
        *("float indicated_airspeed_m_s", "float calibrated_airspeed_m_s"),
        "uint8_t airspeed_source",
    )
    for i in range(200):
        now = BOOT_US + 50_000 * i
        if raw_every and i % raw_every == 0:
            log.add("airspeed", now, 3.0, -1000.0, instance=0)
            log.add("airspeed", now, 15.0, -1000.0, instance=1)
        if validated_every and i % validated_every == 0:
            # From sensor 2; at times nothing is selected, or what the wind estimate says.
            source = 0 if i % 25 == 0 else 2
            log.add("airspeed_validated", now, 15.0, 99.0 if source == 0 else 18.0 if i % 3 else np.nan, source)
    return log


@pytest.mark.parametrize(
    ("raw_every", "validated_every", "count", "speed", "note"),
    [
        (1, 4, 200, 18.0, "indicated, times 1.2000, the median calibrated / indicated of airspeed_validated"),
        (20, 4, 32, 18.0, None),
        (0, 4, 32, 18.0, None),
        (4, 0, 50, 3.0, "indicated: the log does not calibrate it"),
    ],
)
def test_airspeed_is_calibrated_and_from_the_denser_topic(
    tmp_path: Path, raw_every: int, validated_every: int, count: int, speed: float, note: str | None
) -> None:
    recording = imported(tmp_path, airspeed_log(raw_every, validated_every))
    (airspeed,) = recording.columns("AIRSPEED")
    assert airspeed["airspeed"].size == count
    np.testing.assert_allclose(airspeed["airspeed"], speed, rtol=1e-6)
    assert set(airspeed["temperature"].tolist()) == {32767}  # PX4's -1000 is "unknown", and so is this
    assert recording.metadata()["import"].get("airspeed") == note


def test_stamps_are_those_of_the_samples_unless_they_are_damaged(tmp_path: Path) -> None:
    log = UlogWriter()
    log.topic("vehicle_attitude", "uint64_t timestamp_sample", "float[4] q")
    late_us = [0, 3_000, 499_999, 500_000, -1_000, BOOT_US]
    for i, late in enumerate(late_us):
        now = BOOT_US + 1_000_000 * i
        log.add("vehicle_attitude", now, now - late, 1.0, 0.0, 0.0, 0.0)
    (attitude,) = imported(tmp_path, log).columns("ATTITUDE")
    told = attitude["time_boot_ms"].tolist()
    assert told == [30_000, 30_997, 31_500, 33_000, 34_000, 35_000]


@pytest.mark.parametrize(
    ("air", "source", "own", "expected"),
    [
        (5.0, 2, 40.0, 278.15),  # another sensor's
        (15.0, 0, 40.0, 313.15),  # a standard day's is not measured: the barometer's own stands in
        (15.0, 0, -1000.0, None),
    ],
)
def test_air_temperature_is_measured_or_unknown(
    tmp_path: Path, air: float, source: int, own: float, expected: float | None
) -> None:
    log = UlogWriter()
    fields = ("float baro_pressure_pa", "float ambient_temperature", "uint8_t temperature_source")
    log.topic("vehicle_air_data", *fields, "float baro_temp_celcius")
    for i in range(50):
        log.add("vehicle_air_data", BOOT_US + 100_000 * i, 95_000.0, air, source, own)
    recording = imported(tmp_path, log)
    signals = extract(recording, load_vehicle("iitb-mav")).signals
    note = recording.metadata()["import"].get("temperature", "")
    assert ("density comes out too low" in note) == (source == 0 and expected is not None)
    if expected is None:
        assert "temperature" not in signals
        assert "air_density" not in signals
        (scaled,) = recording.columns("SCALED_PRESSURE")
        assert set(scaled["temperature"].tolist()) == {32767}
    else:
        np.testing.assert_allclose(signals["temperature"].values, expected, atol=0.01)
        np.testing.assert_allclose(signals["air_density"].values, 95_000.0 / (287.05287 * expected), rtol=1e-4)


def test_clock_and_arming(recording: Recording) -> None:
    assert recording.start_ns == UTC_US * 1000
    (beats,) = recording.columns("HEARTBEAT")
    armed = [
        (round((t - recording.start_ns) / 1e9, 3), bool(flags & 128))
        for t, flags in zip(beats.log_time, beats["base_mode"], strict=True)
    ]
    assert armed == [(0.0, False), (1.0, True), (2.0, True), (3.0, False)]
    assert set(beats["autopilot"].tolist()) == {12}
    assert set(beats["type"].tolist()) == {1}


def test_what_is_left_out_is_named_and_the_log_itself_is_kept(recording: Recording, tmp_path: Path) -> None:
    notes = recording.metadata()["import"]
    assert (notes["format"], notes["not_mapped"], notes["damaged"]) == ("ulog", "cpuload", "no")
    export_file(recording.path, tmp_path / "again.ulg")
    assert (tmp_path / "again.ulg").read_bytes() == (tmp_path / "flight.ulg").read_bytes()


def test_a_log_cut_off_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    log = a_log()
    whole, path, target = log.bytes(), tmp_path / "a.ulg", tmp_path / "a.mcap"
    counts = []
    for cut in range(len(log.definitions) + 600, len(whole), 9_973):
        path.write_bytes(whole[:cut])
        import_file(path, target)
        counts.append(sum(Recording(target).counts().values()))
        target.unlink()
    assert counts == sorted(counts)
    assert counts[-1] > 800


@pytest.mark.parametrize("seed", range(8))
def test_damage_is_survived_or_refused_in_one_line(tmp_path: Path, seed: int) -> None:
    chooser = random.Random(seed)
    data = bytearray(a_log().bytes())
    for _ in range(chooser.choice((1, 10, 200))):
        data[chooser.randrange(16, len(data))] ^= 1 << chooser.randrange(8)
    path, target = tmp_path / "a.ulg", tmp_path / "a.mcap"
    path.write_bytes(data)
    refusal = ""
    try:
        import_file(path, target)
    except ImportFileError as error:
        refusal = str(error)
    assert "\n" not in refusal
    assert target.exists() == (not refusal)
    if not refusal:
        recording = Recording(target)
        assert (recording.end_ns - recording.start_ns) / 1e9 < 7200.0


@pytest.mark.parametrize(
    "content", [b"", b"no log at all, but text", random.Random(1).randbytes(100_000), a_log().definitions[:16]]
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(content)
    with pytest.raises(ImportFileError, match=r"a\.ulg") as error:
        import_file(path, tmp_path / "a.mcap")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a.mcap").exists()


def test_without_sensor_combined_its_filtered_sensors_stand_there(tmp_path: Path) -> None:
    log = UlogWriter()
    log.topic("vehicle_acceleration", "float[3] xyz")
    log.topic("vehicle_angular_velocity", "float[3] xyz")
    for i in range(200):
        log.add("vehicle_angular_velocity", BOOT_US + 20_000 * i, 0.01 * i, 0.2, 0.3)
        log.add("vehicle_acceleration", BOOT_US + 20_000 * i + 3_000, 1.0, 2.0, -9.8 + 0.01 * i)
    source = tmp_path / "flight.ulg"
    source.write_bytes(log.bytes())
    import_file(source, tmp_path / "flight.mcap")
    signals = extract(Recording(tmp_path / "flight.mcap"), load_vehicle("iitb-mav")).signals
    np.testing.assert_allclose(signals["p"].values, 0.01 * np.arange(200), atol=1e-6)
    np.testing.assert_allclose(signals["az"].values, -9.8 + 0.01 * np.arange(200), rtol=1e-6)
    assert signals["az"].time_s[0] - signals["p"].time_s[0] == pytest.approx(0.003, abs=1e-6)

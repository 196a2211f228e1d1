"""ArduPilot's onboard logs come in as standard messages, held against pymavlink's reader and the values written."""

import math
import random
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from dataflash import BOOT_US, UTC_US, WEEK, WEEK_MS, DataflashWriter, a_log
from pymavlink.DFReader import DFReader_binary

from gcs.catalogue.store import Catalogue
from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import export_file, import_file
from gcs.importers.dataflash import read_dataflash
from gcs.inspection.clocks import clocks
from gcs.jobs.uploads import Uploads
from gcs.recording.reader import Recording
from gcs.settings import Settings
from sim_vehicle.vehicle.vehicle_file import load_vehicle


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    source = tmp_path / "flight.BIN"
    source.write_bytes(a_log().data)
    import_file(source, tmp_path / "flight.mcap")
    return Recording(tmp_path / "flight.mcap")


def test_every_message_has_the_values_and_units_of_the_log(recording: Recording) -> None:
    (imu,) = recording.columns("HIGHRES_IMU", system=7, component=1)
    moved = (imu["fields_updated"] & 0b111111) == 0b111111
    first = imu.fields[moved & (imu["id"] == 0)]
    t = 0.02 * np.arange(first.size)
    assert first["time_usec"].tolist() == [BOOT_US + 20_000 * i for i in range(200)]
    np.testing.assert_allclose(first["xgyro"], 0.1 * t, atol=1e-6)
    np.testing.assert_allclose(first["zacc"], -9.75 + t, rtol=1e-6)
    assert np.all(imu.fields[moved & (imu["id"] == 1)]["yacc"] == 9.0)
    (attitude,) = recording.columns("ATTITUDE")
    np.testing.assert_allclose(attitude["roll"], np.radians(10.0 * t), atol=1e-4)
    np.testing.assert_allclose(attitude["yaw"], math.radians(-10.0), atol=1e-6)
    assert np.all(np.isnan(attitude["rollspeed"]))
    (servos,) = recording.columns("SERVO_OUTPUT_RAW")
    assert servos["servo1_raw"].tolist() == list(range(1500, 1700))
    (gps,) = recording.columns("GPS_RAW_INT")
    assert {name: int(gps[name][0]) for name in ("lat", "lon", "alt", "vel", "cog", "eph", "fix_type")} == {
        **{"lat": -353_626_277, "lon": 1_491_653_034, "alt": 588_820, "vel": 1250, "cog": 9000, "eph": 77},
        "fix_type": 3,
    }
    (pressure,) = recording.columns("SCALED_PRESSURE")
    assert (float(pressure["press_abs"][0]), int(pressure["temperature"][0])) == (941.4425048828125, 2100)
    (airspeed,) = recording.columns("AIRSPEED")
    assert float(airspeed["airspeed"][0]) == 15.5
    (angles,) = recording.columns("AOA_SSA")
    assert (angles["aoa"][0], angles["ssa"][0]) == (3.0, -1.0)


def test_clocks_texts_parameters_and_arming(recording: Recording) -> None:
    assert recording.start_ns == UTC_US * 1000
    (clock,) = recording.columns("SYSTEM_TIME")
    assert clock["time_unix_usec"][0] == UTC_US
    assert clock["time_boot_ms"][0] == BOOT_US // 1000
    (parameters,) = recording.columns("PARAM_VALUE")
    assert dict(zip(parameters.text("param_id").tolist(), parameters["param_value"].tolist(), strict=True)) == {
        "SYSID_THISMAV": 7.0,
        "TRIM_ARSPD_CM": 1500.0,
    }
    (texts,) = recording.columns("STATUSTEXT")
    assert "".join(texts.text("text")) == "ArduPlane V4.5.1 (deadbeef) and more than fifty letters"
    assert texts["chunk_seq"].tolist() == [0, 1]
    (beats,) = recording.columns("HEARTBEAT")
    armed = [
        (round((t - recording.start_ns) / 1e9, 3), bool(flags & 128))
        for t, flags in zip(beats.log_time, beats["base_mode"], strict=True)
    ]
    assert armed == [(0.0, False), (1.0, False), (1.0, True), (2.0, True), (3.0, True), (3.0, False)]
    assert set(beats["autopilot"].tolist()) == {3}
    assert set(beats["type"].tolist()) == {1}
    assert set(beats["custom_mode"].tolist()) == {5}


def test_the_signals_are_those_of_a_flight(recording: Recording) -> None:
    signals = extract(recording, load_vehicle("iitb-mav")).signals
    t = signals["p"].time_s
    np.testing.assert_allclose(signals["p"].values, 0.1 * (t - t[0]), atol=1e-5)
    np.testing.assert_allclose(signals["differential_pressure"].values, 147.0, rtol=1e-5)
    np.testing.assert_allclose(signals["static_pressure"].values, 94_144.25, rtol=1e-6)
    np.testing.assert_allclose(signals["temperature"].values, 294.15, atol=0.01)  # the air's, not the barometer's
    np.testing.assert_allclose(signals["rpm"].values, 5000 + np.arange(200))
    np.testing.assert_allclose(signals["ve"].values, 12.5, atol=1e-6)
    np.testing.assert_allclose(signals["servo2"].values, 1400)
    assert "alpha" not in signals  # ArduPilot's AOA is an estimate


def imported(tmp_path: Path, log: DataflashWriter) -> Recording:
    source, target = tmp_path / "own.bin", tmp_path / "own.mcap"
    source.write_bytes(log.data)
    import_file(source, target)
    return Recording(target)


@pytest.mark.parametrize(("pitot", "celsius", "unknown"), [(5.25, 5.25, False), (0.0, 36.5, True)])
def test_the_barometers_own_temperature_stands_in_only_where_the_air_is_unknown(
    tmp_path: Path, pitot: float, celsius: float, unknown: bool
) -> None:
    log = DataflashWriter()
    log.declare("ARSP", "QBffcffBBB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Pri")
    log.declare("BARO", "QBffcf", "TimeUS,I,Alt,Press,Temp,CRt")
    for i in range(50):
        log.add("ARSP", BOOT_US + 100_000 * i, 0, 15.0, 140.0, pitot, 0.0, 0.0, 1, 1, 0)
        log.add("BARO", BOOT_US + 100_000 * i + 50, 0, 12.0, 95_000.0, 36.5, 0.0)
    recording = imported(tmp_path, log)
    flight = extract(recording, load_vehicle("iitb-mav"))
    signals = flight.signals
    np.testing.assert_allclose(signals["air_density"].values, 95_000.0 / (287.05287 * (celsius + 273.15)), rtol=1e-4)
    (airspeed,) = recording.columns("AIRSPEED")
    assert set(airspeed["temperature"].tolist()) == {32767 if unknown else 525}
    assert ("density comes out too low" in recording.metadata()["import"].get("temperature", "")) == unknown
    assert any("density comes out too low" in warning for warning in flight.warnings) == unknown


def test_the_instance_that_the_autopilot_used_counts(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("ARSP", "QBffcffBBB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Pri")
    log.declare("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.declare("XKF1", "QBffffff", "TimeUS,C,PN,PE,PD,VN,VE,VD")
    log.declare("XKF4", "QBb", "TimeUS,C,PI")
    log.declare("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    for i in range(50):
        now = BOOT_US + 100_000 * i
        primary = 0 if i < 5 else 1
        for number in (0, 1):
            log.add("ARSP", now, number, 10.0 + number, 140.0, 20.0, 0.0, 0.0, 1, 1, primary)
            place = (-35.0 - number, 149.0, 500.0, 12.5, 90.0)
            log.add("GPS", now, number, 3, WEEK_MS + 100 * i, WEEK, 11, 0.77, *place, 0.0, 0.0, number == primary)
            log.add("XKF1", now, number, *[1.0 + number] * 6)
            log.add("XKF4", now, number, primary)
        log.add("IMU", now, 1, 0.5, 0.0, 0.0, 0.0, 0.0, -9.8)
        log.add("IMU", now, 2, 9.0, 0.0, 0.0, 0.0, 0.0, -9.8)
    recording = imported(tmp_path, log)
    signals = extract(recording, load_vehicle("iitb-mav")).signals
    assert set(signals["airspeed"].values.tolist()) == {11.0}
    np.testing.assert_allclose(signals["lat"].values, -36.0)
    np.testing.assert_allclose(signals["vd"].values, 2.0)
    np.testing.assert_allclose(signals["p"].values, 0.5)
    notes = recording.metadata()["import"]
    assert notes["imu"] == "instance 1 is the first that was logged, and given as 0"
    assert set(notes["not_mapped"].split()) >= {"ARSP[0]", "GPS[0]"}


def test_a_sensor_of_turns_that_is_not_healthy_says_nothing(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("RPM", "QBffB", "TimeUS,I,RPM,Qual,H")
    for i, (rpm, healthy) in enumerate([(5000.0, 1), (-1.0, 0), (4000.0, 0), (-1.0, 1), (0.0, 1)]):
        log.add("RPM", BOOT_US + 100_000 * i, 0, rpm, 0.9, healthy)
    (turns,) = imported(tmp_path, log).columns("RPM")
    np.testing.assert_array_equal(turns["rpm1"], [5000.0, np.nan, np.nan, np.nan, 0.0])


def test_a_sensor_of_turns_that_never_saw_any_is_none(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("RPM", "QBffB", "TimeUS,I,RPM,Qual,H")
    log.declare("ATT", "QccccC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw")
    for i, rpm in enumerate([-1.0, 0.0, 0.0]):
        log.add("RPM", BOOT_US + 100_000 * i, 0, rpm, 0.9, 1)
        log.add("ATT", BOOT_US + 100_000 * i, 0.0, 10.0, 0.0, -2.5, 350.0)
    signals = extract(imported(tmp_path, log), load_vehicle("iitb-mav")).signals
    assert "phi" in signals
    assert "rpm" not in signals


def test_what_is_left_out_is_named_and_the_log_itself_is_kept(recording: Recording, tmp_path: Path) -> None:
    notes = recording.metadata()["import"]
    assert notes["format"] == "dataflash"
    assert notes["source"] == "flight.BIN"
    assert notes["not_mapped"].split() == ["BARO[1]", "ODD"]
    export_file(recording.path, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "flight.BIN").read_bytes()


def test_tables_are_those_of_pymavlinks_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(a_log().data)
    ours = read_dataflash(path).tables
    reader = DFReader_binary(str(path))
    counts = dict.fromkeys(ours, 0)
    while (message := reader.recv_msg()) is not None:
        name = message.get_type()
        table = ours[name]
        for field in message.get_fieldnames():
            value = getattr(message, field)
            if isinstance(value, str):
                assert table.texts(field)[counts[name]] == value
            elif name != "FMT":
                assert table.values(field)[counts[name]] == pytest.approx(value, rel=1e-12)
        counts[name] += 1
    reader.close()
    assert counts == {name: len(table) for name, table in ours.items()}


@pytest.mark.parametrize("seed", range(3))
def test_damage_costs_what_it_hits_and_is_counted(tmp_path: Path, seed: int) -> None:
    chooser = random.Random(seed)
    whole = a_log().data
    head = whole.index(b"\xa3\x95", 14 * 89)
    path = tmp_path / "a.bin"
    path.write_bytes(whole)
    usual = {name: len(table) for name, table in read_dataflash(path).tables.items()}
    data = bytearray(whole[:head])
    junk = 0
    rest = whole[head:]
    cuts = sorted(chooser.sample(range(len(rest)), 20))
    for start, stop in zip([0, *cuts], [*cuts, len(rest)], strict=True):
        noise = chooser.randbytes(chooser.randint(1, 400))
        junk += len(noise)
        data += rest[start:stop] + noise
    path.write_bytes(data)
    log = read_dataflash(path)
    found = {name: len(table) for name, table in log.tables.items()}
    lost = sum(usual.values()) - sum(found.values())
    assert 0 <= lost <= 2 * 21
    assert log.skipped + log.unfinished >= junk
    import_file(path, tmp_path / "a.mcap")
    recorded = Recording(tmp_path / "a.mcap")
    assert int(recorded.metadata()["import"]["skipped_bytes"]) == log.skipped
    assert (recorded.end_ns - recorded.start_ns) / 1e9 == pytest.approx(4.0, abs=0.5)


def test_a_log_cut_off_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    whole = a_log(1.0).data
    path, target = tmp_path / "a.bin", tmp_path / "a.mcap"
    for cut in range(1500, len(whole), 911):
        path.write_bytes(whole[:cut])
        import_file(path, target)
        assert Recording(target).metadata()["import"]["skipped_bytes"] == "0"
        target.unlink()


def test_a_wild_time_is_left_out(tmp_path: Path) -> None:
    log = a_log(1.0)
    log.add("ATT", 2**62, 0.0, 0.0, 0.0, 0.0, 0.0)
    log.add("ATT", BOOT_US + 1_000_000, 0.0, 0.0, 0.0, 0.0, 0.0)
    path = tmp_path / "a.bin"
    path.write_bytes(log.data)
    import_file(path, tmp_path / "a.mcap")
    recording = Recording(tmp_path / "a.mcap")
    assert (recording.end_ns - recording.start_ns) / 1e9 == pytest.approx(1.0, abs=0.01)
    assert recording.metadata()["import"]["odd_stamps"] == "1"


def test_a_log_without_gps_time_keeps_its_own_clock(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("RCOU", "QHH", "TimeUS,C1,C2")
    for i in range(10):
        log.add("RCOU", BOOT_US + 100_000 * i, 1500, 1000)
    (tmp_path / "a.bin").write_bytes(log.data)
    import_file(tmp_path / "a.bin", tmp_path / "a.mcap")
    recording = Recording(tmp_path / "a.mcap")
    assert recording.start_ns == BOOT_US * 1000
    assert recording.metadata()["import"]["utc"] == "unknown"
    assert "not in the log" in recording.metadata()["import"]["armed"]


def test_a_log_of_two_boots_is_two_flights_one_after_the_other(tmp_path: Path) -> None:
    log = a_log()
    second = a_log(6.0)
    (tmp_path / "two.BIN").write_bytes(log.data + second.data)
    import_file(tmp_path / "two.BIN", tmp_path / "two.mcap")
    recording = Recording(tmp_path / "two.mcap")
    assert recording.metadata()["import"]["boots"].startswith("2: ")
    (attitude,) = recording.columns("ATTITUDE")
    assert np.all(np.diff(attitude.log_time) > 0)
    (clock,) = clocks(recording)
    assert clock["resets"] == 1
    flight = extract(recording, load_vehicle("ultrastick25e"))
    assert flight.signals["p"].time_s.size == 300


@pytest.mark.parametrize(
    "content",
    [b"", b"no log at all", random.Random(1).randbytes(200_000), DataflashWriter().data, b"\xa3\x95\x80" * 99],
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    with pytest.raises(ImportFileError, match=r"a\.bin holds no message") as error:
        import_file(path, tmp_path / "a.mcap")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.whole_flight
def test_an_uploaded_log_is_a_flight(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path / "data")
    settings.flights.mkdir(parents=True)
    upload = tmp_path / "upload"
    upload.write_bytes(a_log().data)
    with closing(Catalogue(tmp_path / "catalogue.sqlite")) as catalogue:
        flight = Uploads(settings, catalogue).take_in(upload, "C:\\logs\\00000042.BIN")
    assert (flight.name, flight.system, flight.start_ns) == ("00000042.BIN", 7, UTC_US * 1000)
    assert Recording(settings.flights / flight.file).metadata()["import"]["source"] == "00000042.BIN"
    export_file(settings.flights / flight.file, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == a_log().data


def test_a_log_of_before_3_3_counts_milliseconds(tmp_path: Path) -> None:
    """Its GPS has the week's milliseconds in TimeMS and the time since boot in T; parameters have no time at all."""
    log = DataflashWriter()
    log.declare("PARM", "Nf", "Name,Value")
    log.declare("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.declare("GPS", "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T")
    log.declare("RCOU", "Ihhhh", "TimeMS,Chan1,Chan2,Chan3,Chan4")
    log.add("PARM", "SYSID_THISMAV", 3.0)
    boot_ms = BOOT_US // 1000
    for i in range(100):
        log.add("IMU", boot_ms + 20 * i, 0.1, 0.2, 0.3, 0.0, 0.0, -9.8)
        log.add("RCOU", boot_ms + 20 * i, 1500 + i, 1400, 1100, 1600)
        if i % 10 == 0:
            log.add(
                "GPS", 3, WEEK_MS + 20 * i, WEEK, 9, 0.8, 47.0, 8.0, 100.0, 500.0, 15.0, 90.0, 0.0, boot_ms + 20 * i
            )
        if i == 50:
            log.add("PARM", "SERVO2_REVERSED", 1.0)
    recording = imported(tmp_path, log)
    assert recording.start_ns == UTC_US * 1000
    (imu,) = recording.columns("HIGHRES_IMU", system=3)
    assert imu["time_usec"].tolist() == [BOOT_US + 20_000 * i for i in range(100)]
    (parameters,) = recording.columns("PARAM_VALUE")
    # A parameter counts from where it stands in the log.
    at = {name: (ns - recording.start_ns) / 1e9 for name, ns in zip(
        parameters.text("param_id").tolist(), parameters.log_time.tolist(), strict=True
    )}  # fmt: skip
    assert at == pytest.approx({"SYSID_THISMAV": 0.0, "SERVO2_REVERSED": 1.0}, abs=1e-6)


@pytest.mark.parametrize(("sensor", "flag"), [("gyroscope", "GH"), ("accelerometer", "AH")])
def test_where_a_sensor_calls_itself_unhealthy_another_stands_and_that_is_said(
    tmp_path: Path, sensor: str, flag: str
) -> None:
    log = DataflashWriter()
    log.declare("IMU", "QBffffffBB", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GH,AH")
    for i in range(200):
        healthy = {"GH": 1, "AH": 1} | ({flag: 0} if i >= 100 else {})
        now, rate = BOOT_US + 20_000 * i, 0.01 * i
        gyro = (rate, 0.0, 0.0) if healthy["GH"] else (9.0, 9.0, 9.0)
        force = (rate, 0.0, -9.8) if healthy["AH"] else (9.0, 9.0, 9.0)
        log.add("IMU", now, 0, *gyro, *force, healthy["GH"], healthy["AH"])
        # The other one has its own stamps: what it reads is put onto the first one's.
        late = rate + 0.01 * 0.2
        log.add("IMU", now + 4_000, 1, late, 0.0, 0.0, late, 0.0, -9.8, 1, 1)
    recording = imported(tmp_path, log)
    flight = extract(recording, load_vehicle("iitb-mav"))
    for name, value in (("p", flight.signals["p"]), ("ax", flight.signals["ax"])):
        assert value.values.size == 200, name
        np.testing.assert_allclose(value.values, 0.01 * np.arange(200), atol=1e-6)
    (told,) = (line for line in flight.warnings if "unhealthy" in line)
    assert told == (
        f"{sensor} 0 was unhealthy by its own flag (IMU.{flag} = 0) in 100 of 200 samples, from 2.0 s on: {sensor} 1"
        " stands there"
    )


def test_a_sensor_that_is_alone_stays_and_its_flag_is_said(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("IMU", "QBffffffBB", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GH,AH")
    for i in range(100):
        log.add("IMU", BOOT_US + 20_000 * i, 0, 0.1, 0.0, 0.0, 0.0, 0.0, -9.8, 1, 0)
    flight = extract(imported(tmp_path, log), load_vehicle("iitb-mav"))
    np.testing.assert_allclose(flight.signals["az"].values, -9.8, rtol=1e-6)
    assert any(line.endswith("no other was healthy: taken as it is") for line in flight.warnings)


def test_the_battery_is_a_signal(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.declare("BAT", "QBfff", "TimeUS,Inst,Volt,VoltR,Curr")
    log.declare("ATT", "QccccC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw")
    for i in range(20):
        log.add("BAT", BOOT_US + 100_000 * i, 0, 12.34, 12.5, 7.89 if i else -1.0)
        log.add("ATT", BOOT_US + 100_000 * i, 0.0, 10.0, 0.0, -2.5, 350.0)
    signals = extract(imported(tmp_path, log), load_vehicle("iitb-mav")).signals
    np.testing.assert_allclose(signals["battery_voltage"].values, 12.34, atol=1e-9)
    np.testing.assert_allclose(signals["battery_current"].values[1:], 7.89, atol=1e-9)

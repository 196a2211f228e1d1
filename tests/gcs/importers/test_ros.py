"""Bags that rosbags writes (rosbag2 in MCAP and SQLite, ROS 1) become signals in our axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gcs.errors import GcsError, ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.inspection.info import as_recordings
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle

NAMES = ["elevator", "flap", "left_aileron", "right_aileron"]
STORE = get_typestore(Stores.ROS2_HUMBLE)
START_S = 1_780_000_000
T = 0.02 * np.arange(200)
# What an aircraft does, in forward-right-down and north-east-down.
PHI, THETA, PSI = 0.3 * np.sin(T), 0.1 + 0.05 * np.cos(T), 2.0 + 0.2 * T
RATES = np.column_stack((0.1 * np.sin(T), 0.2 * np.cos(T), 0.05 * np.sin(2.0 * T)))
FORCES = np.column_stack((0.5 + 0.1 * np.sin(T), 0.2 * np.cos(T), -9.8 + 0.3 * np.sin(T)))
VELOCITY = np.column_stack((10.0 + np.sin(T), 5.0 + np.cos(T), -0.5 * np.sin(T)))


def quaternion(phi: float, theta: float, psi: float) -> Any:
    """From forward-left-up to east-north-up, built from rotation matrices."""
    body = Rotation.from_euler("ZYX", (psi, theta, phi))  # forward-right-down to north-east-down
    enu_of_ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    frd_of_flu = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    return (enu_of_ned * body * frd_of_flu).as_quat()


def message(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def stamped(i: int, frame: str) -> Any:
    at = START_S + 0.02 * i
    stamp = message("builtin_interfaces/msg/Time", sec=int(at), nanosec=round(1e9 * (at - int(at))))
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(values: Any) -> Any:
    return message("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, values), strict=True)))


def messages(frame: str = "base_link") -> dict[str, tuple[str, list[Any]]]:
    """Topic -> type and messages, 50 a second. frame: of the IMU; one that ends in frd is in our axes."""
    flip = np.array([1.0, 1.0, 1.0]) if frame.endswith("frd") else np.array([1.0, -1.0, -1.0])
    nine = np.zeros(9)
    imu, twist, pressure, joints, alpha, fix = [], [], [], [], [], []
    for i in range(T.size):
        x, y, z, w = quaternion(PHI[i], THETA[i], PSI[i])
        if frame.endswith("frd"):
            x, y, z, w = Rotation.from_euler("ZYX", (PSI[i], THETA[i], PHI[i])).as_quat()
        imu.append(message(
            "sensor_msgs/msg/Imu", header=stamped(i, frame),
            orientation=message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w), orientation_covariance=nine,
            angular_velocity=vector(flip * RATES[i]), angular_velocity_covariance=nine,
            linear_acceleration=vector(flip * FORCES[i]), linear_acceleration_covariance=nine,
        ))  # fmt: skip
        north, east, down = VELOCITY[i]
        twist.append(message(
            "geometry_msgs/msg/TwistStamped", header=stamped(i, "map"),
            twist=message("geometry_msgs/msg/Twist", linear=vector((east, north, -down)), angular=vector((0, 0, 0))),
        ))  # fmt: skip
        pressure.append(message(
            "sensor_msgs/msg/FluidPressure", header=stamped(i, ""), fluid_pressure=150.0 + T[i], variance=0.0
        ))  # fmt: skip
        joints.append(message(
            "sensor_msgs/msg/JointState", header=stamped(i, ""), name=NAMES,
            position=np.array([0.01 * i, 0.0, 0.2, -0.1]), velocity=np.zeros(0), effort=np.zeros(0),
        ))  # fmt: skip
        alpha.append(message("std_msgs/msg/Float64", data=float(3.0 + np.sin(T[i]))))
        status = message("sensor_msgs/msg/NavSatStatus", status=0, service=1)
        fix.append(message(
            "sensor_msgs/msg/NavSatFix", header=stamped(i, "gps"), status=status, latitude=48.0, longitude=11.0,
            altitude=500.0, position_covariance=nine, position_covariance_type=0,
        ))  # fmt: skip
    return {
        "/imu/data": ("sensor_msgs/msg/Imu", imu),
        "/gps/vel": ("geometry_msgs/msg/TwistStamped", twist),
        "/air/diff_pressure": ("sensor_msgs/msg/FluidPressure", pressure),
        "/surfaces": ("sensor_msgs/msg/JointState", joints),
        "/air/alpha_deg": ("std_msgs/msg/Float64", alpha),
        "/gps/fix": ("sensor_msgs/msg/NavSatFix", fix),
    }


def write(folder: Path, plugin: StoragePlugin, topics: dict[str, tuple[str, list[Any]]]) -> Path:
    """A rosbag2; the file in it."""
    with Writer2(folder, version=9, storage_plugin=plugin) as bag:
        for topic, (kind, each) in topics.items():
            connection = bag.add_connection(topic, kind, typestore=STORE)
            for i, one in enumerate(each):
                bag.write(connection, (START_S * 10**9) + i * 20_000_000, STORE.serialize_cdr(one, kind))
    (made,) = [*folder.glob("*.mcap"), *folder.glob("*.db3")]
    return made


def check(path: Path, tmp_path: Path) -> None:
    target = tmp_path / "flight.mcap"
    import_file(path, target)
    found = extract(Recording(target), Vehicle.unknown()).signals
    expected = {
        **dict(zip("pqr", RATES.T, strict=True)), **dict(zip(("ax", "ay", "az"), FORCES.T, strict=True)),
        **dict(zip(("vn", "ve", "vd"), VELOCITY.T, strict=True)), "phi": PHI, "theta": THETA,
        "psi": (PSI + np.pi) % (2.0 * np.pi) - np.pi, "differential_pressure": 150.0 + T,
        "alpha": np.radians(3.0 + np.sin(T)), "de": 0.01 * np.arange(200), "da": np.full(200, 0.15),
    }  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(found[name].values, values, rtol=1e-9, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(found[name].time_s, T, atol=2e-6, err_msg=name)
    assert found["lat"].values[0] == pytest.approx(48.0)
    assert Recording(target).start_ns == pytest.approx(START_S * 10**9, abs=2 * 10**9)


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name)
@pytest.mark.parametrize("frame", ["base_link", "base_link_frd"])
def test_standard_messages_of_rosbag2_are_signals_in_our_axes(
    plugin: StoragePlugin, frame: str, tmp_path: Path
) -> None:
    check(write(tmp_path / "bag", plugin, messages(frame)), tmp_path)


def test_what_is_not_measured_is_left_out_and_unstamped_numbers_follow_the_stamped_clock(tmp_path: Path) -> None:
    topics = messages("imu_aligned")  # a frame of REP 103, whatever its name ends in
    kind, wind = topics["/gps/vel"]
    twist = message("geometry_msgs/msg/Twist", linear=vector((3.0, 1.0, 0.0)), angular=vector((0, 0, 0)))
    other = [message(kind, header=one.header, twist=twist) for one in wind]
    topics = {"/mavros/wind_estimation": (kind, other), "/cmd_vel": (kind, other), **topics}
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, (each_kind, each) in topics.items():
            connection = bag.add_connection(topic, each_kind, typestore=STORE)
            for i, one in enumerate(each):
                # Received 500 s later by another clock.
                bag.write(connection, (START_S + 500) * 10**9 + i * 20_000_000, STORE.serialize_cdr(one, each_kind))
    (path,) = (tmp_path / "bag").glob("*.mcap")
    check(path, tmp_path)


def test_joints_of_several_publishers_are_taken_by_their_names(tmp_path: Path) -> None:
    topics = messages()
    kind, each = topics["/surfaces"]
    for i, one in enumerate(each):
        one.name, one.position = (["elevator"], np.array([0.01 * i])) if i % 2 else (["rudder"], np.array([0.02 * i]))
    import_file(write(tmp_path / "bag", StoragePlugin.MCAP, {"/surfaces": (kind, each)}), tmp_path / "a.mcap")
    found = extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals
    np.testing.assert_allclose(found["de"].values, 0.01 * np.arange(1, 200, 2), rtol=1e-12)
    np.testing.assert_allclose(found["dr"].values, 0.02 * np.arange(0, 200, 2), rtol=1e-12, atol=1e-15)


def test_a_bag_is_read_wherever_a_recording_is(tmp_path: Path) -> None:
    path = write(tmp_path / "bag", StoragePlugin.MCAP, messages())
    with as_recordings([path]) as (recording,):
        assert recording != path
        assert "q" in extract(Recording(recording), Vehicle.unknown()).signals


def test_ros_1_s_bags_too(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind, path = "std_msgs/msg/Float64", tmp_path / "a.bag"
    with Writer1(path) as bag:
        connection = bag.add_connection("/air/alpha_deg", kind, typestore=store)
        for i, value in enumerate(3.0 + np.sin(T)):
            raw = store.serialize_ros1(store.types[kind](data=float(value)), kind)
            bag.write(connection, START_S * 10**9 + i * 20_000_000, raw)
    import_file(path, tmp_path / "a.mcap")
    found = extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals["alpha"]
    np.testing.assert_allclose(found.values, np.radians(3.0 + np.sin(T)), rtol=1e-12)


def test_a_mapping_file_names_fields_of_topics(tmp_path: Path) -> None:
    path, columns = write(tmp_path / "bag", StoragePlugin.MCAP, messages()), tmp_path / "map.toml"
    columns.write_text('[columns]\ndr = "/surfaces.position[1]"\nthrust = "/imu/data.linear_acceleration.x"\n'
                       '[units]\ndr = "deg"\nthrust = "N"\n')  # fmt: skip
    import_file(path, tmp_path / "a.mcap", columns=columns)
    found = extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals
    np.testing.assert_allclose(found["thrust"].values, FORCES[:, 0], rtol=1e-12)
    assert "dr" in found


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ('dr = "/nothing.x"', "no topic /nothing.x; there are"),
        ('dr = "/surfaces.position[9]"', "have no number 'position[9]'"),
        ("dr = 3", "name a field of a topic"),
        ('time = "/imu/data.header.stamp.sec"', "times of their own; leave it out"),
        ('dr = "/surfaces.position[1]"', "the unit of /surfaces.position[1] is not known"),
    ],
)
def test_a_wrong_mapping_is_one_line(columns: str, words: str, tmp_path: Path) -> None:
    path, mapping = write(tmp_path / "bag", StoragePlugin.MCAP, messages()), tmp_path / "map.toml"
    mapping.write_text(f"[columns]\n{columns}\n")
    with pytest.raises(ImportFileError) as refused:
        import_file(path, tmp_path / "a.mcap", columns=mapping)
    assert words in str(refused.value)
    assert not (tmp_path / "a.mcap").exists()


def test_a_bag_of_nothing_known_and_a_damaged_one_are_one_line(tmp_path: Path) -> None:
    text = message("std_msgs/msg/String", data="hello")
    path = write(tmp_path / "bag", StoragePlugin.SQLITE3, {"/words": ("std_msgs/msg/String", [text] * 20)})
    with pytest.raises(ImportFileError, match="topics are /words"):
        import_file(path, tmp_path / "a.mcap")
    noise = np.random.default_rng(1).bytes(5000)
    for name in ("b.bag", "b.db3"):
        for content in (b"nothing" * 100, noise, b"#ROSBAG V2.0\n" + noise):
            (tmp_path / name).write_bytes(content)
            with pytest.raises(ImportFileError, match="cannot be read as a ROS bag") as refused:
                import_file(tmp_path / name, tmp_path / "a.mcap")
            assert "\n" not in str(refused.value)


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name)
def test_a_bag_cut_off_anywhere_is_read_or_refused_in_one_line(plugin: StoragePlugin, tmp_path: Path) -> None:
    path = write(tmp_path / "bag", plugin, messages())
    whole = path.read_bytes()
    cut = tmp_path / f"cut{path.suffix}"
    for share in np.linspace(0.02, 0.98, 13):
        cut.write_bytes(whole[: int(share * len(whole))])
        try:
            import_file(cut, tmp_path / "a.mcap")
        except GcsError as error:
            said = str(error)
        else:
            said = "" if extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals else "no signal\n"
        assert "\n" not in said


def in_chunks(bag: Path, target: Path, index: bool = True) -> Path:
    """The same messages in chunks of 4 kB each, as ROS 2's recorder writes them, with an index at the end or none."""
    from mcap.reader import make_reader
    from mcap.writer import IndexType, Writer

    with bag.open("rb") as source, target.open("wb") as file:
        every = {} if index else {"index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False}
        writer = Writer(file, chunk_size=4096, **every)
        writer.start("ros2", "")
        numbers: dict[int, int] = {}
        for schema, channel, one in make_reader(source).iter_messages():
            if channel.id not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, kind)
            writer.add_message(numbers[channel.id], one.log_time, one.data, one.publish_time)
        writer.finish()
    return target


def rate_of(bag: Path, folder: Path) -> tuple[np.ndarray, list[str]]:
    """The rolling that a bag brings, and the warnings of its import about the bag."""
    folder.mkdir()
    import_file(bag, folder / "a.mcap")
    found = extract(Recording(folder / "a.mcap"), Vehicle.unknown())
    return found.signals["p"].values, [line for line in found.warnings if "the bag" in line]


def test_a_bag_in_mcap_is_read_to_where_it_was_cut_off_and_without_an_index(tmp_path: Path) -> None:
    bag = in_chunks(write(tmp_path / "bag", StoragePlugin.MCAP, messages()), tmp_path / "whole.mcap")
    every, nothing = rate_of(bag, tmp_path / "whole")
    assert nothing == []
    bare = in_chunks(bag, tmp_path / "bare.mcap", index=False)
    same, nothing = rate_of(bare, tmp_path / "bare")
    np.testing.assert_array_equal(same, every)
    assert nothing == []
    for share in (0.4, 0.7):
        cut = tmp_path / f"cut{share}.mcap"
        cut.write_bytes(bare.read_bytes()[: round(share * bare.stat().st_size)])
        part, (line,) = rate_of(cut, tmp_path / f"cut{share}")
        assert line.startswith("the bag is cut off or damaged: the ")
        np.testing.assert_array_equal(part, every[: part.size])
        assert (share - 0.1) * every.size < part.size < every.size

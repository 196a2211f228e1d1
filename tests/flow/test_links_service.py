"""Links as users set them up: the commands in processes of their own, vehicles and other stations by pymavlink."""

from __future__ import annotations

import importlib.util
import signal
import socket
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
from mavlink_frames import Sender
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from patience import PATIENCE_S
from processes import free_port, messages_on_disk, run, service, start
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator import mavgen
from traffic import Vehicle, wait_until

from gcs.formats.conversion import export_file, import_file
from gcs.recording.reader import Recording

DEFINITION = """<?xml version="1.0"?><mavlink><include>minimal.xml</include><messages>
<message id="180000" name="VANE_RAW"><description>Vanes of the nose boom</description>
<field type="uint64_t" name="time_usec" units="us">Time since boot</field>
<field type="float[2]" name="Angle" units="rad">Angles</field>
<field type="uint8_t" name="state">State</field>
<field type="char[8]" name="label">Label</field>
<extensions/><field type="uint32_t" name="counts">Raw counts</field>
</message></messages></mavlink>"""


def pymavlinks_module(definition: str, folder: Path) -> ModuleType:
    """What pymavlink makes of a definition, to send with."""
    shipped = Path(mavlink.__file__).with_name("minimal.xml")
    folder.mkdir()
    (folder / "minimal.xml").write_bytes(shipped.read_bytes())
    (folder / "vanes.xml").write_text(definition)
    options = mavgen.Opts(str(folder / "vanes.py"), wire_protocol="2.0", language="Python3", validate=False)
    mavgen.mavgen(options, [str(folder / "vanes.xml")])
    spec = importlib.util.spec_from_file_location("vanes", folder / "vanes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_message_of_ones_own_is_recorded_over_udp_and_read_by_ros_tools(tmp_path: Path) -> None:
    definition, path, port = tmp_path / "vanes.xml", tmp_path / "flight.mcap", free_port()
    definition.write_text(DEFINITION)
    vanes = pymavlinks_module(DEFINITION, tmp_path / "generated")
    sender = vanes.MAVLink(None, srcSystem=3, srcComponent=1)
    sent = []
    arguments = ["--dialect", definition, "--connect", f"udpin:127.0.0.1:{port}", "-o", path]
    with start("gcs", ["record", *arguments]) as process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        wait_until(lambda: path.exists() or process.poll() is not None)
        assert process.poll() is None, process.communicate()[1]
        vehicle.connect(("127.0.0.1", port))
        for i in range(50):
            message = vanes.MAVLink_vane_raw_message(1000 * i + 1, [0.25 * i, -0.5], i, b"boom", 70_000 + i)
            sent.append(message)
            vehicle.send(bytes(message.pack(sender)))
            sender.seq = (sender.seq + 1) % 256
        wait_until(lambda: messages_on_disk(path) >= 50)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        read = [entry for _, _, _, entry in reader.iter_decoded_messages(topics="/mavlink/3/1/VANE_RAW")]
        assert [attachment.name for attachment in reader.iter_attachments()] == ["vanes.xml"]
    assert [(m.time_usec, list(m.angle), m.state, m.counts) for m in read] == [
        (m.time_usec, m.Angle, m.state, m.counts) for m in sent
    ]
    assert bytes(read[0].label).rstrip(b"\0") == b"boom"
    # The frames go to a .tlog and come back by the same definition; without it they are frames of an unknown id.
    log, again, other = tmp_path / "flight.tlog", tmp_path / "again.mcap", tmp_path / "other.mcap"
    export_file(path, log)
    import_file(log, again, dialect=str(definition))
    assert Recording(again).counts() == {"/mavlink/3/1/VANE_RAW": 50}
    refused = run("gcs", "import", log, "-o", other, "--dialect", tmp_path / "missing.xml")
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == 1


def test_a_signing_key_that_is_none_is_refused_in_one_line(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("too short")
    for arguments, said in (
        (["--signing-key", key], "32 bytes, or 64 hexadecimal digits"),
        (["--sign"], "give --signing-key FILE"),
    ):
        refused = run("gcs", "record", "--connect", "udpin:127.0.0.1:0", "-o", tmp_path / "x.mcap", *arguments)
        assert refused.returncode == 2
        assert said in refused.stderr
        assert refused.stderr.count("\n") == 1


def test_the_service_tells_of_every_link_and_records_what_other_stations_say(tmp_path: Path) -> None:
    key_file, key, port = tmp_path / "key", bytes(range(32)), free_port()
    key_file.write_text(key.hex())
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        other.bind(("127.0.0.1", 0))
        other.settimeout(PATIENCE_S)
        forward = f"udpout:127.0.0.1:{other.getsockname()[1]}"
        link = f"udpin:127.0.0.1:{port}"
        options = ["--forward", forward, "--signing-key", key_file, "--sign", "--data", tmp_path / "data"]
        with service("--connect", link, *options) as url, httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
            vehicle.connect(("127.0.0.1", port))
            vehicle.settimeout(PATIENCE_S)
            craft, radio = Vehicle(), Vehicle(51, 68)
            signer = Sender(1, 2)
            signer.sign_from_now(key)
            signer.mavlink.signing.timestamp = int((time.time() - 1_420_070_400) * 100_000)
            sent = [
                craft.heartbeat(),
                radio.frame(mavlink.MAVLink_radio_status_message(210, 200, 90, 40, 50, 7, 3)),
                signer.send("SYS_STATUS").frame,
            ]
            for frame in sent:
                vehicle.send(frame)
            passed, caller = [], ("", 0)
            while len(passed) < len(sent):
                data, caller = other.recvfrom(2000)
                passed.append(data)
            assert passed == sent
            command = Sender(240, 190).send("COMMAND_LONG").frame
            other.sendto(command, caller)
            checker = mavlink.MAVLink(None)
            checker.signing.secret_key = key
            heard: dict[int, bytes] = {}
            while set(heard) != {240, 255}:
                frame = vehicle.recv(2000)
                heard[frame[5]] = frame
                assert frame[5] == 240 or checker.check_signature(bytearray(frame), 255, frame[6])
            assert heard[240] == command

            def listed() -> list[dict[str, Any]] | None:
                links = client.get("/api/links").json()
                return links if [entry["frames"] for entry in links] == [3, 1] else None

            ours, theirs = wait_until(listed)
            assert (ours["url"], ours["role"], theirs["url"], theirs["role"]) == (link, "vehicle", forward, "forward")
            assert (ours["signed_good"], ours["signed_bad"], ours["unsigned"]) == (1, 0, 2)
            assert (ours["radio"]["rssi"], ours["radio"]["rxerrors"], ours["radio"]["fixed"]) == (210, 7, 3)
            assert ours["sources"][0]["address"] == f"127.0.0.1:{vehicle.getsockname()[1]}"
            assert theirs["systems"][0]["system"] == 240
            forwarding = client.get("/api/health").json()["forwarding"]
            assert forwarding == {"frames": 4, "copies": 0, "dropped_bytes": 0, "refused": 0}
    (path,) = (tmp_path / "data" / "flights").glob("*.mcap")
    recording = Recording(path)
    assert set(recording.links()) == {link, f"forward:{forward}"}
    assert recording.counts()["/mavlink/240/190/COMMAND_LONG"] == 1
    info = run("gcs", "info", path, "--signing-key", key_file)
    assert "signatures: 1 good, 0 bad, 2 frames unsigned" in info.stdout
    assert "radio 51, 68: 1 reports, rssi 210 to 210" in info.stdout
    # The key itself is in no file of the service.
    for file in (tmp_path / "data").rglob("*"):
        if file.is_file():
            content = file.read_bytes()
            assert key not in content
            assert key.hex().encode() not in content

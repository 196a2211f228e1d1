"""What `gcs info` says of links: signatures checked anew, radios, and one vehicle heard over two lossy links."""

import json
import random
import socket
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from mavlink_frames import Sender
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from signed_frames import KEY, NOW, signed
from traffic import Vehicle, batch, ground_station_heartbeat
from wire_streams import wire_streams

from gcs.catalogue.store import Catalogue
from gcs.cli import main
from gcs.errors import DialectError
from gcs.inspection.info import describe_recording, info_text
from gcs.links.opening import UdpLink, open_link
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.reader import Recording
from gcs.recording.storage import StorageOptions
from gcs.station.capture import Capture
from gcs.station.linkstats import LinkStatistics
from gcs.station.provenance import provenance
from gcs.station.recorder import FlightRecorder


def capture(path: Path, streams: dict[str, list[bytes]]) -> Recording:
    """A recording of frames that came over several links within 10 s."""
    made = Capture(path, Dialect.load())
    for link, frames in streams.items():
        made.take(link, batch(frames, NOW, 10_000_000_000))
    made.close(NOW)
    return Recording(path)


def test_signatures_in_a_recording_are_checked_with_the_key_given_then(tmp_path: Path) -> None:
    path = tmp_path / "signed.mcap"
    good = signed(20)
    altered = bytearray(good[3])
    altered[-2] ^= 1
    unsigned = [Vehicle(7).attitude(), Sender(8, version=1).send("ATTITUDE").frame]
    capture(
        path, {"udp": [*good[:3], bytes(altered), *good[4:], good[5], *unsigned, b"noise"], "serial": [unsigned[0]]}
    )
    info = describe_recording(path, KEY)
    udp, serial = info["links"]
    wanted = {"link": "udp", "raw_bytes": 5, "signed_good": 19, "signed_bad": 2, "signed_replayed": 1, "unsigned": 2}
    assert {name: udp[name] for name in wanted} == wanted
    assert udp["signed_unverified"] == 0
    assert serial["unsigned"] == 1
    assert "19 good, 2 bad (1 of them replayed), 2 frames unsigned" in info_text(info)
    without = describe_recording(path)["links"][0]
    assert (without["signed_unverified"], without["unsigned"]) == (21, 2)


def test_copies_over_a_second_link_are_judged_in_the_order_in_which_they_came(tmp_path: Path) -> None:
    path, frames = tmp_path / "signed.mcap", signed(40)
    made = Capture(path, Dialect.load(), key=KEY)
    for i, frame in enumerate(frames):
        for link, late in (("radio", 0), ("wifi", 1_000_000)):
            made.take(link, batch([frame], NOW + 50_000_000 * i + late))
    made.close(NOW + 3_000_000_000)
    radio, wifi = describe_recording(path, KEY)["links"]
    assert (radio["signed_good"], radio["signed_bad"]) == (40, 0)
    assert (wifi["signed_good"], wifi["signed_repeated"], wifi["signed_bad"]) == (0, 40, 0)
    live = made.signatures
    assert (live.good, live.repeated, live.bad) == (40, 40, 0)


def damaged(frames: list[bytes], every: int) -> tuple[list[bytes], int]:
    """The frames with a byte of every n-th payload changed, and how many those are; none looks like two."""
    changed = [
        frame[:12] + bytes([frame[12] ^ 1]) + frame[13:] if i % every == 0 else frame for i, frame in enumerate(frames)
    ]
    kept = [frame for frame in changed if not set(frame[1:]) & {0xFD, 0xFE}]
    return kept, sum(frame not in frames for frame in kept)


def test_checksum_failures_and_rates_are_told_for_each_link(tmp_path: Path) -> None:
    vehicle = Vehicle()
    frames, bad = damaged([vehicle.attitude(0.01 * i) for i in range(200)], 7)
    assert bad > 10
    clean = [Vehicle(2).attitude()] * 2
    made = Capture(tmp_path / "a.mcap", Dialect.load())
    statistics, framer = LinkStatistics(Dialect.load()), Framer(Dialect.load())
    for i, frame in enumerate(frames):
        piece = batch([frame], NOW + 50_000_000 * i)
        made.take("radio", piece)
        found = framer.feed(piece.data)[1]
        statistics.add(found, np.full(len(found), NOW))
    for at, frame in enumerate(clean):
        made.take("cable", batch([frame], NOW + (20 + 5 * at) * 1_000_000_000))
    made.close(NOW + 30_000_000_000)
    info = describe_recording(tmp_path / "a.mcap")
    links = {entry["link"]: entry for entry in info["links"]}
    size = sum(map(len, frames))
    assert (links["radio"]["bytes"], links["radio"]["bad_crc"]) == (size, bad)
    assert statistics.to_json(0)["bad_crc"] == bad
    assert links["radio"]["bytes_per_s"] == pytest.approx(size / links["radio"]["duration_s"])
    assert (links["cable"]["bad_crc"], links["cable"]["bytes_per_s"]) == (0, pytest.approx(2 * len(clean[0]) / 5.0))
    assert f"{bad} checksum failures" in info_text(info)


def test_checksum_failures_are_told_by_the_definition_in_the_recording(tmp_path: Path) -> None:
    xml = tmp_path / "mine.xml"
    xml.write_text("<mavlink><include>minimal.xml</include><messages></messages></mavlink>")
    dialect = Dialect.load(str(xml))
    heartbeat = Vehicle().heartbeat()
    bad = heartbeat[:-1] + bytes([heartbeat[-1] ^ 1])
    for name, origin, told in (
        ("with", provenance(dialect, [], None, str(xml)), 1),
        ("without", provenance(dialect, [], None), None),
    ):
        made = Capture(tmp_path / f"{name}.mcap", dialect, StorageOptions(), origin, NOW)
        made.take("radio", batch([heartbeat, bad, heartbeat], NOW))
        made.close(NOW)
        (link,) = describe_recording(tmp_path / f"{name}.mcap")["links"]
        assert (link["raw_bytes"], link["bad_crc"]) == (len(bad), told)


def test_a_split_recording_is_one_for_info_export_and_replay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, vehicle = tmp_path / "a.mcap", Vehicle()
    made = Capture(path, Dialect.load(), StorageOptions(split_bytes=20_000))
    frames: list[bytes] = []
    for second in range(40):
        frames += (sent := vehicle.second())
        made.take("udp", batch(sent, NOW + second * 1_000_000_000))
        made.tick(NOW + (second + 1) * 1_000_000_000)
    made.close(NOW + 40_000_000_000)
    assert len(made.parts) > 2
    assert main(["info", str(path), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["files"] == [part.name for part in made.parts]
    assert info["size_bytes"] == sum(part.stat().st_size for part in made.parts)
    assert (info["messages"], info["links"][0]["bytes"]) == (len(frames), sum(map(len, frames)))
    assert [entry["lost"] for entry in info["components"]] == [0]
    assert main(["export", str(path), "-o", str(tmp_path / "a.tlog")]) == 0
    log = (tmp_path / "a.tlog").read_bytes()
    assert len(log) == sum(8 + len(frame) for frame in frames)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{listener.getsockname()[1]}"
        assert main(["replay", str(path), "--out", url, "--speed", "0"]) == 0
    assert f"{sum(map(len, frames))} bytes" in capsys.readouterr().out
    # A later part by itself is what it is.
    assert main(["info", str(made.parts[1]), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] < len(frames)


def test_radios_reports_are_summed_up(tmp_path: Path) -> None:
    radio = Vehicle(51, 68)
    reports = [
        radio.frame(mavlink.MAVLink_radio_status_message(200 + i, 190, 100 - i, 40, 50, (65530 + 3 * i) % 65536, i))
        for i in range(10)
    ]
    capture(tmp_path / "radio.mcap", {"udp": reports})
    info = describe_recording(tmp_path / "radio.mcap")
    (summary,) = info["radios"]
    assert summary["rssi"] == {"min": 200, "median": 204.5, "max": 209}
    assert summary["txbuf"]["min"] == 91
    assert (summary["reports"], summary["rxerrors"], summary["fixed"]) == (10, 27, 9)
    assert "radio 51, 68: 10 reports, rssi 200 to 209" in info_text(info)


@pytest.mark.parametrize("losses", [(0.1, 0.3), (0.5, 0.5)])
def test_two_lossy_udp_links_together_hold_every_message_that_came_over_either(
    tmp_path: Path, losses: tuple[float, float]
) -> None:
    vehicle, chooser = Vehicle(), random.Random(5)
    sent = [vehicle.attitude(0.001 * i) for i in range(2000)]
    arrived: list[set[int]] = [set(), set()]
    made = Capture(tmp_path / "two.mcap", Dialect.load())
    statistics = [LinkStatistics(Dialect.load()) for _ in losses]
    framers = [Framer(Dialect.load()) for _ in losses]
    with ExitStack() as stack:
        links = [stack.enter_context(closing(open_link("udpin:127.0.0.1:0"))) for _ in losses]
        peers = []
        for link in links:
            assert isinstance(link, UdpLink)
            peers.append(stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)))
            peers[-1].connect(("127.0.0.1", link.port))
        for begin in range(0, 2000, 200):
            for i in range(begin, begin + 200):
                for k, loss in enumerate(losses):
                    if chooser.random() >= loss:
                        arrived[k].add(i)
                        peers[k].send(sent[i])
            for k, link in enumerate(links):
                while link.counters.reads < len(arrived[k]):
                    if (piece := link.receive(30.0)) is not None:
                        made.take(f"udpin:0.0.0.0:{k}", piece)
                        statistics[k].add(framers[k].feed(piece.data)[1], piece.received_ns)
    made.close(0)
    recording = Recording(tmp_path / "two.mcap")
    (columns,) = recording.columns("ATTITUDE")
    union = sorted(arrived[0] | arrived[1])
    assert np.array_equal(np.sort(columns["roll"]), np.float32([0.001 * i for i in union]))
    gaps = [max(got) - min(got) + 1 - len(got) for got in arrived]
    assert [lost for _, lost in sorted(recording.lost().items())] == gaps
    for k in (0, 1):
        (system,) = statistics[k].to_json(0)["systems"]
        assert system["components"][0]["lost"] == gaps[k]
        assert system["components"][0]["duplicates"] == 0


def test_a_definition_may_include_what_pymavlink_ships(tmp_path: Path) -> None:
    xml = tmp_path / "mine.xml"
    text = """<?xml version="1.0"?><mavlink><include>minimal.xml</include><messages>
        <message id="180000" name="VANE_RAW"><description>x</description>
        <field type="uint64_t" name="time_usec" units="us">t</field><field type="float" name="Angle">a</field>
        </message></messages></mavlink>"""
    xml.write_text(text)
    dialect = Dialect.load(str(xml))
    assert {"HEARTBEAT", "VANE_RAW"} <= set(dialect.by_name)
    assert dialect.by_name["HEARTBEAT"] == Dialect.load("minimal").by_name["HEARTBEAT"]
    other = tmp_path / "other.xml"
    other.write_text(text.replace("minimal.xml", "theirs.xml"))
    with pytest.raises(DialectError, match=r"includes theirs\.xml, which is neither beside it") as error:
        Dialect.load(str(other))
    assert "\n" not in str(error.value)


def test_what_another_station_says_is_in_every_flight_and_makes_none(tmp_path: Path) -> None:
    with closing(Catalogue(tmp_path / "catalogue.sqlite")) as catalogue:
        recorder = FlightRecorder(tmp_path / "flights", Dialect.load(), catalogue)
        station = "forward:udpout:127.0.0.1:14550"
        recorder.feed(station, batch([ground_station_heartbeat(240)], NOW))
        assert recorder.live_flights() == []
        for system in (1, 2):
            recorder.feed("udpin:x", batch(Vehicle(system).second(), NOW + 1_000_000_000))
        command = Vehicle(240, 190).frame(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
        echo = Vehicle(1).heartbeat(armed=False)  # what comes back is no news of the vehicle
        recorder.feed(station, batch([command, echo], NOW + 2_000_000_000))
        assert len(recorder.live_flights()) == 2
        recorder.close(NOW + 3_000_000_000)
        assert recorder.state.unrecorded_bytes == 0
    for path in (tmp_path / "flights").glob("*.mcap"):
        recording = Recording(path)
        assert recording.counts()["/mavlink/240/190/COMMAND_LONG"] == 1
        (stream,) = [pieces for link, pieces in wire_streams(recording).items() if link == station]
        assert b"".join(data for _, data in stream) == command + echo

"""Serial links over real pseudo-terminals: unplugged, plugged in again, shared, and not there yet."""

import os
import termios
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from processes import free_port
from pseudo_terminal import connected, lost, plugged
from traffic import Vehicle, wait_until
from wire_streams import wire_streams

from gcs.errors import LinkError
from gcs.links.opening import open_link, open_links
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture


def test_nothing_that_the_wire_brought_is_lost_when_the_device_is_unplugged_and_comes_back(tmp_path: Path) -> None:
    device, path = tmp_path / "ttyUSB0", tmp_path / "flight.mcap"
    vehicle = Vehicle()
    capture = Capture(path, Dialect.load())
    sent = b""
    with closing(open_link(f"{device},921600")) as link:

        def take() -> bool:
            while (batch := link.receive(0.01)) is not None:
                capture.take(link.name, batch)
            return link.counters.bytes == len(sent)

        for plugging in range(3):
            with plugged(device) as (wire, terminal):
                connected(link)
                assert termios.tcgetattr(terminal)[4:6] == [termios.B921600] * 2
                for i in range(100):
                    frame = vehicle.attitude(0.01 * i)
                    # The plug is pulled within the last frame.
                    part = frame[:15] if i == 99 else frame
                    sent += part
                    os.write(wire, part)
                    if i % 20 == 19:
                        wait_until(take)
                link.send(b"command")
                assert os.read(wire, 100) == b"command"
            lost(link)
            assert link.problem
            assert link.counters.connections == plugging + 1
            assert link.counters.reconnects == plugging
    capture.close(1)
    recording = Recording(path)
    (stream,) = wire_streams(recording).values()
    assert b"".join(data for _, data in stream) == sent
    (columns,) = recording.columns("ATTITUDE")
    assert len(columns) == 3 * 99


def test_a_device_is_held_by_one_program_alone(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    with plugged(device), closing(open_link(str(device))) as first, closing(open_link(str(device))) as second:
        connected(first)
        wait_until(lambda: second.receive(0.01) is None and "another program holds" in second.problem)
        assert not second.connected
        first.close()
        connected(second)


def test_a_pattern_takes_the_device_that_turns_up(tmp_path: Path) -> None:
    with closing(open_link(f"{tmp_path}/ttyACM*,57600")) as link, closing(open_link(f"{tmp_path}/ttyACM*")) as other:
        assert link.receive(0.01) is None
        assert "no device matches" in link.problem
        for name in ("ttyACM3", "ttyACM0"):
            with plugged(tmp_path / name) as (wire, _):
                connected(link)
                os.write(wire, b"telemetry")
                wait_until(lambda: link.counters.bytes % 9 == 0 and link.receive(0.01))
                assert link.sources.to_json()[0]["address"] == str(tmp_path / name)
                with plugged(tmp_path / "ttyACM1"):  # the first is taken, so the other link takes the next
                    connected(other)
                    assert other.sources.to_json()[0]["address"] == str(tmp_path / "ttyACM1")
                lost(other)
            lost(link)
        assert link.counters.reconnects == 1


def test_a_line_that_takes_no_more_bytes_holds_up_nobody(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    with plugged(device) as (wire, _), closing(open_link(str(device))) as link:
        connected(link)
        frame = Vehicle().attitude() * 100
        for _ in range(1000):
            link.send(frame)
        assert link.counters.send_errors > 0
        os.set_blocking(wire, False)
        got = bytearray()

        def read() -> bool:
            link.receive(0.01)
            try:
                got.extend(os.read(wire, 1 << 16))
            except BlockingIOError:
                return len(got) == link.counters.bytes_sent and len(got) % len(frame) == 0
            return False

        wait_until(read)
        assert bytes(got) == frame * (len(got) // len(frame))


def test_a_device_that_is_not_there_yet_is_no_error() -> None:
    with closing(open_link("/dev/does-not-exist,57600")) as link:
        assert link.receive(0.01) is None
        assert not link.connected
        assert "does-not-exist" in link.problem


def test_what_is_no_serial_device_says_so(tmp_path: Path) -> None:
    plain = tmp_path / "file"
    plain.write_bytes(b"")
    with closing(open_link(str(plain))) as link:
        assert link.receive(0.01) is None
        assert not link.connected
        assert link.problem
        assert "\n" not in link.problem


def test_two_radios_by_the_same_pattern_are_two_links_whose_bytes_do_not_mix(tmp_path: Path) -> None:
    url = f"{tmp_path}/ttyACM*"
    with ExitStack() as stack:
        wires = [stack.enter_context(plugged(tmp_path / f"ttyACM{i}"))[0] for i in range(2)]
        links = open_links([url, url, url])
        for link in links:
            stack.enter_context(closing(link))
        assert [link.name for link in links] == [url, f"{url} (2)", f"{url} (3)"]
        connected(links[0])
        connected(links[1])
        for wire, word in zip(wires, (b"first", b"second"), strict=True):
            os.write(wire, word)
        for link, word in zip(links[:2], (b"first", b"second"), strict=True):
            batch = wait_until(lambda link=link: link.receive(0.01))
            assert (batch.data, batch.source or link.name) == (word, link.name)
            assert [source.name for source in link.sources.all()] == [link.name]


def test_a_port_given_twice_is_refused_and_nothing_stays_open() -> None:
    url = f"udpin:127.0.0.1:{free_port()}"
    with pytest.raises(LinkError, match="choose another port"):
        open_links([url, url])
    open_links([url])[0].close()

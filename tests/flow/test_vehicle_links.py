"""Both ways over every kind of link, with pymavlink's own connections as the ground station."""

from __future__ import annotations

import signal
import socket
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from asking import Asking
from patience import PATIENCE_S
from processes import free_port, start
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from serial_line import serial_line
from traffic import wait_until


@contextmanager
def standing(*arguments: object) -> Iterator[None]:
    """A simulator that stands until it is armed, interrupted at the end."""
    process = start("sim-vehicle", ["fly", "--taxi", "--wait-arm", *arguments])
    with process:
        try:
            yield
            assert process.poll() is None, process.communicate()[1]
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=PATIENCE_S)
            assert process.returncode == 130
            assert "Traceback" not in error
        finally:
            if process.poll() is None:
                process.kill()


def wait_message(connection: Any, kind: str) -> Any:
    found = connection.recv_match(type=kind, blocking=True, timeout=PATIENCE_S)
    assert found is not None, f"no {kind} came"
    return found


def connect_armed(connection: Any) -> None:
    """What pymavlink's ground stations do first: wait, fetch every parameter, arm."""
    assert connection.wait_heartbeat(timeout=PATIENCE_S) is not None
    assert not connection.motors_armed()
    connection.param_fetch_all()
    count = wait_message(connection, "PARAM_VALUE").param_count
    deadline = time.monotonic() + PATIENCE_S
    while len(connection.params) < count and time.monotonic() < deadline:
        wait_message(connection, "PARAM_VALUE")
    assert connection.param("SIM_MASS") == 1.0
    connection.arducopter_arm()
    acknowledged = wait_message(connection, "COMMAND_ACK")
    assert (acknowledged.command, acknowledged.result) == (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    while not connection.motors_armed():
        wait_message(connection, "HEARTBEAT")


def listens(port: int) -> bool:
    """Whether somebody takes connections there."""
    try:
        socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S).close()
    except ConnectionRefusedError:
        return False
    return True


def test_a_tcp_server() -> None:
    port = free_port(socket.SOCK_STREAM)
    with standing("--out", f"tcpin:127.0.0.1:{port}"):
        wait_until(lambda: listens(port))
        with closing(mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255)) as station:
            connect_armed(station)
            assert station.motors_armed()
            assert station.mav.total_receive_errors == 0


def test_a_serial_line() -> None:
    with (
        serial_line() as (vehicle_end, station_end),
        standing("--out", f"{vehicle_end},921600"),
        closing(mavutil.mavlink_connection(station_end, baud=921600, source_system=255)) as station,
    ):
        # Opening the device may cut a frame in two; from the first one on nothing may be lost or broken either way.
        assert station.wait_heartbeat(timeout=PATIENCE_S) is not None
        begin = (station.mav.total_receive_errors, station.mav_loss, station.mav_count)
        connect_armed(station)
        for sent in (3, 4):
            station.mav.timesync_send(0, sent)
            answer = wait_message(station, "TIMESYNC")
            while answer.tc1 == 0:  # the vehicle's own question
                answer = wait_message(station, "TIMESYNC")
            assert answer.ts1 == sent
        assert (station.mav.total_receive_errors, station.mav_loss) == begin[:2]
        assert station.mav_count > begin[2] + len(station.params)


def test_a_signing_vehicle_answers_only_signed_questions_and_a_delay_counts_both_ways(tmp_path: Path) -> None:
    key = bytes(range(32))
    (tmp_path / "key").write_bytes(key)
    with closing(Asking(key)) as station, closing(Asking()) as stranger:
        url = ("--out", station.url, "--signing-key", tmp_path / "key", "--fault", "delay=0.15")
        with standing(*url):
            station.wait_for(lambda m: m.get_type() == "HEARTBEAT")  # the parser takes no frame that is not signed
            stranger.mav.send(stranger.mav.timesync_encode(0, 1))
            station.socket.sendto(stranger.out.take(), station.peer)
            asked = time.monotonic()
            answer = station.ask(station.mav.timesync_encode(0, 2), "TIMESYNC")
            assert answer.ts1 == 2
            assert time.monotonic() - asked >= 0.3

"""Which autopilot board it is, from frames as pymavlink makes them."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.boards import boards, version_request
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer


def version(system: int, uid: int, uid2: bytes = b"", component: int = 1) -> bytes:
    """The frame of an AUTOPILOT_VERSION."""
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    message = mavlink.MAVLink_autopilot_version_message(
        1, 2, 3, 4, 5, [0] * 8, [0] * 8, [0] * 8, 6, 7, uid, list(uid2.ljust(18, b"\0"))
    )
    return bytes(message.pack(sender))


def said(*frames: bytes) -> dict[int, str]:
    _, found = Framer(Dialect.load()).feed(b"".join(frames))
    return boards(found)


def test_boards_are_distinguished_by_either_number() -> None:
    first = said(version(1, 77))[1]
    assert said(version(3, 77)) == {3: first}  # the same board with another system id
    assert said(version(1, 78))[1] != first
    long = said(version(1, 77, b"STM32 0x1234"))[1]
    assert long != first
    assert said(version(1, 99, b"STM32 0x1234"))[1] == long  # the longer number is the board's own
    assert "77" not in first


def test_who_does_not_say_and_who_is_no_autopilot_have_none() -> None:
    assert said(version(1, 0)) == {}
    assert said(version(1, 77, component=100)) == {}
    broken = bytearray(version(1, 77))
    broken[12] ^= 1
    assert said(bytes(broken)) == {}


def test_it_is_asked_for_as_the_standard_has_it() -> None:
    asked = version_request(5)
    assert (asked.target_system, asked.command, asked.param1) == (5, mavlink.MAV_CMD_REQUEST_MESSAGE, 148.0)

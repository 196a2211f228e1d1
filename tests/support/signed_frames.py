"""Frames signed by pymavlink at a given time."""

import hashlib

from mavlink_frames import Sender

KEY = hashlib.sha256(b"a passphrase").digest()
NOW = 1_790_000_000 * 1_000_000_000


def stamp(seconds: float = 0.0) -> int:
    """What MAVLink calls the time: units of 10 us since 2015."""
    return int((NOW / 1e9 - 1_420_070_400 + seconds) * 100_000)


def signed(count: int, system: int = 1, link_id: int = 0, at_s: float = 0.0, key: bytes = KEY) -> list[bytes]:
    """Frames of random messages, signed by pymavlink."""
    sender = Sender(system, 1, seed=system)
    sender.sign_from_now(key)
    sender.mavlink.signing.link_id = link_id
    sender.mavlink.signing.timestamp = stamp(at_s)
    names = ("ATTITUDE", "HEARTBEAT", "STATUSTEXT", "GPS_RAW_INT")
    return [sender.send(names[i % len(names)]).frame for i in range(count)]

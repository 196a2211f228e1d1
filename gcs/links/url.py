"""Connection strings of links, spelled as pymavlink spells them."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from gcs.errors import LinkUrlError

DEFAULT_BAUD = 115200
#: Where ArduPilot's `mcast:` and pymavlink's meet when the URL names no group.
MULTICAST_GROUP, MULTICAST_PORT = "239.255.145.50", 14550

_EXAMPLES = (
    "udpin:0.0.0.0:14550, udpout:HOST:PORT, udpbcast:ADDRESS:PORT, mcast:, tcp:HOST:PORT, tcpin:0.0.0.0:PORT "
    "or /dev/ttyUSB0,921600"
)


class LinkKind(Enum):
    """How a link is opened."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    UDP_BROADCAST = "udpbcast"
    UDP_MULTICAST = "mcast"
    TCP_CLIENT = "tcp"
    TCP_SERVER = "tcpin"
    SERIAL = "serial"


@dataclass(frozen=True)
class LinkUrl:
    """One parsed connection string.

    text: as the user wrote it; names the link in recordings and in /api/links.
    host, port: of a network link; `device` (a path, or a pattern such as /dev/ttyACM*), `baud`: of a serial one.
    """

    text: str
    kind: LinkKind
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = DEFAULT_BAUD


# pymavlink's plain "udp:" listens; only "udpout:" sends first.
_PREFIXES = {
    "udpin": LinkKind.UDP_IN,
    "udp": LinkKind.UDP_IN,
    "udpout": LinkKind.UDP_OUT,
    "udpbcast": LinkKind.UDP_BROADCAST,
    "mcast": LinkKind.UDP_MULTICAST,
    "tcp": LinkKind.TCP_CLIENT,
    "tcpin": LinkKind.TCP_SERVER,
}
_ADDRESS = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:\[\]\s]*)):(?P<port>\d{1,5})")


def parse_url(text: str) -> LinkUrl:
    """Parse a connection string; LinkUrlError says how it should have looked.

    `udpin: udp: udpout: udpbcast: mcast: tcp: tcpin:` take HOST:PORT (an IPv6 host in brackets; `mcast:` also PORT
    alone or nothing); a path or COMn is a serial device with an optional `,baud`.
    """
    text = text.strip()
    prefix, colon, rest = text.partition(":")
    if colon and prefix in _PREFIXES:
        return _parse_network(text, _PREFIXES[prefix], rest)
    device, comma, baud = text.partition(",")
    if device.startswith(("/", "./")) or re.fullmatch(r"COM\d+", device, re.IGNORECASE):
        if comma and not (baud.isdecimal() and int(baud) > 0):
            raise LinkUrlError(
                f"{text!r}: the baud rate after the comma must be a whole number, as in /dev/ttyUSB0,921600"
            )
        return LinkUrl(text, LinkKind.SERIAL, device=device, baud=int(baud) if comma else DEFAULT_BAUD)
    raise LinkUrlError(f"{text!r} is no connection string; write {_EXAMPLES}")


def link_names(urls: Sequence[str]) -> list[str]:
    """Names of links opened together: their connection strings, one given again with a number: `URL (2)`.

    /dev/ttyACM* twice may well be meant, for two radios; their bytes must not mix.
    """
    names: list[str] = []
    for url in map(str.strip, urls):
        given = sum(1 for other in urls[: len(names)] if other.strip() == url)
        names.append(f"{url} ({given + 1})" if given else url)
    return names


def _parse_network(text: str, kind: LinkKind, address: str) -> LinkUrl:
    if kind is LinkKind.UDP_MULTICAST and ":" not in address:
        address = f"{MULTICAST_GROUP}:{address or MULTICAST_PORT}"
    match = _ADDRESS.fullmatch(address)
    port = int(match["port"]) if match else -1
    if match is None or port > 65535:
        raise LinkUrlError(f"{text!r} needs HOST:PORT with a port of 0 to 65535; write {_EXAMPLES}")
    host = match["six"] or match["host"] or ""
    listens = kind in (LinkKind.UDP_IN, LinkKind.TCP_SERVER)
    if not listens and (not host or port == 0):
        raise LinkUrlError(f"{text!r} needs the host and port to connect to; write {_EXAMPLES}")
    if kind is LinkKind.UDP_MULTICAST and not _is_multicast(host):
        raise LinkUrlError(f"{text!r} needs a multicast group, as in mcast:{MULTICAST_GROUP}:{MULTICAST_PORT}")
    return LinkUrl(text, kind, host=host or "0.0.0.0", port=port)


def _is_multicast(host: str) -> bool:
    try:
        return ipaddress.IPv4Address(host).is_multicast
    except ValueError:
        return False

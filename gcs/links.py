"""Links by their connection strings."""

from __future__ import annotations

from collections.abc import Callable

from gcs.link import Link
from gcs.linkurl import LinkKind, LinkUrl, parse_url
from gcs.streamlinks import SerialLink, TcpClientLink
from gcs.tcpserver import TcpServerLink
from gcs.udplink import UdpLink

_LINKS: dict[LinkKind, Callable[[LinkUrl], Link]] = {
    LinkKind.UDP_IN: UdpLink,
    LinkKind.UDP_OUT: UdpLink,
    LinkKind.UDP_BROADCAST: UdpLink,
    LinkKind.UDP_MULTICAST: UdpLink,
    LinkKind.TCP_CLIENT: TcpClientLink,
    LinkKind.TCP_SERVER: TcpServerLink,
    LinkKind.SERIAL: SerialLink,
}


def open_link(text: str) -> Link:
    """The link of a connection string; LinkError if it is wrong, or a port to listen on is taken."""
    url = parse_url(text)
    return _LINKS[url.kind](url)


__all__ = ["Link", "SerialLink", "TcpClientLink", "TcpServerLink", "UdpLink", "open_link"]

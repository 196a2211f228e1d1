"""Links by their connection strings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from gcs.links.link import Link
from gcs.links.streams import SerialLink, TcpClientLink
from gcs.links.tcpserver import TcpServerLink
from gcs.links.udp import UdpLink
from gcs.links.url import LinkKind, LinkUrl, link_names, parse_url

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
    return _open(parse_url(text))


def open_links(texts: Sequence[str]) -> list[Link]:
    """The links of several connection strings, all or none, each with a name of its own (`link_names`).

    Raises LinkError as `open_link` does.
    """
    links: list[Link] = []
    try:
        for text, name in zip(texts, link_names(texts), strict=True):
            links.append(_open(replace(parse_url(text), text=name)))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def _open(url: LinkUrl) -> Link:
    return _LINKS[url.kind](url)


__all__ = ["Link", "SerialLink", "TcpClientLink", "TcpServerLink", "UdpLink", "open_link", "open_links"]

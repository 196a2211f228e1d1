"""How others on the network reach a service that listens on all addresses: URLs, and one of them as a QR code."""

from __future__ import annotations

import io
import socket
from urllib.parse import urlsplit, urlunsplit

# Addresses of documentation (RFC 5737, RFC 3849): nobody answers there, but the way to them is that to everywhere.
_ELSEWHERE = ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1"))
_EVERYWHERE = ("0.0.0.0", "::")


def own_addresses() -> list[str]:
    """Addresses of this computer on the networks that lead out; nothing is sent to find them."""
    found = []
    for family, elsewhere in _ELSEWHERE:
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as sock:
                sock.connect((elsewhere, 9))
                found.append(str(sock.getsockname()[0]))
        except OSError:  # on no such network
            continue
    return found


def reachable(url: str, addresses: list[str]) -> list[str]:
    """The URL by each address, where it is one of all addresses; else none: it stands there already."""
    parts = urlsplit(url)
    if parts.hostname not in _EVERYWHERE:
        return []
    hosts = [f"[{one}]" if ":" in one else one for one in addresses]
    return [urlunsplit(parts._replace(netloc=f"{host}:{parts.port}")) for host in hosts]


def qr_code(url: str) -> str:
    """A QR code of the URL in characters of a terminal."""
    import segno

    drawn = io.StringIO()
    segno.make(url, micro=False).terminal(drawn, compact=True)
    return drawn.getvalue()

"""Questions to a service, as often as a test asks them while it waits."""

from __future__ import annotations

import ssl
from functools import cache
from typing import Any

import httpx
from patience import PATIENCE_S


@cache
def _certificates() -> ssl.SSLContext:
    """Read once: left alone, httpx reads all of them for every question (30 ms), whether it needs them or not."""
    return httpx.create_ssl_context()


def asked(url: str) -> Any:
    """What the service says at the address, from JSON."""
    return httpx.get(url, timeout=PATIENCE_S, verify=_certificates()).raise_for_status().json()

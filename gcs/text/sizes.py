"""Sizes of files as people write them."""

from __future__ import annotations

import re

from gcs.errors import SettingsError

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([kmgt]i?|)b?", re.IGNORECASE)


def parse_size(text: str, option: str, least: int = 0) -> int:
    """Bytes of `512MB`, `20 GB`, `1.5GiB` or `1000000`; SettingsError naming `option` where it is none or too small."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise SettingsError(f"{option} {text}: write a size as 512MB, 20GB or 1.5GiB")
    size = round(float(match[1]) * _UNITS[match[2].lower()])
    if size < least:
        raise SettingsError(f"{option} {text}: give at least {size_text(least)}")
    return size


def size_text(size: int) -> str:
    """The size in the largest unit of which there is at least one."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"

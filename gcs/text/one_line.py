"""Texts of any origin, safe to show."""

from __future__ import annotations


def one_line(text: str) -> str:
    """A text of any origin as one printable line: no control character in it reaches a terminal or a file."""
    return " ".join("".join(one if one.isprintable() else " " for one in text).split())

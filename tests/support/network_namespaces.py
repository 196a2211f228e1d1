"""Machines of a network as network namespaces of this one: each with an address and a wire to here. Needs root."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Machine:
    """command: what runs a program there. address: its own; gateway: this machine's at the other end of the wire."""

    command: tuple[str, ...]
    address: str
    gateway: str


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def machines(count: int) -> Iterator[list[Machine]]:
    """So many namespaces, gone at the end."""
    names, made, found = [f"fleet{place}" for place in range(count)], [], []
    try:
        for place, name in enumerate(names):
            here, there = f"10.77.{place}.1", f"10.77.{place}.2"
            _ip("netns", "add", name)
            made.append(name)
            _ip("link", "add", f"{name}a", "type", "veth", "peer", "name", f"{name}b", "netns", name)
            _ip("address", "add", f"{here}/24", "dev", f"{name}a")
            _ip("link", "set", f"{name}a", "up")
            _ip("-n", name, "address", "add", f"{there}/24", "dev", f"{name}b")
            _ip("-n", name, "link", "set", f"{name}b", "up")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "route", "add", "default", "via", here)
            found.append(Machine(("ip", "netns", "exec", name), there, here))
        yield found
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "delete", name], check=False)

"""What may come from another ground station to the vehicles: who may speak, and what may be said.

Behind the connection string of a `--forward` stand its options, with commas between:

- `receive-only`: nothing. So it is where others than this machine can reach the link, unless one of the next stands.
- `commands`: everything.
- `systems=255+254`: what ground stations of these numbers say.
- `allow=MAV_CMD_NAV_TAKEOFF+PARAM_SET`: these commands (names or numbers of MAV_CMD, in COMMAND_LONG and COMMAND_INT)
  and messages, beside those that only keep a link going (HEARTBEAT, TIMESYNC, PING, SYSTEM_TIME).
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gcs.errors import LinkUrlError
from gcs.links.url import LinkKind, LinkUrl, parse_url
from gcs.mavlink.dialect import Dialect

_KEEPS_A_LINK = ("HEARTBEAT", "SYSTEM_TIME", "PING", "TIMESYNC")
# Messages that carry a MAV_CMD, and where it stands in their payload.
_COMMAND_MESSAGES, _COMMAND_OFFSET = (75, 76), 28
_OPTIONS = "receive-only, commands, systems=NUMBER+NUMBER or allow=COMMAND+MESSAGE"


@dataclass(frozen=True)
class ForwardRule:
    """speaks: whether anything passes. systems: numbers of who may speak, None for all.

    messages, commands: ids of what may be said, None for everything.
    """

    speaks: bool = True
    systems: frozenset[int] | None = None
    messages: frozenset[int] | None = None
    commands: frozenset[int] = frozenset()

    def passes(self, frame: bytes) -> bool:
        """Whether a whole MAVLink frame may go to the vehicles."""
        if not self.speaks:
            return False
        version_2 = frame[0] == 0xFD
        system = frame[5] if version_2 else frame[3]
        if self.systems is not None and system not in self.systems:
            return False
        if self.messages is None:
            return True
        message = int.from_bytes(frame[7:10], "little") if version_2 else frame[5]
        if message in _COMMAND_MESSAGES and message not in self.messages:
            payload = frame[10 : 10 + frame[1]] if version_2 else frame[6 : 6 + frame[1]]
            at = payload[_COMMAND_OFFSET : _COMMAND_OFFSET + 2].ljust(2, b"\0")  # trailing zeros are not sent
            return int.from_bytes(at, "little") in self.commands
        return message in self.messages


def parse_forward(text: str, dialect: Dialect) -> tuple[str, ForwardRule]:
    """The connection string of a `--forward` and its rule; LinkUrlError says how it should have looked."""
    url, *options = text.strip().split(",")
    if options and options[0].strip().isdecimal():  # the baud rate of a serial device
        url = f"{url},{options.pop(0).strip()}"
    link = parse_url(url)
    given: dict[str, str] = {}
    for option in options:
        name, _, value = option.strip().partition("=")
        takes_value = name in ("systems", "allow")
        if name not in ("receive-only", "commands", "systems", "allow") or takes_value != bool(value) or name in given:
            raise LinkUrlError(f"{text!r}: {option.strip()!r} is no option of a forward link; there are {_OPTIONS}")
        given[name] = value
    if "receive-only" in given and len(given) > 1:
        raise LinkUrlError(f"{text!r}: with receive-only nothing passes, so the other options say nothing")
    speaks = "receive-only" not in given and (bool(given) or not _others_reach(link))
    systems = frozenset(_numbers(text, given["systems"], _system)) if "systems" in given else None
    if "allow" not in given:
        return url, ForwardRule(speaks, systems)
    commands, messages = _allowed(text, given["allow"].split("+"), dialect)
    return url, ForwardRule(speaks, systems, frozenset(messages), frozenset(commands))


def _others_reach(link: LinkUrl) -> bool:
    """Whether anybody outside this machine can speak on a link; who holds a serial line has the vehicle's ground."""
    if link.kind is LinkKind.SERIAL:
        return False
    try:
        return not ipaddress.ip_address(link.host).is_loopback
    except ValueError:
        return link.host != "localhost"


def _numbers(text: str, given: str, number: Callable[[str], int | None]) -> list[int]:
    found = [(word, number(word)) for word in given.split("+")]
    wrong = [word for word, value in found if value is None]
    if wrong:
        raise LinkUrlError(f"{text!r}: {wrong[0]!r} is no system; write numbers of 1 to 255, as systems=255+254")
    return [value for _, value in found if value is not None]


def _system(word: str) -> int | None:
    return int(word) if word.isdecimal() and 1 <= int(word) <= 255 else None


def _allowed(text: str, words: Sequence[str], dialect: Dialect) -> tuple[set[int], set[int]]:
    """Numbers of the commands and ids of the messages that the words name."""
    commands = set[int]()
    messages = {dialect.by_name[name].id for name in _KEEPS_A_LINK if name in dialect.by_name}
    for word in words:
        name = word.strip().upper()
        if name.isdecimal():
            commands.add(int(name))
        elif name in dialect.commands:
            commands.add(dialect.commands[name])
        elif name in dialect.by_name:
            messages.add(dialect.by_name[name].id)
        else:
            raise LinkUrlError(
                f"{text!r}: {word.strip()!r} is neither a command (MAV_CMD) nor a message of the dialect {dialect.name}"
            )
    return commands, messages

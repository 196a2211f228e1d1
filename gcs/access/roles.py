"""Roles, and the least role that each operation of the interface asks for."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

_READING = frozenset(("GET", "HEAD", "OPTIONS"))
# What an administrator alone may do beside reading: aircraft stand for all flights, tokens and the log for all users.
_ADMIN_ONLY = ("/api/vehicles", "/api/tokens", "/api/audit")
# Written by nothing that they are asked: figures for a form.
_HARMLESS = frozenset(("/api/vehicles/check", "/api/vehicles/inertia"))
# Everybody who is known may leave.
_OWN = frozenset(("/api/logout",))
# Nothing is other than before behind these, whoever asks.
CHANGES_NOTHING = _HARMLESS | _OWN | {"/api/login"}


class Role(IntEnum):
    """A later one may do all that an earlier one may."""

    VIEWER = 1
    OPERATOR = 2
    ADMIN = 3

    @property
    def word(self) -> str:
        """Its name as users write it."""
        return self.name.lower()


ROLES = {role.word: role for role in Role}


@dataclass(frozen=True)
class Identity:
    """Who asks. name: as the token is called. flight: the only one that may be looked at, "" for all."""

    name: str
    role: Role
    flight: str = ""

    def may(self, method: str, path: str) -> bool:
        """Whether an operation is allowed. path: of the request, below the root."""
        if self.flight:
            return (method in _READING and _is_below(path, f"/api/flights/{self.flight}")) or path in _OWN | {"/api/me"}
        return self.role >= least_role(method, path)


def least_role(method: str, path: str) -> Role:
    """Who an operation is for: looking at things is for viewers, the rest for operators, what all share for admins."""
    if path in _OWN or path in _HARMLESS:
        return Role.VIEWER
    if any(_is_below(path, one) for one in _ADMIN_ONLY):
        reading_vehicles = method in _READING and _is_below(path, "/api/vehicles")
        return Role.VIEWER if reading_vehicles else Role.ADMIN
    return Role.VIEWER if method in _READING else Role.OPERATOR


def _is_below(path: str, folder: str) -> bool:
    return path == folder or path.startswith(f"{folder}/")

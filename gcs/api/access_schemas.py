"""Shapes of what is asked and answered about users."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from gcs.access.shares import LONGEST_DAYS

RoleName = Literal["viewer", "operator", "admin"]


class Login(BaseModel):
    """A token of the station, or that of a shared link."""

    model_config = ConfigDict(extra="forbid")
    token: str = Field(min_length=1, max_length=1000)


class Me(BaseModel):
    """Who asks. flight: the only one that a shared link shows, empty for all."""

    name: str
    role: RoleName
    flight: str


class ShareRequest(BaseModel):
    """For how long a link holds."""

    model_config = ConfigDict(extra="forbid")
    days: float = Field(default=30.0, gt=0.0, le=LONGEST_DAYS)


class Share(BaseModel):
    """A link, below the address of the station, by which id it is revoked, and until when it holds, UTC s."""

    id: str
    path: str
    expires: float


class ShareEntry(BaseModel):
    """A link that holds, without its token. maker: name of the token that it ends with. Times: UTC s."""

    id: str
    maker: str
    flight: str
    made: float
    expires: float


class TokenEntry(BaseModel):
    """A token of the file, without its text. Times: UTC s; expires: null where it holds until it is revoked."""

    name: str
    role: RoleName
    created: float
    expires: float | None


class AuditLine(BaseModel):
    """Who did what. who: empty where the token was none. count: of how many refusals of that minute it is the last."""

    time: str
    who: str
    role: str
    address: str
    method: str
    path: str
    status: int
    count: int = 1

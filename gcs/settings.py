"""Settings of the service: one frozen record, read once from the command line and the environment."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs.errors import SettingsError
from gcs.mavlink.linkoptions import LinkOptions
from gcs.recording.storage import StorageOptions

TOKEN_VARIABLE = "GCS_TOKEN"
_MIN_TOKEN = 8


@dataclass(frozen=True)
class Settings:
    """What the service is given at its start.

    connect, forward: connection strings to receive from, and of other ground stations to pass frames on to and from.
    link: dialect and signatures.
    vehicle: vehicle file or the name of a built-in one; None records only. identify: whether every flight that
    ends is identified at once.
    silence_s: silence of the vehicle that ends a flight; disarm_s: time recorded behind a disarming.
    max_upload_bytes: largest recording that may be uploaded.
    storage: how recordings are kept on disk. keep_days, keep_bytes: recordings that are older, or for which there is
    no room in that size, are deleted once they have been worked on; None keeps them.
    map: MBTiles file whose pictures lie beneath the track; None for none.
    scheduler: address of the Dask scheduler whose workers carry out jobs; None for this machine.
    tls_cert, tls_key: PEM files of the certificate and its key; None for plain HTTP. json_log: the log as JSON.
    token: of an administrator, as `Authorization: Bearer`; None where only this machine can connect, or tokens of
    the file `tokens` alone count.
    """

    data: Path
    connect: tuple[str, ...] = ()
    forward: tuple[str, ...] = ()
    link: LinkOptions = field(default_factory=LinkOptions)
    vehicle: str | None = None
    identify: bool = True
    host: str = "127.0.0.1"
    port: int = 8000
    token: str | None = None
    silence_s: float = 10.0
    disarm_s: float = 2.0
    max_upload_bytes: int = 4 * 1024**3
    storage: StorageOptions = field(default_factory=StorageOptions)
    keep_days: float | None = None
    keep_bytes: int | None = None
    map: Path | None = None
    scheduler: str | None = None
    tls_cert: Path | None = None
    tls_key: Path | None = None
    json_log: bool = False

    @property
    def flights(self) -> Path:
        """Folder of the recordings."""
        return self.data / "flights"

    @property
    def jobs(self) -> Path:
        """Folder in which running jobs leave their results."""
        return self.data / "jobs"

    @property
    def views(self) -> Path:
        """Folder of what was read of recordings for people and plots; it can be deleted."""
        return self.data / "views"

    @property
    def vehicles(self) -> Path:
        """Folder of the aircraft that the station knows."""
        return self.data / "vehicles"

    @property
    def backups(self) -> Path:
        """Folder of the catalogue's backups."""
        return self.data / "backups"

    @property
    def tokens(self) -> Path:
        """The file of tokens with roles (`gcs token`)."""
        return self.data / "tokens.json"

    @property
    def shares(self) -> Path:
        """The file of shared links."""
        return self.data / "shares.json"

    @property
    def audit(self) -> Path:
        """The log of who did what."""
        return self.data / "audit.jsonl"

    @property
    def refusals(self) -> Path:
        """The log of what was refused."""
        return self.data / "refusals.jsonl"

    @property
    def database(self) -> Path:
        """The catalogue's file."""
        return self.data / "catalogue.sqlite"


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server bound to `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def read_token(
    host: str, token_file: Path | None, environment: Mapping[str, str] = os.environ, *, others: bool = False
) -> str | None:
    """The token from GCS_TOKEN or a file; SettingsError if `host` demands one and there is none.

    others: whether the station has tokens of its own (`gcs token`).
    """
    token = environment.get(TOKEN_VARIABLE, "").strip()
    if token_file is not None:
        try:
            token = token_file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "no text in UTF-8"
            raise SettingsError(f"{token_file}: the token file cannot be read: {reason}") from error
        if not token:
            raise SettingsError(f"{token_file}: the token file is empty; write the token into it")
    if not token:
        if others or is_loopback(host):
            return None
        raise SettingsError(
            f"--host {host} can be reached by others, so a token is needed: set {TOKEN_VARIABLE} or --token-file,"
            " or make one with gcs token add"
        )
    return usable_token(token)


def usable_token(token: str) -> str:
    """The token, if a header of HTTP can carry it and it is not too short; SettingsError, without it, if not."""
    if len(token) < _MIN_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        raise SettingsError(f"the token needs at least {_MIN_TOKEN} printable ASCII characters without spaces")
    return token

"""TLS by the service itself, for a station without a proxy."""

from __future__ import annotations

import ssl
from pathlib import Path

from gcs.errors import SettingsError


def tls_context(certificate: Path, key: Path) -> ssl.SSLContext:
    """TLS 1.2 and later with a certificate (its chain behind it) and its key, both PEM. Raises SettingsError."""
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    for path in (certificate, key):
        try:
            path.open("rb").close()
        except OSError as error:
            raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        # Without a password: nobody is there to type one when the machine starts.
        context.load_cert_chain(certificate, key, password=lambda: "")
    except (ssl.SSLError, OSError, ValueError) as error:
        raise SettingsError(
            f"--tls-cert {certificate} and --tls-key {key} cannot be used: both are PEM files, the key without a"
            f" password and of this certificate ({getattr(error, 'reason', None) or error})"
        ) from error
    return context

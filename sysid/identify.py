"""Identification of one or more flights: the library's call, made in `sysid.identification.identify`."""

from sysid.identification.identify import METHODS, Identification, identify

__all__ = [
    "METHODS",
    "Identification",
    "identify",
]

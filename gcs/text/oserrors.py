"""Errors of the operating system in words that say what to do."""

from __future__ import annotations

import errno
import glob
import os

_DEVICES = ("/dev/ttyUSB*", "/dev/ttyACM*", "/dev/serial[0-9]*")


# What this computer refuses, whoever is at the other end: descriptors, memory, rights.
_OWN = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS, errno.EACCES, errno.EPERM, errno.EBADF})


def is_own(error: OSError) -> bool:
    """Whether an error is this computer's own, not one of a peer that is not there yet or any more."""
    cause = error.__cause__
    return error.errno in _OWN or (isinstance(cause, OSError) and cause.errno in _OWN)


def reason(error: OSError) -> str:
    """The system's own words: libraries put addresses as Python prints them, or the error's number, among theirs."""
    if error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return error.strerror or str(error)


def device_reason(device: str, error: OSError) -> str:
    """Why a serial device could not be opened, and what to do."""
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        there = sorted(name for pattern in _DEVICES for name in glob.glob(pattern))
        here = f"serial devices here: {', '.join(there)}" if there else "no serial device is plugged in"
        return f"there is no device {device}; {here}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"{device} may not be opened by this user; add it to the device's group (dialout) and log in again"
    if error.errno in (errno.EAGAIN, errno.EBUSY):
        return f"another program holds {device}; end that one, or name another device"
    return f"{device} cannot be opened: {reason(error)}"

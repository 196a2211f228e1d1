"""Errors of the identification package.

SysidError                     every error that data or settings can cause; its text is one line that says what to do
├── CalibrationError           bench points that cannot give the curve asked for
├── TableError                 a table of which columns, units or times are not known
├── SignalError                a signal that is missing, constant, not finite, or in the wrong unit
├── SegmentError               no airborne, excited part was found, or the part asked for holds no data
└── EstimationError            an estimation that cannot start or did not converge
    └── DivergedError          the simulated motion of the aircraft runs away, from whatever start
"""

from collections.abc import Mapping


class SysidError(Exception):
    """Base of every error that data or settings can cause."""


class CalibrationError(SysidError):
    """Bench points cannot give the curve asked for."""


class SignalError(SysidError):
    """A signal is missing, constant, not finite, or in the wrong unit."""


class TableError(SysidError):
    """A table whose columns, units or times are not known. units: columns whose unit is missing -> what it may be."""

    def __init__(self, text: str, units: Mapping[str, str] | None = None) -> None:
        super().__init__(text)
        self.units = dict(units or {})


class SegmentError(SysidError):
    """No airborne, excited part was found, or the part asked for holds no data."""


class EstimationError(SysidError):
    """An estimation cannot start, or did not converge."""


class DivergedError(EstimationError):
    """The simulated motion of the aircraft runs away, from whatever start."""

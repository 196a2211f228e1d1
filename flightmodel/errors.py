"""The errors of everything here; the text of each is one line that says what to do."""

from gcs.errors import GcsError
from sim_vehicle.errors import SimVehicleError
from sysid.errors import SysidError


class FlightModelError(SysidError):
    """What is asked of this package cannot be meant, or needs a library that is not installed."""


#: For `except ERRORS`: what data, files and settings can cause.
ERRORS = (SysidError, SimVehicleError, GcsError)

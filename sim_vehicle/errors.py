"""Errors of the vehicle package.

SimVehicleError                every error a user can cause; its text is one line that says what to do
├── VehicleFileError           a vehicle file that cannot be read, or says something impossible
├── ModelFileError             a model file that cannot be read, or an unknown coefficient or effect
├── PlanError                  a manoeuvre plan that cannot be flown
├── FlightError                a flight that cannot go on, because the aircraft is out of all bounds
├── TrimError                  no steady flight exists at the speed asked for
└── SinkError                  the place telemetry is to go to cannot be opened or written
"""


class SimVehicleError(Exception):
    """Base of every error that a user's input can cause."""


class VehicleFileError(SimVehicleError):
    """The vehicle file is missing, unreadable, or a key in it is unknown or impossible."""


class ModelFileError(SimVehicleError):
    """The model file is missing, unreadable, or names an unknown coefficient or effect."""


class PlanError(SimVehicleError):
    """A manoeuvre is unknown, or a plan file cannot be flown."""


class TrimError(SimVehicleError):
    """No steady flight was found for the speed and model given."""


class FlightError(SimVehicleError):
    """The aircraft's motion has left every bound, and the flight cannot go on."""


class SinkError(SimVehicleError):
    """A link or file for telemetry cannot be opened or written."""

"""Flight models from your own data, in Python: arrays or a table in, coefficients with error bars out.

    from flightmodel import Aircraft, Flight, identify

    flight = Flight.from_frame(table, units={"alpha": "deg", "q": "deg/s"})
    aircraft = Aircraft.estimate(span=1.27, mass=1.96)
    result = identify(flight, aircraft)
    print(result.table())

What stands here changes with major versions alone; what begins with an underscore, and everything in `gcs`, `sysid` and
`sim_vehicle`, may change with minor ones.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flightmodel.aircraft import Aircraft
    from flightmodel.analyses import design, discrepancy, identify, simulate
    from flightmodel.equations import LeastSquares, coefficients, least_squares
    from flightmodel.errors import ERRORS, FlightModelError
    from flightmodel.flight import Flight
    from flightmodel.results import Design, Discrepancy, Identification, Simulation

__all__ = [
    "ERRORS",
    "Aircraft",
    "Design",
    "Discrepancy",
    "Flight",
    "FlightModelError",
    "Identification",
    "LeastSquares",
    "Simulation",
    "coefficients",
    "design",
    "discrepancy",
    "identify",
    "least_squares",
    "simulate",
]
_PLACES = {
    "ERRORS": "errors",
    "FlightModelError": "errors",
    "Aircraft": "aircraft",
    "Flight": "flight",
    **dict.fromkeys(("Design", "Discrepancy", "Identification", "Simulation"), "results"),
    **dict.fromkeys(("LeastSquares", "coefficients", "least_squares"), "equations"),
    **dict.fromkeys(("design", "discrepancy", "identify", "simulate"), "analyses"),
}

if not TYPE_CHECKING:

    def __dir__() -> list[str]:
        """The public names, for completion."""
        return [*__all__, "__doc__", "__version__"]

    def __getattr__(name: str) -> Any:
        """What `__all__` names, loaded when it is first asked for."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)

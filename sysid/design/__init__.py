"""Design of flight tests: the standard errors that a manoeuvre will give, before it is flown."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.design.prediction import Expected, Prediction, predict, structure_of

__all__ = [
    "Expected",
    "Prediction",
    "predict",
    "structure_of",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """What `__all__` names, loaded when it is first asked for: the folder's other modules need none of it."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from sysid.design import prediction

        return getattr(prediction, name)

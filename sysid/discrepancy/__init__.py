"""Discrepancy: where simulation and measurement disagree, and which effect is missing."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.discrepancy.analysis import MAX_EFFECTS, discrepancy

__all__ = [
    "MAX_EFFECTS",
    "discrepancy",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """What `__all__` names, loaded when it is first asked for: the folder's other modules need none of it."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from sysid.discrepancy import analysis

        return getattr(analysis, name)

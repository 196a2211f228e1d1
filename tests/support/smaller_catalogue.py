"""The catalogue of effects without some of them: what a job says of physics that it has no name for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from sim_vehicle.effects import EFFECTS


@contextmanager
def catalogue_without(names: Sequence[str]) -> Iterator[None]:
    """The catalogue of this process without some effects; their places in the effect vector stay."""
    whole = dict(EFFECTS)
    for name in names:
        del EFFECTS[name]
    try:
        yield
    finally:
        EFFECTS.clear()
        EFFECTS.update(whole)

"""Libraries that some answers need: they are loaded when one is asked for, and named where they are missing."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Protocol

from flightmodel.errors import FlightModelError
from sysid.errors import SignalError

Progress = Callable[[float, str], None]


class OfColumns(Protocol):
    """What was made from a table: it knows which columns became no signal."""

    @property
    def unused(self) -> tuple[str, ...]:
        """Names of those columns."""


def library(name: str, what_for: str) -> Any:
    """A module by name. FlightModelError, with what to install, where it is not there."""
    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise FlightModelError(f"{what_for} needs {package}, which is not installed: pip install {package}") from None


def is_watched() -> bool:
    """Whether somebody looks at what is printed: a terminal, or a notebook."""
    shell = sys.modules.get("IPython")
    kind = type(shell.get_ipython()).__name__ if shell is not None and hasattr(shell, "get_ipython") else ""
    return kind == "ZMQInteractiveShell" or sys.stderr.isatty()


@contextmanager
def analysing(flights: Sequence[OfColumns]) -> Iterator[None]:
    """Around an analysis: says where time goes that is spent once, and of what is missing which columns were not used.

    numpy's remarks on trials that run away help nobody.
    """
    from sysid.identification.compile_ahead import CompileAhead

    with CompileAhead() as compiling, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        if compiling:
            print(
                "flightmodel: compiling, which the first analysis alone takes a minute for", file=sys.stderr, flush=True
            )
        compiling.wait()
        try:
            yield
        except SignalError as error:
            unused = list(dict.fromkeys(column for flight in flights for column in flight.unused))
            if not unused:
                raise
            shown = ", ".join(map(repr, unused[:12])) + (f" and {len(unused) - 12} more" if len(unused) > 12 else "")
            raise SignalError(
                f"{error}; columns of the table that became no signal: {shown}: name them, as columns={{'de': ...}}"
            ) from error


@contextmanager
def progress_bar(shown: bool | None) -> Iterator[Progress]:
    """A bar for work that takes a while. shown: None where somebody looks at it."""
    if not (is_watched() if shown is None else shown):
        yield lambda share, text: None
        return
    from tqdm import tqdm

    with tqdm(total=100, bar_format="{percentage:3.0f} %|{bar:24}| {desc}", leave=False) as bar:

        def progress(share: float, text: str) -> None:
            bar.n = round(100.0 * min(max(share, 0.0), 1.0))
            bar.set_description_str(text)

        yield progress

"""Libraries that some answers need: they are loaded when one is asked for, and named where they are missing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from flightmodel.errors import FlightModelError

Progress = Callable[[float, str], None]


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

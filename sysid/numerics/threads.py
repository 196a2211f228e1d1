"""Threads of the matrix library: one while an analysis runs, what the process had before and after."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import scipy.linalg  # noqa: F401  # its matrix library is to be loaded when the number of threads is set
from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Result = TypeVar("Result")


def one_thread() -> Any:
    """Set it for this process, or for a `with` block.

    The matrices of estimation are small: threads on them gain little, and while they wait they take the processor from
    everything else.
    """
    return threadpool_limits(limits=1, user_api="blas")


def single_threaded(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, with one thread while it runs."""

    @functools.wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with one_thread():
            return function(*args, **kwargs)

    return limited

"""Operations as methods of a client, with what they take, give and say of themselves."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound=Callable[..., Any])


def described(method: _Method, operation: Callable[..., Any]) -> _Method:
    """The method, under the name of the operation, with its arguments behind `self` and its words for `help`."""
    update_wrapper(method, operation)
    signature = inspect.signature(operation)
    own = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    method.__dict__["__signature__"] = signature.replace(parameters=[own, *signature.parameters.values()])
    return method

"""Compilation of hot loops, cached on disk so that only the very first use compiles.

numba decides by the time stamp of one file whether its cached machine code is still good, so code inlined from
another file goes stale unseen. The cache folder is therefore named after a hash of every compiled source.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


# Physical constants, places in arrays, the grammar that orders them, and the records that are handed over.
_CONSTANTS = ("constants.py", "layout.py", "aerodynamic_terms.py", "kernel_records.py")


def _fingerprint() -> str:
    """Hash of every module that compiles something, and of those whose constants are frozen into the machine code."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).resolve().parent.parent
    for package in ("sim_vehicle", "sysid", "gcs"):
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_bytes()
            if b"sim_vehicle.jit" in text or path.name in _CONSTANTS or path.parent.name == "effects":
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + text)
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "flight-model" / _fingerprint()


if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]  # set by numba at run time


def compiled_mark() -> Path:
    """File that stands in the cache folder once everything that an identification calls has been compiled."""
    folder = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]  # set by numba at run time
    return folder / f"compiled-{_fingerprint()}"


# Nothing here is called through a C function pointer, whose making takes time.
_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}


# Counting references to arrays takes longer than most of these functions work; who has no array of its own need not.
_LEAN: dict[str, Any] = {**_OPTIONS, "_nrt": False}
# Said, since numba hands a caller's choice on to what it compiles for it.
_COUNTING: dict[str, Any] = {**_OPTIONS, "_nrt": True}


def jit(function: Function) -> Function:
    """Compile a numerical function on first call and keep the machine code on disk.

    It works on arrays that its caller owns: it makes none (a slice assigned to a slice makes one on the way), returns
    none, and calls nothing that does.
    """
    return cast(Function, numba.njit(**_LEAN)(function))


def jit_arrays(function: Function) -> Function:
    """As `jit`, for a function that makes arrays or returns them, or calls one that does."""
    return cast(Function, numba.njit(**_COUNTING)(function))


def jit_fused(function: Function) -> Function:
    """As `jit`, but a product and a sum may be rounded once instead of twice, as fused machine instructions do."""
    return cast(Function, numba.njit(**_LEAN, fastmath={"contract"})(function))


def jit_fused_arrays(function: Function) -> Function:
    """As `jit_fused`, for a function that makes arrays."""
    return cast(Function, numba.njit(**_COUNTING, fastmath={"contract"})(function))


def jit_inlined(function: Function) -> Function:
    """As `jit`, and always put into its callers: a part of a hot loop whose many arrays would make a call slow."""
    return cast(Function, numba.njit(**_LEAN, forceinline=True)(function))

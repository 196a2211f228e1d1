"""Names of derivatives in other programs' files: the axis, then a letter for what it goes with."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs.errors import PriorError

#: Of every program's file: the program's name of a derivative, and ours.
DERIVATIVES = {
    "CLa": "CL_alpha", "CLq": "CL_q", "Cma": "Cm_alpha", "Cmq": "Cm_q",
    "CYb": "CY_beta", "Clb": "Cl_beta", "Cnb": "Cn_beta",
    "CYp": "CY_p", "Clp": "Cl_p", "Cnp": "Cn_p",
    "CYr": "CY_r", "Clr": "Cl_r", "Cnr": "Cn_r",
}  # fmt: skip
#: A number as these programs print it.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"


def number(text: str) -> float:
    """A number that matches `NUMBER`; Fortran writes its exponents with D as well."""
    return float(text.upper().replace("D", "E"))


def ours(found: Mapping[str, float], where: str, program: str) -> dict[str, float]:
    """The derivatives that every file must hold, by our names. Raises PriorError, one line, where some are missing."""
    missing = [name for name in DERIVATIVES if not math.isfinite(found.get(name, math.nan))]
    if missing:
        raise PriorError(
            f"{where}: holds no number for {', '.join(missing)}; give the file that {program} writes whole, with all"
            " derivatives by alpha, beta, p, q and r"
        )
    return {name: found[theirs] for theirs, name in DERIVATIVES.items()}

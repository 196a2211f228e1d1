"""The log of XFLR5's stability analysis."""

from __future__ import annotations

import math
import re

from gcs.errors import PriorError
from gcs.priors.estimate import Estimates, of_program
from gcs.priors.names import DERIVATIVES, NUMBER, number, ours
from gcs.priors.stability_axes import to_body

_BEGIN = "Longitudinal derivatives"


def read(text: str, where: str) -> Estimates:
    """Coefficients of a log of one stability analysis. where: its name, for errors.

    XFLR5's derivatives are per radian, about stability axes. Its control derivatives are those of one gain that moves
    all surfaces named in the analysis together, and their names (CLde is a rolling moment) say no surface, so that they
    are left out. Raises PriorError, one line, where something is missing or several analyses stand in the log.
    """
    analyses = text.split(_BEGIN)
    if len(analyses) < 2:
        raise PriorError(f'{where}: has no "{_BEGIN}"; give the log that XFLR5 writes of a stability analysis')
    if len(analyses) > 2:
        raise PriorError(
            f"{where}: holds {len(analyses) - 1} analyses; keep that of the flight's trim, from its control position on"
        )
    before, table = analyses
    angles = re.findall(rf"\bAlpha\s*=\s*({NUMBER})", before)
    if not angles:
        raise PriorError(f'{where}: has no "Alpha=" before its derivatives; give the log from its first line on')
    names = "|".join(DERIVATIVES)
    found = {name: number(value) for name, value in re.findall(rf"\b({names})\s*=\s*({NUMBER})(?=\s|$)", table)}
    values = to_body(ours(found, where, "XFLR5"), math.radians(number(angles[-1])))
    return Estimates(
        of_program(values), ("what the surfaces do: XFLR5 moves those of its analysis together, and names none",)
    )

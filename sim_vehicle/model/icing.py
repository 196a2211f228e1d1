"""What ice does to an aircraft's derivatives, as published."""

from __future__ import annotations

from collections.abc import Mapping

# Change of each coefficient, as a share of it, under a heavy coat of ice: Bragg et al., AIAA 2002-0813, table of a Twin
# Otter, rounded.
HEAVY_COAT: Mapping[str, float] = {
    "CL_alpha": -0.10, "CL_de": -0.10, "CD_0": 0.50, "Cm_alpha": -0.10, "Cm_q": -0.035, "Cm_de": -0.10,
    "CY_beta": -0.20, "CY_dr": -0.08, "Cl_beta": -0.10, "Cl_p": -0.10, "Cl_da": -0.10, "Cl_dr": -0.08,
    "Cn_beta": -0.20, "Cn_r": -0.06, "Cn_dr": -0.08,
}  # fmt: skip

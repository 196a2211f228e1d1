"""The tables of the notebooks: two flights that JSBSim flew and wrote, with the noise of cheap sensors added.

    python tools/example_tables.py docs/notebooks

JSBSim flies the Ultra Stick 25e with linear aerodynamics (tests/support/jsbsim_csv.py). Of its CSV output the columns
that a small aircraft measures are kept under JSBSim's own headers but for two, and the noise of the reference paper's
Table II is added to them.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from jsbsim_csv import fly_csv  # noqa: E402

# Column -> standard deviation of the noise, in its unit, and decimals kept.
KEPT = {
    "Time": (0.0, 2),
    **dict.fromkeys(("P (deg/s)", "Q (deg/s)", "R (deg/s)"), (0.03, 4)),
    **dict.fromkeys(("BodyAccel_X", "BodyAccel_Y", "BodyAccel_Z"), (0.0785 / 0.3048, 4)),
    **dict.fromkeys(("Phi (deg)", "Theta (deg)", "Psi (deg)"), (0.05, 4)),
    **dict.fromkeys(("Alpha (deg)", "Beta (deg)"), (0.3, 3)),
    "V_{Total} (ft/s)": (0.1 / 0.3048, 3),
    "Rho (slugs/ft^3)": (0.0, 9),
    **dict.fromkeys(
        ("/fdm/jsbsim/fcs/elevator-pos-rad", "/fdm/jsbsim/fcs/left-aileron-pos-rad", "/fdm/jsbsim/fcs/rudder-pos-rad"),
        (0.0, 5),
    ),
    "/fdm/jsbsim/external_reactions/thrust/magnitude": (0.02 / 4.448, 4),
}
# Properties whose names say neither what they are nor their unit.
RENAMED = {
    "/fdm/jsbsim/fcs/left-aileron-pos-rad": "Aileron Position (rad)",
    "/fdm/jsbsim/external_reactions/thrust/magnitude": "Thrust (lbf)",
}


def main() -> None:
    folder = Path(sys.argv[1])
    for number in (1, 2):
        with tempfile.TemporaryDirectory() as work:
            path, _ = fly_csv(Path(work), number)
            table = pandas.read_csv(path)[list(KEPT)]
        table = table.rename(columns=RENAMED)
        generator = np.random.default_rng(number)
        for column, (noise, decimals) in KEPT.items():
            name = RENAMED.get(column, column)
            table[name] = (table[name] + noise * generator.standard_normal(len(table))).round(decimals)
        table.to_csv(folder / f"flight{number}.csv", index=False)


if __name__ == "__main__":
    main()

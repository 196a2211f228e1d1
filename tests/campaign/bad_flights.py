"""What identification makes of bad flights: each one clear line, or the truth. Run: make campaign NAME=bad-flights

Prints a row per case: the error, or how many coefficients are given, how many of them are more than 3.5 standard errors
off the truth, and how many are refused. Anything but a named error or a result counts as a failure.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from bad_flights import cases
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify
from sysid.signals.flight import FlightSignals

FAR = 3.5


def outcome(name: str, signals: FlightSignals, true: dict[str, float]) -> tuple[str, bool]:
    """What came of one flight, and whether that is all right: true, refused, or at least said of the signal named."""
    try:
        found = identify([signals], load_vehicle("iitb-mav"))
    except SysidError as error:
        return f"error: {error}", "\n" not in str(error)
    json.dumps(result_json(found), allow_nan=False)
    given = {name: entry for name, entry in found.model.coefficients.items() if entry.value is not None}
    off = {
        name: (entry.value - true.get(name, 0.0)) / own_bar(entry)
        for name, entry in given.items()
        if entry.value is not None and entry.std is not None
    }
    far = {name: z for name, z in off.items() if abs(z) > FAR}
    told = "".join(f"; {text}" for text in found.warnings if "samples" not in text)
    worst = ", ".join(f"{name} {z:+.1f}" for name, z in sorted(far.items(), key=lambda pair: -abs(pair[1]))[:4])
    return f"{len(given)} given, {len(far)} off ({worst}), {len(found.model.refused())} refused{told}", not far or (
        f"; {name.split()[0]}: repeats" in told
    )


def main() -> int:
    """Go through the cases; the exit code says whether all is well."""
    warnings.simplefilter("error")
    true = read_model("iitb-mav").values()
    good = fly_mav("multisine", 1, duration=14.0)[0]
    flights = {"as it was": good, **cases(good), "no excitation": fly_mav("cruise", 1, duration=12.0)[0]}
    wrong = 0
    for name, signals in flights.items():
        if len(sys.argv) > 1 and not any(word in name for word in sys.argv[1:]):
            continue
        text, fine = outcome(name, signals, true)
        wrong += not fine
        print(f"{'' if fine else 'WRONG '}{name}: {text}", flush=True)
    print(f"{wrong} cases are wrong")
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())

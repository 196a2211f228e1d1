"""How well the clock fit recovers 50 ppm under 30 ms of jitter and 20 % of late packets. Run: make campaign NAME=clock

Prints one row per kind of jitter, lateness and rate of messages: errors of drift and offset over many seeds, the
standard errors that were told, and how many of the 95 % intervals hold the truth.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

from arrivals import JITTER, errors, flight, late_in_bursts, late_singly

from gcs.clock.fit import fit_clock


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    seeds = parser.parse_args().seeds
    print(
        "50 ppm, 600 s, jitter 30 ms, 20 % of the packets 50 to 500 ms late; root mean square, largest, told, coverage"
    )
    print(f"{'jitter':<12} {'late':<7} {'Hz':>3} {'in order':<9} {'drift, ppm':^29} {'offset, ms':^29}")
    for rate_hz, in_order in ((50.0, False), (50.0, True), (1.0, False)):
        for jitter in JITTER:
            for late in (late_singly, late_in_bursts):
                fits = [
                    fit_clock(*flight(seed, jitter, late, rate_hz=rate_hz, in_order=in_order)) for seed in range(seeds)
                ]
                found = np.abs([errors(fit) for fit in fits])
                told = np.array([(fit.drift_std * 1e6, fit.offset_std_s * 1e3) for fit in fits])
                rms, largest = np.sqrt(np.mean(found**2, axis=0)), found.max(axis=0)
                usual, inside = np.median(told, axis=0), np.mean(found < 1.96 * told, axis=0)
                columns = [f"{rms[i]:7.3f} {largest[i]:7.3f} {usual[i]:7.3f} {inside[i]:5.0%}" for i in (0, 1)]
                kind = "single" if late is late_singly else "bursts"
                print(
                    f"{jitter:<12} {kind:<7} {rate_hz:>3g} {'yes' if in_order else 'no':<9} {'  '.join(columns)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

"""A flight that judges a model which was fitted to it."""

import numpy as np

from gcs.analysis.judges import judged_by_itself
from sysid.flight import FlightSignals, Signal


def flight(name: str, seed: int) -> FlightSignals:
    generator = np.random.default_rng(seed)
    time_s = 0.02 * np.arange(50)
    return FlightSignals(
        name,
        {
            key: Signal(time_s, generator.normal(size=50), unit, "test")
            for key, unit in (("az", "m/s^2"), ("q", "rad/s"))
        },
    )


def test_the_same_samples_under_another_name_are_told() -> None:
    (line,) = judged_by_itself([flight("first", 1), flight("second", 2)], [flight("copy", 2), flight("third", 3)])
    assert line.startswith("copy holds the same samples as second")


def test_another_flight_is_no_matter() -> None:
    assert judged_by_itself([flight("first", 1)], [flight("second", 2)]) == []
    assert judged_by_itself([flight("first", 1)], []) == []

"""What comes late by less than stamps are known to is no effect."""

from sim_vehicle.effects import EFFECTS
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.identified_effect import within_stamps


def of(name: str, free: tuple[str, ...]) -> Candidate:
    return Candidate(EFFECTS[name], free, (dict.fromkeys(free, 0.0),))


def test_half_a_millisecond_of_a_log_at_50_hz_is_none() -> None:
    delay = of("actuator_delay", ("delay",))
    assert "0.4 ms is within what stamps are known to (1 ms)" in within_stamps(delay, {"delay": (4e-4, 0.0)}, 0.02)
    assert within_stamps(delay, {"delay": (4e-4, 0.0)}, 0.005) == ""
    assert within_stamps(delay, {"delay": (2e-3, 0.0)}, 0.02) == ""


def test_a_moment_of_the_flight_and_a_size_are_no_lateness() -> None:
    drop = of("mass_drop", ("fraction", "time"))
    assert within_stamps(drop, {"fraction": (1e-4, 0.0), "time": (1e-4, 0.0)}, 0.02) == ""
    assert within_stamps(of("pitch_damping", ("Cm_q",)), {"Cm_q": (1e-6, 0.0)}, 0.02) == ""

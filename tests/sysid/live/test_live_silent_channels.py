"""What fails by silence, or by a jump: signals that stop coming, commands that the telemetry repeats, positions."""

from __future__ import annotations

import numpy as np
import pytest
from live_flights import pieces
from simulated import signals_of

from sim_vehicle.flight.failures import Failures, parse_failure
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.live.recursive.change_detection import Change
from sysid.live.signals.row_alignment import Rows
from sysid.live.signals.sensor_failures import SensorFailure
from sysid.live.signals.silent_channels import SilentChannels
from sysid.live.watch import Watch
from sysid.live.wording import failure_sentence, failure_text

DT, STOPS_S = 0.02, 12.0


def rows(still: str = "", *, hands_off: bool = False) -> Rows:
    """16 s in which every command changes; one stands still from STOPS_S on, or all."""
    time_s = DT * np.arange(800)
    columns = {name: np.sin((k + 2.0) * time_s) for k, name in enumerate(("de", "da", "dr"))}
    held = int(np.argmax(time_s >= STOPS_S))
    for name in columns if hands_off else [still] if still else []:
        columns[name][held:] = columns[name][held]
    return Rows(DT, time_s, columns, continues=True, commands_known=np.ones(time_s.size, dtype=bool))


def test_a_command_that_the_telemetry_repeats_is_to_blame_for_its_axis() -> None:
    channels = SilentChannels()
    channels.take(rows("de"))
    assert channels.dead("Cl") is None
    found = channels.dead("Cm")
    assert found is not None
    assert (found.name, found.signal) == ("de_channel", "de")
    assert abs(found.time_s - STOPS_S) < 3.0 * DT
    assert failure_text(found) == "ELEVATOR CHANNEL since 12.0s"
    assert channels.dead("Cm") is None  # said once


@pytest.mark.parametrize("given", [rows(), rows(hands_off=True)])
def test_commands_that_change_and_hands_that_are_off_are_no_failure(given: Rows) -> None:
    channels = SilentChannels()
    channels.take(given)
    assert [channels.dead(axis) for axis in ("CL", "CD", "CY", "Cl", "Cm", "Cn")] == [None] * 6


def test_a_signal_is_gone_after_many_of_its_own_intervals() -> None:
    channels = SilentChannels()
    for name, interval in (("vn", 0.2), ("psi", 1.0), ("alpha", DT)):
        channels.note(name, np.arange(0.0, 10.0, interval))
    channels.note("alpha", np.arange(10.0, 14.0, DT))
    (gone,) = channels.gone(14.0)
    assert (gone.signal, gone.time_s) == ("gps", pytest.approx(9.8))
    assert [one.signal for one in channels.gone(16.0)] == ["psi"]
    assert channels.gone(16.0) == []
    assert failure_sentence(gone).startswith("no reading of the ground velocity of the GPS since 9.8 s: check its wire")
    channels.note("vn", np.arange(17.0, 18.0, 0.2))
    assert channels.back() == {"gps": 17.0}
    assert channels.back() == {}
    assert [one.signal for one in channels.gone(25.0)] == ["gps", "alpha"]  # lost once more


def watched(failure: str) -> LiveReport:
    """What is known at the end of a flight in which something fails after 24 s."""
    failures, vehicle = Failures([parse_failure(f"{failure}@24")]), load_vehicle("iitb-mav")
    generator = np.random.default_rng(3)
    suite = SensorSuite(vehicle, generator=generator, failures=failures)
    plant = Plant(vehicle, Failures.flyable(read_model("iitb-mav")), max_step=0.0021)
    flown = fly(plant, plan_of(["multisine"]), suite=suite, generator=generator, duration=30.0, failures=failures)
    live = LiveIdentifier(vehicle)
    for count, samples in enumerate(pieces(signals_of(flown, vehicle, failure), 0.05)):
        live.take(samples)
        if count % 8 == 0:
            report = live.report()
    return report


@pytest.mark.parametrize(
    ("failure", "name"),
    [
        ("gps-lost", "gps_lost"),
        ("gps-jump=30", "gps_jump"),
        ("servo-elevator=dead", "de_channel"),
        ("pitot-blocked", "airspeed_still"),
    ],
)
def test_silence_and_a_jump_are_reported_in_flight_and_no_aircraft_blamed(failure: str, name: str) -> None:
    report = watched(failure)
    assert [one.name for one in report.failures] == [name]
    assert abs(report.failures[0].time_s - 24.0) < 0.5
    assert report.changes == ()


def test_what_comes_or_moves_again_is_over() -> None:
    watch = Watch(load_vehicle("iitb-mav"))
    for name, end in (("vn", 10.0), ("alpha", 14.0)):
        watch.silent.note(name, np.arange(0.0, end, 0.2))
    watch.hear(14.0)
    watch.judge(14.0, {"alpha": 9.0}, {})
    assert [(one.name, one.until_s) for one in watch.failures] == [("gps_lost", None), ("alpha_still", None)]
    watch.silent.note("vn", np.arange(15.0, 16.0, 0.2))
    watch.hear(16.0)
    watch.judge(16.0, {}, {})
    assert [(one.name, one.until_s) for one in watch.failures] == [("gps_lost", 15.0), ("alpha_still", 16.0)]
    watch.judge(30.0, {"alpha": 25.0}, {})  # stuck once more
    assert [one.until_s for one in watch.failures] == [15.0, 16.0, None]


def test_a_position_that_jumps_is_no_excuse_for_the_aircraft() -> None:
    watch = Watch(load_vehicle("iitb-mav"))
    watch.failures.append(SensorFailure(12.0, "gps_jump", "gps", 30.0, "m", "the GPS position jumped"))
    assert watch.notice(12.5, Change(12.2, "Cm", "Cm_de", -1.6, -0.8, 0.05), {})
    watch.failures.append(SensorFailure(22.0, "alpha_step", "alpha", 4.0, "deg", "the alpha vane jumped"))
    assert not watch.notice(22.5, Change(22.2, "Cm", "Cm_de", -1.6, -0.8, 0.05), {})

"""Aircraft and sensors that fail in flight: what is told, how soon, by which name.

Run: make campaign NAME=live-failures

Every failure of `sim-vehicle --fail` that a flight can show, on two aircraft, in calm air and in gusts, each after
24 s of multisines, and as many flights in which nothing fails. With --board the servos lag by up to 60 ms and commands
are stamped up to 20 ms late, which the estimator does not know; with --light the inputs are half as large; with
--jsbsim JSBSim flies its own aircraft behind the servos, sensors and links of the field's mild family. A line of the
store is one flight; a run that is broken off goes on where it stopped.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "benchmarks")]

from jsbsim_failures import BREAKS, broken_flight  # noqa: E402
from live_flights import Here, pieces  # noqa: E402
from seed_lines import fingerprint, fly_missing  # noqa: E402
from simulated import signals_of  # noqa: E402

from sim_vehicle.effects import parse_effect  # noqa: E402
from sim_vehicle.flight.failures import Failures, parse_failure  # noqa: E402
from sim_vehicle.flight.flight_loop import fly  # noqa: E402
from sim_vehicle.flight.plant import Plant  # noqa: E402
from sim_vehicle.flight.sensor_suite import SensorSuite  # noqa: E402
from sim_vehicle.manoeuvres.plan import Plan, plan_of  # noqa: E402
from sim_vehicle.model.model_file import read_model  # noqa: E402
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle  # noqa: E402
from sysid.live.identifier import LiveIdentifier  # noqa: E402
from sysid.signals.flight import FlightSignals  # noqa: E402

OUTPUT = ROOT / "campaign-output" / "live-failures"
AT_S, SECONDS, EVERY_S = 24.0, 36.0, 0.4
VEHICLES = ("iitb-mav", "ultrastick25e")
GUSTS_M_S, GUST_LENGTH_M = (0.0, 0.3), 40.0
# What fails: what is to be told (a cause's short name, or a signal), and its size as it is told, NaN where none is.
AIRCRAFT: dict[str, tuple[str, float]] = {
    "elevator=0.5": ("ELEVATOR", 50.0), "aileron=0.5": ("AILERONS", 50.0), "rudder=0.5": ("RUDDER", 50.0),
    "elevator=0": ("ELEVATOR", 0.0), "rudder=0": ("RUDDER", 0.0), "elevator-stuck": ("ELEVATOR STUCK", np.nan),
    "one-aileron=5": ("ONE AILERON OFF", 5.0), "tail=0.6": ("TAILPLANE", 60.0), "fin=0.5": ("FIN", 50.0),
    "wing-tip=0.01": ("WING", np.nan), "ice=1.5": ("ICE", 150.0), "flap=0.2": ("FLAPS", 0.2),
    "gear=0.03": ("DRAG", 0.03), "mass=0.85": ("MASS", 85.0), "cg=0.05": ("CG", 5.0),
}  # fmt: skip
SENSORS: dict[str, str] = {
    "pitot-blocked": "airspeed", "pitot-leak=0.6": "airspeed", "pitot-ice=5": "airspeed", "pitot-drift=0.5": "airspeed",
    "alpha-stuck": "alpha", "alpha-bent=5": "alpha", "alpha-slow=0.3": "alpha",
    "beta-stuck": "beta", "beta-bent=5": "beta", "gyro-p=0.026": "p", "gyro-q=0.026": "q", "gyro-r=0.035": "r",
    "accelerometer-x=0.7": "ax", "accelerometer-y=0.7": "ay", "accelerometer-z=0.7": "az", "compass=25": "psi",
    "gps-lost": "gps", "gps-jump=30": "gps", "servo-elevator=dead": "de", "servo-rudder=dead": "dr",
}  # fmt: skip
# JSBSim's flights have no position.
NOT_IN_JSBSIM = ("gps-jump=30",)
QUIET = "nothing"
LEAST_LAG_S, MOST_LAG_S, MOST_SHIFT_S = 0.001, 0.06, 0.02
COMMANDS = ("de", "da", "dr", "throttle")
QUIET_PLANS = ("multisine", "elevator-3211,aileron-3211,rudder-3211,cruise", "multisine,throttle-step", "cruise")


@dataclass(frozen=True)
class Conditions:
    """board: lags of servos and late stamps of commands that nobody knows of. light: inputs half as large. jsbsim:
    another plant, sensors of the field, and estimates by the window beside, as the service has them.
    """

    board: bool = False
    light: bool = False
    jsbsim: bool = False

    @property
    def mark(self) -> str:
        """A word for the store."""
        return f"{'-board' if self.board else ''}{'-light' if self.light else ''}{'-jsbsim' if self.jsbsim else ''}"


def flown(case: str, vehicle: str, gusts: float, seed: int, conditions: Conditions) -> FlightSignals:
    """One flight in which a case fails."""
    failures = Failures([] if case == QUIET else [parse_failure(f"{case}@{AT_S:g}")])
    craft, model = load_vehicle(vehicle), Failures.flyable(read_model(vehicle))
    if gusts:
        model = model.with_effect(*parse_effect(f"turbulence:sigma={gusts:g},length={GUST_LENGTH_M:g}"))
    generator = np.random.default_rng(seed)
    lag, shift = generator.uniform((LEAST_LAG_S, 0.0), (MOST_LAG_S, MOST_SHIFT_S)) if conditions.board else (0.0, 0.0)
    if conditions.board:
        model = model.with_effect(*parse_effect(f"actuator_lag:tau={lag:.4f}"))
    suite = SensorSuite(craft, generator=generator, failures=failures)
    plan = plan_of((QUIET_PLANS[seed % len(QUIET_PLANS)] if case == QUIET else "multisine").split(","))
    if conditions.light:
        plan = Plan(tuple(replace(one, amplitude=0.5 * one.amplitude) for one in plan.segments))
    plant = Plant(craft, model, max_step=0.0021)
    found = fly(plant, plan, suite=suite, generator=generator, duration=SECONDS, failures=failures)
    signals = signals_of(found, craft, case)
    late = {n: replace(one, time_s=one.time_s + shift) for n, one in signals.signals.items() if n in COMMANDS}
    return replace(signals, signals={**signals.signals, **late})


def flown_by_jsbsim(case: str, gusts: float, seed: int) -> tuple[FlightSignals, Vehicle]:
    """One flight in which a case fails, by another engine."""
    with tempfile.TemporaryDirectory() as folder:
        kind = "multisine" if case != QUIET else ("multisine", "3211", "doublet", "hold")[seed % 4]
        return broken_flight(Path(folder), case, AT_S, SECONDS, gusts, seed, kind=kind)


def cases(seeds: int, conditions: Conditions) -> list[tuple[str, str, float, int]]:
    """Every flight: what fails, the vehicle, m/s of gusts, the seed."""
    failing = [*AIRCRAFT, *SENSORS]
    if conditions.jsbsim:
        failing = [case for case in failing if case in BREAKS or (case in SENSORS and case not in NOT_IN_JSBSIM)]
    every = [*failing, *([QUIET] * len(failing))]
    return [
        (case, VEHICLES[(place + seed) % len(VEHICLES)], gusts, 100 * seed + place)
        for seed in range(seeds)
        for place, case in enumerate(every)
        for gusts in GUSTS_M_S
    ]


def trial(number: int, seeds: int, conditions: Conditions) -> dict[str, Any]:
    """One flight: what was told, and when."""
    case, vehicle, gusts, seed = cases(seeds, conditions)[number]
    line: dict[str, Any] = {"seed": number, "case": case, "vehicle": vehicle, "gusts": gusts}
    craft = load_vehicle(vehicle)
    if conditions.jsbsim:
        signals, craft = flown_by_jsbsim(case, gusts, seed)
    else:
        signals = flown(case, vehicle, gusts, seed, conditions)
    live = LiveIdentifier(craft, Here() if conditions.jsbsim else None)
    told_at: dict[str, float] = {}
    for count, samples in enumerate(pieces(signals, EVERY_S / 8.0), 1):
        live.take(samples)
        if count % 8:
            continue
        report = live.report()
        for one in report.failures:
            told_at.setdefault(one.name, count / 8 * EVERY_S)
        for change in report.changes:
            told_at.setdefault(f"{change.time_s}", count / 8 * EVERY_S)
    line["sensors"] = [[told_at[one.name], one.signal, one.text] for one in report.failures]
    line["changes"] = [
        [
            told_at[f"{change.time_s}"], text,
            [[one.cause.short, one.probability, one.size, one.std] for one in change.causes[:3]],
        ]
        for change, text in zip(report.changes, report.sentences(), strict=True)
    ]  # fmt: skip
    return line


def table(lines: Sequence[dict[str, Any]]) -> None:
    """What was told of each case, in markdown."""
    print("| fails | told | after, s | right first | in the first three | size within its bar | as the other kind |")
    print("|---|---|---|---|---|---|---|")
    by_case: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        by_case[line["case"]].append(line)
    sums = {"aircraft": np.zeros(7), "sensors": np.zeros(7)}
    delays: dict[str, list[float]] = {"aircraft": [], "sensors": []}
    for case, of in by_case.items():
        if case == QUIET:
            continue
        kind = "aircraft" if case in AIRCRAFT else "sensors"
        row, late = _row(case, of)
        sums[kind] += row
        delays[kind] += late
        print(_words(f"`{case}`", row, late))
    for kind, row in sums.items():
        print(_words(f"**{kind}**", row, delays[kind]))
    quiet = by_case[QUIET]
    false = [line for line in quiet if line["sensors"] or line["changes"]]
    print(f"\nfalse alarms: {len(false)} of {len(quiet)} flights in which nothing fails")
    for line in false:
        print(
            "  ", line["vehicle"], line["gusts"], [one[-1] for one in line["sensors"]], [c[1] for c in line["changes"]]
        )


def _row(case: str, of: Sequence[dict[str, Any]]) -> tuple[Any, list[float]]:
    """Flights, told, right first, in three, sizes that hold, sizes there are, told as the other kind; delays, s."""
    row, late = np.zeros(7), []
    for line in of:
        row[0] += 1
        after = [one for one in line["sensors"] if one[0] > AT_S - 0.5]
        changes = [one for one in line["changes"] if one[0] > AT_S - 0.5]
        if case in SENSORS:
            row[6] += bool(changes)
            if after:
                row[1] += 1
                late.append(after[0][0] - AT_S)
                row[2] += after[0][1] == SENSORS[case]
                row[3] += SENSORS[case] in [one[1] for one in after]
            continue
        row[6] += bool(after)
        if not changes:
            continue
        right, size = AIRCRAFT[case]
        row[1] += 1
        late.append(changes[0][0] - AT_S)
        causes = changes[0][2]
        row[2] += bool(causes) and causes[0][0] == right
        row[3] += right in [one[0] for one in causes]
        for name, _, value, std in causes[:1]:
            if name == right and np.isfinite(size):
                row[5] += 1
                row[4] += abs(value - size) < 1.96 * std
    return row, late


def _words(name: str, row: Any, late: Sequence[float]) -> str:
    flights, told, first, three, held, sizes, other = row
    delay = f"{np.median(late):.1f}" if late else ""
    size = f"{held:.0f} of {sizes:.0f}" if sizes else ""
    return f"| {name} | {told:.0f} of {flights:.0f} | {delay} | {first:.0f} | {three:.0f} | {size} | {other:.0f} |"


def main() -> int:
    """Fly what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="Failures in flight, told live.")
    parser.add_argument("--seeds", type=int, default=1, help="flights of each case in each air (default 1)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--board", action="store_true", help="servos that lag, commands stamped late")
    parser.add_argument("--light", action="store_true", help="inputs half as large")
    parser.add_argument("--jsbsim", action="store_true", help="JSBSim flies, behind sensors of the field")
    given = parser.parse_args()
    conditions = Conditions(given.board, given.light, given.jsbsim)
    support = ("field_plant", "field_sensors", "field_flight", "jsbsim_failures") if given.jsbsim else ()
    mark = fingerprint(("sysid", "sim_vehicle", "live_flights", "simulated", *support))
    numbers = range(len(cases(given.seeds, conditions)))
    table(
        fly_missing(trial, numbers, given.workers, OUTPUT / f"{mark}{conditions.mark}.jsonl", given.seeds, conditions)
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The campaigns and benchmarks: one table of what each is, how long it takes and which options of make it takes.

    make campaign NAME=discrepancy PART=off-list SEEDS=1
    make bench-peers

Without a name the table is printed. Options come from the environment, into which make puts the variables of its
command line. Under `make -n` the command is printed and not run. Only the standard library is needed.
"""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import subprocess
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class LongRun:
    """A script that runs for minutes to hours.

    options: variable of make -> value where none is given; empty leaves it to the script. SEEDS becomes `--seeds`.
    switches: variables of make of which any value becomes an option without one, as SHORT=1 `--short`.
    reads: variables that the script reads from the environment itself, with what stands there where none is given.
    at_full: values where none is given and FULL=1 is. needs: what is set up beside `make setup`, as `interop`.
    """

    script: str
    about: str
    time: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    switches: tuple[str, ...] = ()
    reads: Mapping[str, str] = field(default_factory=dict)
    at_full: Mapping[str, str] = field(default_factory=dict)
    needs: str = ""
    hint: str = ""

    @property
    def variables(self) -> tuple[str, ...]:
        """Variables of make that are heeded."""
        full = ("FULL=1",) if self.at_full else ()
        return (*self.options, *self.reads, *full, *(f"{name}=1" for name in self.switches))

    def command(self, python: str, given: Mapping[str, str]) -> list[str]:
        """The words of the command, with the options that are given."""
        defaults = {**self.options, **(self.at_full if given.get("FULL") else {})}
        words = [python, *self.script.split()]
        for name, default in defaults.items():
            if value := given.get(name) or default:
                words += [_option(name), value]
        return words + [_option(name) for name in self.switches if given.get(name)]

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """What the script finds in the environment beside what is there."""
        return {name: value for name, default in self.reads.items() if (value := given.get(name) or default)}


def _option(variable: str) -> str:
    return "--" + variable.lower().replace("_", "-")


CAMPAIGNS = {
    "identification": LongRun(
        "tests/campaign/identification.py",
        "how near to the bound identification comes, and whether its intervals hold",
        "400 flights of each scenario, hours; what is there is kept",
        {"SEEDS": "", "SCENARIOS": "all", "METHOD": ""},
        hint="less of it: SEEDS=20 SCENARIOS=pulse,six-axis; METHOD=map: the estimator for flights of the field",
    ),
    "equation-error": LongRun("tests/campaign/equation_error.py", "bias and coverage of equation error", "20 flights"),
    "bench": LongRun(
        "tests/campaign/bench.py",
        "whether intervals hold when every aircraft has its own bench",
        "40 flights",
        reads={"SEEDS": ""},
    ),
    "design": LongRun(
        "tests/campaign/design.py", "whether flights keep what `gcs design` promised", "24 flights of each scenario"
    ),
    "field": LongRun(
        "tests/campaign/field.py",
        "flights of JSBSim's as the field has them, identified and judged",
        "120 flights, hours; what is there is kept",
        {"METHODS": "auto,ls", "FAMILIES": "all", "SEEDS": ""},
        ("SHORT", "STEPS", "RATES"),
        hint="less of it: FAMILIES=typical,rough SEEDS=2; SHORT=1: 14 flights; STEPS=1: textbook flights, one"
        " imperfection at a time; RATES=1: aircraft of JSBSim's, measured surfaces at 20, 50 and 100 Hz",
    ),
    "sensor-bars": LongRun(
        "tests/campaign/sensor_bars.py",
        "whether bars of sensor errors, wind and dimensional derivatives hold, whatever is known of the inertia",
        "63 flights of JSBSim's as the field has them, 10 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "KNOWN": ""},
        hint="less of it: FAMILIES=typical SEEDS=1 KNOWN=guessed",
    ),
    "tuning": LongRun(
        "tests/campaign/tuning.py",
        "whether intervals of the parameters hold that `gcs tune` proposes",
        "42 flights, 5 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "FIRST": ""},
        hint="less of it: FAMILIES=typical,aerosonde SEEDS=2; FIRST=100: other flights",
    ),
    "margins": LongRun(
        "tests/campaign/loop_margins.py",
        "whether the gain that `gcs margins` calls the limit oscillates in flight",
        "21 flights, 3 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "FIRST": ""},
        hint="less of it: FAMILIES=aerosonde SEEDS=2; FIRST=100: other flights",
    ),
    "performance": LongRun(
        "tests/campaign/performance.py",
        "whether the intervals of `gcs performance` hold: glide, sink, endurance and range of a battery",
        "36 flights, 9 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "FIRST": ""},
        hint="less of it: FAMILIES=aerosonde SEEDS=2; FIRST=100: other flights",
    ),
    "benchmark": LongRun(
        "tests/campaign/benchmark.py",
        "short flights of aircraft that the structure only nearly is: whether the bars hold, alone and together",
        "80 windows of 20 flights of JSBSim's, 5 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "FIRST": ""},
        hint="less of it: FAMILIES=slipstream SEEDS=2; FIRST=100: other flights",
    ),
    "coast": LongRun(
        "tests/campaign/coasting.py",
        "how far `gcs coast` strays in a minute without GPS, and whether its ellipses hold that",
        "60 cuts of 30 flights of JSBSim's, 10 min; what is there is kept",
        {"FAMILIES": "", "SEEDS": "", "FIRST": ""},
        hint="less of it: FAMILIES=typical SEEDS=2; FIRST=100: other flights",
    ),
    "jsbsim": LongRun(
        "tests/campaign/other_engine.py",
        "how true identification is to another engine",
        "40 flights of each scenario; what is there is kept",
    ),
    "methods": LongRun(
        "tests/campaign/methods.py",
        "whether ee, oe, fe and map agree with each other and with the truth",
        "60 flights of another engine, a quarter of a minute each; what is there is kept",
        {"METHODS": "", "FLIGHTS": "", "FIRST": ""},
        hint="less of it: FLIGHTS=12 METHODS=ee,map; FIRST=60: other flights",
    ),
    "jsbsim-effects": LongRun(
        "tests/campaign/effects_in_jsbsim.py",
        "whether effects are named that another engine flies",
        "21 flights, a quarter of a minute each; what is there is kept",
        {"EFFECTS": "all", "SIZES": "1", "SEEDS": "1", "FAMILIES": "textbook", "AIRCRAFT": "0"},
        ("UNLISTED",),
        hint="SIZES=1,0.5: of half their sizes too; AIRCRAFT=1,2,3: other aircraft; UNLISTED=1: each effect out of the"
        " catalogue; FAMILIES=mild,typical: servos, sensors and link of field flights, in gusts; FAMILIES=plans:"
        " many manoeuvres, more effects, and six of no catalogue; EFFECTS=none: nothing is hidden",
    ),
    "discrepancy": LongRun(
        "tests/campaign/discrepancy.py",
        "whether hidden effects are named where the flight can show them, and nothing where not",
        "hundreds of cases, half a minute each and worker; what is there is kept",
        {"SEEDS": "5", "SIZES": "2", "EFFECTS": "all", "PART": "single", "METHOD": "", "MINUTES": "", "WORKERS": ""},
        at_full={"SEEDS": "20", "SIZES": "3"},
        hint="less: SEEDS=1 SIZES=1 EFFECTS=stall,vane_lag; FULL=1: 20 seeds of 3 sizes; PART=none: nothing hidden;"
        " PART=pairs: two effects at once, PART=off-list: one taken out of the catalogue, PART=separating;"
        " METHOD=map or fe: under one noise model alone",
    ),
    "mistakes": LongRun(
        "tests/campaign/mistakes.py",
        "mistakes put into the signals: which are named, and what they do",
        "196 mistakes of each flight; what is there is kept",
    ),
    "bad-flights": LongRun("tests/campaign/bad_flights.py", "bad flights: each ends in one clear line or in the truth"),
    "live": LongRun(
        "tests/campaign/live.py",
        "live identification: errors, coverage, changes and false alarms",
        "100 flights, 20 s each and worker; what is there is kept",
        {"SEEDS": "", "WORKERS": ""},
        ("POST",),
        hint="POST=1: compared with identification after the flight",
    ),
    "live-failures": LongRun(
        "tests/campaign/live_failures.py",
        "aircraft and sensors that fail in flight, and flights in which nothing does",
        "136 flights with SEEDS=1, 4 s each; what is there is kept",
        {"SEEDS": "", "WORKERS": ""},
        ("BOARD", "LIGHT", "JSBSIM"),
        hint="BOARD=1: servos that lag and commands stamped late; LIGHT=1: inputs half as large; JSBSIM=1: another"
        " engine behind sensors of the field",
    ),
    "live-field": LongRun(
        "tests/campaign/live_field.py",
        "live estimates behind the sensors of the field",
        "half a minute a flight; what is there is kept",
        {"FAMILIES": "", "SEEDS": ""},
        hint="less of it: FAMILIES=mild SEEDS=2",
    ),
    "clock": LongRun(
        "tests/campaign/clock.py", "the fit of the vehicle's clock under jitter", "200 seeds of each kind"
    ),
    "fleet": LongRun(
        "tests/campaign/fleet.py",
        "batches of flights on a Dask cluster",
        "200 flights, minutes",
        {"FLIGHTS": "200"},
        ("NAMESPACES",),
        hint="NAMESPACES=1 (root): workers as on other machines",
    ),
    "fuzz": LongRun(
        "tests/campaign/fuzz.py",
        "whole and broken frames through framing and recording",
        "ten million frames; what is there is kept",
    ),
    "load": LongRun(
        "tests/campaign/load.py", "the service under load, with identification beside it", "eleven minutes"
    ),
    "crash": LongRun(
        "tests/campaign/crash.py",
        "stations that are killed, files cut off, bits flipped",
        "2,500 trials; what is there is kept",
    ),
    "recorder": LongRun("tests/campaign/full_disk.py", "a disk that fills up under a recording"),
    "attack": LongRun(
        "tests/campaign/attack.py",
        "attacks on a service that records: what they cost",
        "27 attacks of 15 s, one of five minutes; what is there is kept",
    ),
    "api": LongRun(
        "-m pytest -s --timeout=3600 tests/interop/test_api_fuzz.py",
        "calls of the REST interface by Schemathesis",
        "10,000 calls, half an hour",
        reads={"FUZZ_SECONDS": "1800"},
        needs="interop",
        hint="FUZZ_SECONDS=60: a minute",
    ),
    "faults": LongRun(
        "tests/campaign/faults.py",
        "faults of the machine under a service: kills, disks, clocks, networks",
        "138 trials; what is there is kept",
    ),
    "soak": LongRun(
        "tests/campaign/soak.py",
        "a service with vehicles, pages and jobs for hours",
        "two hours",
        {"MINUTES": ""},
    ),
    "page": LongRun(
        "tests/campaign/page_hour.py",
        "the live page in a browser",
        "an hour",
        {"MINUTES": "60"},
        needs="interop",
        hint="MINUTES=6: six minutes",
    ),
}
BENCHMARKS = {
    "framing": LongRun("benchmarks/framing.py", "framing of a byte stream, against pymavlink"),
    "recording": LongRun("benchmarks/recording.py", "writing and reading recordings, against others", needs="bench"),
    "udp": LongRun("benchmarks/udp.py", "receiving and recording UDP, against mavutil and mcap-python"),
    "regression": LongRun("benchmarks/regression.py", "least squares on a million samples, against statsmodels"),
    "simulation": LongRun("benchmarks/simulation.py", "steps of the simulation, against JSBSim"),
    "identification": LongRun(
        "benchmarks/output_error.py", "one iteration of output error, against CasADi", needs="bench"
    ),
    "posterior": LongRun("benchmarks/posterior.py", "the search of `map`, against scipy and output error"),
    "job": LongRun("benchmarks/job.py", "`gcs identify` from file to result"),
    "programs": LongRun("benchmarks/programs.py", "how soon a job, an upload or a report begins, against python -m"),
    "page": LongRun("benchmarks/page.py", "the answers that plot a flight of one hour"),
    "peers": LongRun("benchmarks/peers.py", "whole identifications, against AeroID, scipy, statsmodels", needs="bench"),
    "discrepancy-peers": LongRun(
        "benchmarks/discrepancy_peers.py",
        "what a missing effect leaves, against PySINDy and a Gaussian process",
        "eight effects, calm and turbulent, a minute each; what is there is kept",
        {"EFFECTS": "", "SEEDS": ""},
        needs="bench",
        hint="less of it: EFFECTS=stall SEEDS=1",
    ),
    "discrepancy-cost": LongRun("benchmarks/discrepancy_cost.py", "CPU time of the discrepancy job by stage"),
    "live": LongRun(
        "benchmarks/live.py", "CPU and latency of live identification over a minute of flight", "a minute and a half"
    ),
}
KINDS = {"campaign": CAMPAIGNS, "bench": BENCHMARKS}
SPELLINGS = {"campaign": "make campaign NAME=...", "bench": "make bench-..."}


def listing(kind: str) -> str:
    """The table of a kind: a line for each run, then its options."""
    lines = [f"{SPELLINGS[kind]}, of:"]
    for name, run in KINDS[kind].items():
        lines.append(f"  {name:18} {run.about}{f' ({run.time})' if run.time else ''}")
        options = "; ".join(part for part in (" ".join(run.variables), run.hint) if part)
        lines += textwrap.wrap(options, 116, initial_indent=" " * 21, subsequent_indent=" " * 23)
    return "\n".join(lines)


def only_shown(makeflags: str) -> bool:
    """Whether make was called with -n: its flags of one letter stand first, in one word without a dash."""
    first = makeflags.split(" ")[0]
    return not first.startswith("-") and "=" not in first and "n" in first


def main() -> int:
    """Print the table, or become the script that is named."""
    parser = argparse.ArgumentParser(description="Runs a campaign or a benchmark; without a name lists them.")
    parser.add_argument("kind", nargs="?", choices=KINDS, help="without one both are listed")
    parser.add_argument("name", nargs="?", help="of the run")
    parser.add_argument("--venv", default=".venv", help="environment that it runs in (default .venv)")
    given = parser.parse_args()
    if not given.name:
        # A reader that has seen enough of the list, as `head`, ends it.
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        print("\n\n".join(listing(kind) for kind in ([given.kind] if given.kind else KINDS)))
        return 0
    run = KINDS[given.kind].get(given.name)
    if run is None:
        print(f"There is no {given.kind} {given.name!r}. {listing(given.kind)}", file=sys.stderr)
        return 2
    if run.needs:
        done = subprocess.run(["make", "--no-print-directory", f"{given.venv}/.{run.needs}"], cwd=ROOT, check=False)
        if done.returncode != 0:
            return done.returncode
    words, added = run.command(f"{given.venv}/bin/python", os.environ), run.environment(os.environ)
    print(*(f"{name}={shlex.quote(value)}" for name, value in added.items()), shlex.join(words), flush=True)
    if only_shown(os.environ.get("MAKEFLAGS", "")):
        return 0
    os.chdir(ROOT)
    os.execve(words[0], words, {**os.environ, **added})


if __name__ == "__main__":
    sys.exit(main())

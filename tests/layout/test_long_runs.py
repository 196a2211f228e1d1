"""The table behind `make campaign` and `make bench-...`: its scripts exist and take the options that it gives them."""

from __future__ import annotations

import runpy
import subprocess

import pytest
from doc_commands import ROOT

TOOL = runpy.run_path(str(ROOT / "tools" / "long_runs.py"))
RUNS = [(kind, name) for kind, runs in TOOL["KINDS"].items() for name in runs]


def make(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", *words], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("kind", "name"), RUNS)
def test_a_script_exists_and_takes_every_option_that_the_table_gives_it(kind: str, name: str) -> None:
    run = TOOL["KINDS"][kind][name]
    script = ROOT / run.script.split()[-1]
    text = script.read_text(encoding="utf-8")
    if "import resumable" in text:  # what several campaigns take their options by
        text += (script.parent / "resumable.py").read_text(encoding="utf-8")
    every = dict.fromkeys((*run.options, *run.switches), "1")
    for word in run.command("python", every)[2:]:
        if word.startswith("--") and word not in run.script:
            assert f'"{word}"' in text
    for variable in run.reads:
        assert f'"{variable}"' in text


def test_every_campaign_is_in_the_table() -> None:
    scripts = {path for path in (ROOT / "tests" / "campaign").glob("*.py") if "__main__" in path.read_text()}
    listed = {ROOT / run.script for run in TOOL["CAMPAIGNS"].values() if not run.script.startswith("-m")}
    assert listed == scripts


@pytest.mark.parametrize("words", [("campaign", "NAME=discrepancy"), ("campaign-discrepancy",)])
@pytest.mark.parametrize(
    ("given", "options"),
    [
        ((), "--seeds 5 --sizes 2 --effects all --part single"),
        (("PART=off-list", "SEEDS=1"), "--seeds 1 --sizes 2 --effects all --part off-list"),
        (("FULL=1", "SEEDS=2", "WORKERS=1"), "--seeds 2 --sizes 3 --effects all --part single --workers 1"),
    ],
)
def test_variables_of_make_become_options(words: tuple[str, ...], given: tuple[str, ...], options: str) -> None:
    done = make("-n", *words, *given)
    assert done.returncode == 0, done.stderr
    assert f".venv/bin/python tests/campaign/discrepancy.py {options}\n" in done.stdout


def test_switches_and_what_a_script_reads_itself_are_handed_over() -> None:
    assert (
        "tests/campaign/field.py --methods auto,ls --families all --short\n"
        in make("-n", "campaign-field", "SHORT=1").stdout
    )
    assert "FUZZ_SECONDS=60 .venv/bin/python -m pytest" in make("-n", "campaign-api", "FUZZ_SECONDS=60").stdout


def test_without_a_name_they_are_listed_and_a_wrong_name_is_an_error() -> None:
    listed = make("campaign").stdout
    assert all(f"  {name} " in listed for name in TOOL["CAMPAIGNS"])
    wrong = make("-n", "campaign", "NAME=nothing")
    assert wrong.returncode != 0
    assert "There is no campaign 'nothing'" in wrong.stderr
    assert make("-n", "bench-nothing").returncode != 0


def test_help_lists_targets_campaigns_and_benchmarks() -> None:
    shown = make("help").stdout
    assert all(f"\n{target} " in f"\n{shown}" for target in ("setup", "demo", "test", "campaign", "clean"))
    assert "  discrepancy " in shown
    assert "  discrepancy-peers " in shown


@pytest.mark.parametrize(
    ("flags", "shown"),
    [
        ("n", True),
        ("ns -- NAME=x", True),
        ("", False),
        (" -- NAME=n", False),
        ("--no-print-directory", False),
        ("k", False),
    ],
)
def test_make_shows_what_it_would_run(flags: str, shown: bool) -> None:
    assert TOOL["only_shown"](flags) == shown

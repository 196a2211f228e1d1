"""Reports for many at once: some wait, the others are asked to come again, and none takes the threads of all."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest
from traffic import wait_until

from gcs.errors import ReportError, ServiceError
from gcs.jobs.reports import Reports

WAITING = """
import sys, time
from pathlib import Path
sys.stdin.read()
while not Path(sys.argv[1]).exists():
    time.sleep(0.02)
print("<html>")
"""


def test_a_report_that_too_many_wait_for_is_asked_for_again(tmp_path: Path) -> None:
    go = tmp_path / "go"
    reports = Reports((sys.executable, "-c", WAITING, str(go)))
    answers: list[str] = []

    def ask() -> None:
        try:
            answers.append(reports.page({}).strip())
        except ServiceError as error:
            answers.append(str(error))

    askers = [threading.Thread(target=ask) for _ in range(10)]
    for asker in askers:
        asker.start()
    wait_until(lambda: len(answers) == 6)
    assert set(answers) == {"other reports are being made; ask again in a minute"}
    go.touch()
    for asker in askers:
        asker.join()
    assert answers.count("<html>") == 4
    assert reports.page({}) == "<html>\n"


def test_why_none_was_made_is_its_last_word_and_one_that_takes_too_long_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(ReportError, match="names no schema"):
        Reports().page({})
    with pytest.raises(ServiceError, match="exit code 3"):
        Reports((sys.executable, "-c", "import sys; sys.exit(3)")).page({"much": "x" * 1_000_000})
    # What nobody thought of is the station's fault, not the result's.
    with pytest.raises(ServiceError, match="exit code 1"):
        Reports((sys.executable, "-c", "raise KeyError('x')")).page({})
    monkeypatch.setattr("gcs.jobs.reports._LONGEST_S", 0.2)
    with pytest.raises(ServiceError, match=r"not made within 0.2 s; make it by hand"):
        Reports((sys.executable, "-c", "import time; time.sleep(600)")).page({})

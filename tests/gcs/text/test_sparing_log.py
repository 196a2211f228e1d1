"""A log stays small whatever happens."""

import logging

import pytest

from gcs.text.sparing_log import SparingFilter


def test_a_flood_of_lines_is_cut_and_said(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    log = logging.getLogger("flood")
    log.setLevel(logging.INFO)
    sparing = SparingFilter(lambda: now[0])
    caplog.handler.addFilter(sparing)
    try:
        for number in range(1000):
            log.info("line %d", number)
        assert len(caplog.records) == 300
        now[0] = 61.0
        log.info("x" * 10_000)
    finally:
        caplog.handler.removeFilter(sparing)
    assert caplog.messages[-1].startswith("(700 lines were left out before this one) xxx")
    assert len(caplog.messages[-1]) < 2100

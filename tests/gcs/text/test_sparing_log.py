"""A log stays small whatever happens."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from gcs.text.sparing_log import SparingFilter


@contextmanager
def sparing(caplog: pytest.LogCaptureFixture, clock: Callable[[], float], **options: bool) -> Iterator[logging.Logger]:
    """A logger whose lines the filter has let through are those of `caplog`."""
    log, one = logging.getLogger("flood"), SparingFilter(clock, **options)
    log.setLevel(logging.INFO)
    caplog.handler.addFilter(one)
    try:
        yield log
    finally:
        caplog.handler.removeFilter(one)


def test_a_flood_of_lines_is_cut_and_said(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    with sparing(caplog, lambda: now[0]) as log:
        for number in range(1000):
            log.info("line %d", number)
        assert len(caplog.records) == 300
        now[0] = 61.0
        log.info("x" * 10_000)
    assert caplog.messages[-1].startswith("(700 lines were left out before this one) xxx")
    assert len(caplog.messages[-1]) < 2100


def test_equal_lines_are_written_once_a_minute_with_their_number(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    with sparing(caplog, lambda: now[0]) as log:
        for _ in range(1000):
            log.info("the line is %s", "down")
        log.warning("the line is down")  # of another weight
        log.info("the line is %s", "up")
        assert caplog.messages == ["the line is down", "the line is down", "the line is up"]
        now[0] = 61.0
        log.info("the line is down")
        assert caplog.messages[-1] == "(999 equal lines were left out before this one) the line is down"
        log.info("the line is down")
        assert len(caplog.messages) == 4


def test_equal_lines_that_never_come_again_are_counted_all_the_same(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    with sparing(caplog, lambda: now[0]) as log:
        for _ in range(5):
            log.info("once")
        now[0] = 100.0
        log.info("another")
    assert caplog.messages == ["once", "(4 lines were left out before this one) another"]


def test_an_error_with_another_cause_is_another_line(caplog: pytest.LogCaptureFixture) -> None:
    with sparing(caplog, lambda: 0.0) as log:
        for cause in ("first", "second", "second"):
            log.error("failed", exc_info=ValueError(cause))
    assert [str(record.exc_info[1]) for record in caplog.records if record.exc_info] == ["first", "second"]


def test_lines_of_an_access_log_count_each_by_itself(caplog: pytest.LogCaptureFixture) -> None:
    with sparing(caplog, lambda: 0.0, equal_once=False) as log:
        for _ in range(400):
            log.info("GET /api/health 200")
    assert len(caplog.messages) == 300

"""The log as JSON: one object a line, whatever is said."""

import io
import json
import logging
import re
from collections.abc import Iterator
from typing import Any

import pytest

from gcs.text.json_log import ACCESS_LOG, REQUEST_ID, JsonFormatter, log_as_json


@pytest.fixture
def written() -> Iterator[io.StringIO]:
    """What a logger with that format has written."""
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(JsonFormatter())
    log = logging.getLogger("json-test")
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    yield stream
    log.removeHandler(handler)


def lines(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_a_line_is_an_object_with_time_level_logger_and_message(written: io.StringIO) -> None:
    logging.getLogger("json-test").warning('a "quoted"\nline of %s', "Böen")
    (line,) = lines(written)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", line.pop("time"))
    assert line == {"level": "WARNING", "logger": "json-test", "message": 'a "quoted"\nline of Böen'}


def test_a_line_bears_the_request_that_caused_it_and_the_error_it_is_about(written: io.StringIO) -> None:
    token = REQUEST_ID.set("abc")
    try:
        raise ValueError("no such thing")
    except ValueError:
        logging.getLogger("json-test").exception("failed")
    finally:
        REQUEST_ID.reset(token)
    logging.getLogger("json-test").info("well again")
    first, second = lines(written)
    assert first["request_id"] == "abc"
    assert "ValueError: no such thing" in first["exception"]
    assert not {"request_id", "exception"} & set(second)


def test_the_access_log_has_a_handler_of_its_own() -> None:
    root, access = logging.getLogger(), logging.getLogger(ACCESS_LOG)
    before = [(one, list(one.handlers), one.level, one.propagate) for one in (root, access)]
    try:
        log_as_json()
        assert root.handlers[0] is not access.handlers[0]
        assert not access.propagate
        assert all(isinstance(one.handlers[0].formatter, JsonFormatter) for one in (root, access))
    finally:
        for one, handlers, level, propagate in before:
            one.handlers, one.propagate = handlers, propagate
            one.setLevel(level)

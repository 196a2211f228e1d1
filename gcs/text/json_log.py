"""The log as JSON, one object a line, for programs that collect logs; and the id of the request a line belongs to."""

from __future__ import annotations

import logging
from contextvars import ContextVar

from gcs.text.jsontext import dumps
from gcs.text.utctext import utc_text

# Of the request that is being answered; empty elsewhere. Threads that answer one see it too.
REQUEST_ID: ContextVar[str] = ContextVar("request_id", default="")
# Attributes of a record that become keys of the object: those of the access log.
_ACCESS = ("method", "path", "status", "ms")
_LONGEST_TRACE = 8000
ACCESS_LOG = "gcs.access"


class JsonFormatter(logging.Formatter):
    """A record as one line: time (UTC), level, logger, message, and where there are any request_id and exception."""

    def format(self, record: logging.LogRecord) -> str:
        """The line, without its end."""
        line: dict[str, object] = {
            "time": utc_text(int(1e9 * record.created)),
            "level": record.levelname,
            "logger": record.name,
            "message": record.getMessage(),
        }
        if request := REQUEST_ID.get():
            line["request_id"] = request
        line |= {name: getattr(record, name) for name in _ACCESS if hasattr(record, name)}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)[-_LONGEST_TRACE:]
        return dumps(line)


def log_as_json(handler: logging.Handler | None = None) -> None:
    """Have the root logger write JSON to standard error, or to `handler`, and requests be logged as they are answered.

    The access log has a handler of its own: busy clients shall not use up what the other lines may take.
    """
    for name in ("", ACCESS_LOG):
        logger = logging.getLogger(name)
        made = logging.StreamHandler() if handler is None else handler
        made.setFormatter(JsonFormatter())
        logger.handlers = [made]
        logger.setLevel(logging.INFO)
    logging.getLogger(ACCESS_LOG).propagate = False

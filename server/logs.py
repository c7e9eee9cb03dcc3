"""What the server says, one line each, as text or as JSON; nothing of it can move a terminal's cursor."""

from __future__ import annotations

import logging
import time
from contextvars import ContextVar
from typing import Any

import orjson

from runtime.errors import plain

request_id: ContextVar[str] = ContextVar("request_id", default="")
"""Name of the request that is being answered; in its log lines, its problem and its answer's header."""

LIBRARIES = ("uvicorn.error", "uvicorn.access", "websockets.server")
"""Loggers whose lines are about single connections: anybody could fill a disk with them."""


class TextLines(logging.Formatter):
    """A line of text; what is no printable character is escaped, so that a traceback is a line too."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record's line."""
        request = request_id.get()
        text = super().format(record) + (f" [request {request}]" if request else "")
        return f"slide-serve: {plain(text)}"


class JsonLines(logging.Formatter):
    """A JSON object a line: time (s since 1970), level, message, and the request's name and the error where there is
    one."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record's line."""
        document: dict[str, Any] = {"time": record.created, "level": record.levelname, "message": record.getMessage()}
        if request := request_id.get():
            document["request"] = request
        document |= getattr(record, "fields", {})
        if record.exc_info:
            document["error"] = self.formatException(record.exc_info)
        return orjson.dumps(document, default=str).decode()


def set_up(form: str) -> None:
    """Let all that is logged go to standard error, as "text" or "json"."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines() if form == "json" else TextLines("%(message)s"))
    logging.basicConfig(handlers=[handler], level=logging.INFO)
    for name in LIBRARIES:
        logging.getLogger(name).setLevel(logging.CRITICAL)


class Seldom:
    """Lets a message through once in a while, and counts the others.

    Args:
        seconds: from one that is let through to the next.
    """

    def __init__(self, seconds: float = 10.0) -> None:
        self._seconds, self._next, self._held = seconds, 0.0, 0

    def error(self, log: logging.Logger, message: str) -> None:
        """Log a message, unless one was logged a short while ago."""
        now = time.monotonic()
        if now < self._next:
            self._held += 1
            return
        more = f" ({self._held} times more since the last line)" if self._held else ""
        log.error("%s%s", message, more)
        self._next, self._held = now + self._seconds, 0

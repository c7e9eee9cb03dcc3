"""One HTTP connection, with the bounds that uvicorn leaves open: a header has a size and a time to arrive in."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

import orjson
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from server.problems import MEDIA_TYPE, Problem
from server.settings import Settings

MAX_HEADER = 1 << 15
"""Largest request line and header together (bytes)."""

LINGER = 2.0
"""How long what is left of a body is read and thrown away after the answer (s): a client that is still sending would
not see the answer if the connection were closed before it."""

MAX_CONNECTIONS = 1000
"""Most connections; more than a process may commonly open files is no use."""

HEADER_TOO_LARGE = Problem("header-too-large", f"at most {MAX_HEADER} bytes are read")


class GuardedProtocol(HttpToolsProtocol):
    """One connection; what asyncio and the parser call is named by them.

    Args:
        settings: how long a header may take to arrive, from the first byte or from the connection, and a client to make
            room for more of an answer: while it waits to be sent, it holds a place.
        given: what uvicorn gives to each connection.
    """

    _timer: asyncio.TimerHandle | None = None
    _writing: asyncio.TimerHandle | None = None
    _head = 0
    _in_head = True
    _in_body = False

    def __init__(self, *, settings: Settings, **given: Any) -> None:
        super().__init__(**given)
        self._settings = settings

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Refuse a connection too many, and give the first header its time."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            self._answer(Problem("overloaded", headers={"Retry-After": "1"}))
        else:
            self._close_after(self._settings.header_timeout)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the timers."""
        self._no_timer()
        self.resume_writing()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """Give the client its time to read."""
        super().pause_writing()
        self._writing = self.loop.call_later(self._settings.write_timeout, self.transport.abort)

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        if self._writing is not None:
            self._writing.cancel()
            self._writing = None

    def data_received(self, data: bytes) -> None:
        """Count a header's bytes while it arrives: the parser would take any number of them."""
        super().data_received(data)
        if self._in_head and not self.transport.is_closing():
            self._head += len(data)
            if self._head > MAX_HEADER:
                self._answer(HEADER_TOO_LARGE)

    def on_message_begin(self) -> None:
        """Give a header its time."""
        super().on_message_begin()
        self._in_head, self._head = True, 0
        self._close_after(self._settings.header_timeout)

    def on_headers_complete(self) -> None:
        """The header is there; `server.http.body` keeps the time of what follows."""
        self._no_timer()
        self._in_head, self._in_body = False, True
        if len(self.url) + sum(len(name) + len(value) for name, value in self.headers) > MAX_HEADER:
            self._answer(HEADER_TOO_LARGE)
        else:
            super().on_headers_complete()

    def on_message_complete(self) -> None:
        """The body is there: nothing is left to be thrown away."""
        self._no_timer()
        self._in_body = False
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Read the rest of a body that was answered before its end, for a while."""
        super().on_response_complete()
        if self._in_body and not self.pipeline:
            self._close_after(LINGER)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP."""
        self._answer(Problem("malformed", "the request is not HTTP"))

    def _answer(self, problem: Problem) -> None:
        """Answer without the application, and close; once, though the parser may find more to complain about."""
        if self.transport.is_closing():
            return
        body = orjson.dumps(problem.to_dict())
        headers = {"Content-Type": MEDIA_TYPE, "Content-Length": str(len(body)), "Connection": "close"}
        lines = [f"HTTP/1.1 {problem.status} {HTTPStatus(problem.status).phrase}"]
        lines += [f"{name}: {value}" for name, value in {**headers, **problem.headers}.items()]
        self.transport.write("\r\n".join([*lines, "", ""]).encode("ascii") + body)
        self.transport.close()

    def _close_after(self, seconds: float) -> None:
        self._no_timer()
        self._timer = self.loop.call_later(seconds, self.timeout_keep_alive_handler)

    def _no_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

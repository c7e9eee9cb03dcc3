"""One HTTP connection, with the bounds that uvicorn leaves open: bytes are counted, and each state has its time."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

import orjson
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from server.http.connections import LINGER, Deadlines, make_room
from server.problems import MEDIA_TYPE, Problem
from server.settings import Settings

MAX_HEADER = 1 << 15
"""Largest request line and header together, and largest trailer (bytes)."""

MAX_HEADERS, MAX_HEADER_LINE = 100, 8000
"""Most headers of a request that opens a websocket, and the longest (bytes): its parser takes no more."""

FRAMING = 8
"""Bytes on the wire for each byte of a body sent in chunks, at most: chunks of a byte take six."""

PIECE = 1 << 13
"""Bytes given to the parser at a time, so that what they open can be counted between."""

MAX_PIPELINE = 16
"""Most requests that may wait behind the one that is being answered."""

HEADER_TOO_LARGE = Problem("header-too-large", f"at most {MAX_HEADER} bytes are read")


class GuardedProtocol(HttpToolsProtocol):
    """One connection; what asyncio and the parser call is named by them.

    Args:
        settings: how long a header may take to arrive, from the first byte or from the connection, and a client to make
            room for more of an answer: while it waits to be sent, it holds a place.
        most: connections that may be open at once.
        given: what uvicorn gives to each connection.
    """

    _received = 0
    _in_head = True
    _in_body = False
    _deaf = False

    def __init__(self, *, settings: Settings, most: int, **given: Any) -> None:
        super().__init__(**given)
        self.deadlines = Deadlines()
        self._settings, self._most = settings, most

    @property
    def waits(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or bool(self.cycle.response_complete)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room for a connection too many, and give the first header its time."""
        full = len(self.connections) >= self._most
        room = not full or make_room(self.connections)  # type: ignore[arg-type]
        super().connection_made(transport)
        if room:
            self._close_after(self._settings.header_timeout)
        else:
            self._answer(Problem("overloaded", "too many connections are open", headers={"Retry-After": "1"}))

    def pause_writing(self) -> None:
        """Give the client its time to read."""
        super().pause_writing()
        self.deadlines.write_until = self.loop.time() + self._settings.write_timeout

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        self.deadlines.write_until = None

    def data_received(self, data: bytes) -> None:
        """Count the bytes of each part of a request: the parser would take any number of them."""
        for begin in range(0, len(data), PIECE):
            if self.transport.is_closing() or self._deaf:
                return
            piece = data[begin : begin + PIECE]
            self._received += len(piece)
            super().data_received(piece)
            if self._in_head and self._received > MAX_HEADER:
                self._answer(HEADER_TOO_LARGE)
            elif self._in_body and self._received > FRAMING * self._settings.max_body + MAX_HEADER:
                self._answer(Problem("too-large", "the body's chunks and trailers are too many bytes"))
            elif len(self.pipeline) > MAX_PIPELINE:
                self.transport.abort()

    def on_message_begin(self) -> None:
        """Give a header its time."""
        super().on_message_begin()
        self._in_head, self._received = True, 0
        self._close_after(self._settings.header_timeout)

    def on_headers_complete(self) -> None:
        """The header is there; `server.http.body` keeps the time of what follows, the websocket that of its own."""
        self._in_head, self._in_body, self._received = False, True, 0
        if len(self.url) + sum(len(name) + len(value) for name, value in self.headers) > MAX_HEADER:
            self._answer(HEADER_TOO_LARGE)
            return
        if not self._is_for_its_host():
            self._answer(Problem("malformed", "the address and the header Host name two servers"))
            return
        if self.parser.should_upgrade() and self._should_upgrade():
            unfit = self._unfit_for_upgrade()
            if unfit:
                self._answer(Problem("malformed", f"a request that opens a websocket {unfit}"))
                return
        else:
            self.deadlines.until = None
        super().on_headers_complete()

    def _is_for_its_host(self) -> bool:
        """Whether an address that names a server names the one of the header Host, as RFC 9112, 3.2.2 wants."""
        if self.url.startswith(b"/") or b"://" not in self.url:
            return True
        named = self.url.partition(b"://")[2].partition(b"/")[0].partition(b"?")[0]
        return all(value.lower() == named.lower() for name, value in self.headers if name == b"host")

    def _unfit_for_upgrade(self) -> str:
        """Return what of this request the websocket's own parser would not take, or nothing."""
        if self.parser.get_method() != b"GET" or self.parser.get_http_version() != "1.1":
            return "is a GET of HTTP/1.1"
        names = dict(self.headers)
        if names.get(b"content-length", b"0") != b"0" or b"transfer-encoding" in names:
            return "has no body"
        if len(self.headers) > MAX_HEADERS:
            return f"has at most {MAX_HEADERS} headers"
        longest = max(len(self.url), *(len(name) + len(value) for name, value in self.headers))
        return f"has headers of at most {MAX_HEADER_LINE} bytes" if longest > MAX_HEADER_LINE else ""

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over, unless it was refused."""
        if not self.transport.is_closing():
            super().handle_websocket_upgrade()

    def _unsupported_upgrade_warning(self) -> None:
        """Answer a request for another protocol as one of HTTP, and as the last: the parser reads no more."""
        self._deaf = True
        self.cycle.keep_alive = False

    def on_message_complete(self) -> None:
        """The body is there: nothing is left to be thrown away."""
        self._in_body = False
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Wait for the next request; read the rest of a body that was answered before its end, for a while."""
        super().on_response_complete()
        self.deadlines.begun = self.loop.time()
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
        self.deadlines.begun = self.loop.time()
        self.deadlines.until = self.deadlines.begun + seconds

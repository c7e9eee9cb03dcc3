"""One websocket's connection, with the bounds that uvicorn leaves open: frames are counted, and written ones read."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from server.http.connections import LINGER, Deadlines
from server.settings import Settings

POLICY_VIOLATION = 1008
"""Close code after a problem (RFC 6455, section 7.4.1)."""

PIECE = 1 << 12
"""Bytes of frames parsed at a time (some hundred of the smallest), before others have their turn."""

MAX_FRAGMENTS = 256
"""Most frames of one message."""

MAX_PINGS = 64
"""Most pings between two messages."""

REFUSAL = b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class GuardedWebSocket(WebSocketsSansIOProtocol):
    """One connection; what asyncio and uvicorn call is named by them.

    Args:
        settings: how long the handshake may take, and a client to read what is sent.
        given: what uvicorn gives to each connection.
    """

    def __init__(self, *, settings: Settings, **given: Any) -> None:
        super().__init__(**given)
        self.deadlines = Deadlines()
        self.close_timeout = LINGER
        self._settings = settings
        self._unread = b""
        self._planned: asyncio.Handle | None = None
        self._pings = 0

    @property
    def waits(self) -> bool:
        """Whether it is still being opened."""
        return not self.handshake_complete

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Give the handshake its time."""
        super().connection_made(transport)
        self.deadlines.begun = self.loop.time()
        self.deadlines.until = self.deadlines.begun + self._settings.header_timeout

    def start_keepalive(self) -> None:
        """The stream is open, and keeps the time itself."""
        self.deadlines.until = None
        super().start_keepalive()

    def pause_writing(self) -> None:
        """Give the client its time to read, and take nothing more from it: a ping is answered too."""
        super().pause_writing()
        self.deadlines.write_until = self.loop.time() + self._settings.write_timeout
        self.transport.pause_reading()

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        self.deadlines.write_until = None
        self._go_on()

    def data_received(self, data: bytes) -> None:
        """Parse a piece at a time, and none while the stream has a message to answer or the client reads nothing."""
        if not self.handshake_initiated:
            super().data_received(data)
            if not self.handshake_initiated:  # the request is whole, and this parser does not take it
                self._refuse()
            return
        self._unread += data
        if self._planned is None:
            self._parse()

    def _parse(self) -> None:
        self._planned = None
        if self.transport.is_closing():
            self._unread = b""
            return
        if self._unread and not self._held:
            piece, self._unread = self._unread[:PIECE], self._unread[PIECE:]
            super().data_received(piece)
        self._go_on()

    @property
    def _held(self) -> bool:
        return self.read_paused or not self.writable.is_set()

    def _go_on(self) -> None:
        """Read on: what has been received first."""
        if self.transport.is_closing() or self._held:
            return
        if not self._unread:
            self.transport.resume_reading()
            return
        self.transport.pause_reading()
        if self._planned is None:
            self._planned = self.loop.call_soon(self._parse)

    async def receive(self) -> Any:
        """Return what comes next, and read on."""
        message = await super().receive()
        self._go_on()
        return message

    def handle_text(self, event: Frame) -> None:
        """A message begins."""
        self._pings = 0
        super().handle_text(event)

    def handle_bytes(self, event: Frame) -> None:
        """A message begins."""
        self._pings = 0
        super().handle_bytes(event)

    def handle_cont(self, event: Frame) -> None:
        """Count the frames of a message."""
        if len(self.frames) >= MAX_FRAGMENTS:
            self._fail(f"a message has at most {MAX_FRAGMENTS} frames")
        else:
            super().handle_cont(event)

    def handle_ping(self) -> None:
        """Count pings."""
        self._pings += 1
        if self._pings > MAX_PINGS:
            self._fail(f"at most {MAX_PINGS} pings come between two messages")
        else:
            super().handle_ping()

    def _fail(self, reason: str) -> None:
        if not self.close_sent:
            self.conn.fail(POLICY_VIOLATION, reason)
            self.handle_parser_exception()

    def handle_parser_exception(self) -> None:
        """Close, with the reason that the parser gave; before the handshake it gives none."""
        if self.conn.close_sent is None:
            self._refuse()
        else:
            super().handle_parser_exception()

    def _refuse(self) -> None:
        self.handshake_complete = self.close_sent = True
        self.transport.write(REFUSAL)
        self.transport.close()

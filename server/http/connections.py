"""Connections: each has a deadline whatever it is doing, and those that only wait make room for others.

uvicorn keeps the set of them, and looks at it ten times a second by `Server.on_tick`.
"""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Iterable
from typing import Protocol

LINGER = 2.0
"""How long a connection that is being closed may take to be gone (s): what its client does not read is then dropped."""

SPARE_DESCRIPTORS = 64
"""Descriptors that connections leave for everything else: files, and the processes beside the server."""


class Deadlines:
    """The deadlines of one connection, all in seconds of the event loop's clock.

    Attributes:
        until: when it is closed, unless something happens; None while a request keeps the time.
        write_until: when it is given up because its client reads nothing; None while it reads.
        begun: when it began to wait for what it waits for.
    """

    def __init__(self) -> None:
        self.until: float | None = None
        self.write_until: float | None = None
        self.begun = 0.0
        self._closing_until: float | None = None

    def keep(self, transport: asyncio.Transport, now: float) -> None:
        """Close or give up the connection if its time is over."""
        if transport.is_closing():
            if self._closing_until is None:
                self._closing_until = now + LINGER
            elif now > self._closing_until:
                transport.abort()
        elif self.write_until is not None and now > self.write_until:
            transport.abort()
        elif self.until is not None and now > self.until:
            transport.close()


class Guarded(Protocol):
    """A connection as this module sees it."""

    transport: asyncio.Transport
    deadlines: Deadlines

    @property
    def waits(self) -> bool:
        """Whether nothing is being done for it: no request has come yet, or all have been answered."""


def keep_deadlines(connections: Iterable[Guarded], now: float) -> None:
    """Close what is over."""
    for connection in list(connections):
        connection.deadlines.keep(connection.transport, now)


def make_room(connections: Iterable[Guarded]) -> bool:
    """Give up the connection that has waited longest, so that another can be taken; return whether there was one."""
    waiting = [one for one in connections if one.waits]
    if not waiting:
        return False
    min(waiting, key=lambda one: one.deadlines.begun).transport.abort()
    return True


def give_up(connections: Iterable[Guarded]) -> None:
    """Give up all that are left."""
    for connection in list(connections):
        connection.transport.abort()


def most_connections(wanted: int) -> int:
    """Return how many connections can be open at once, up to those wanted; asks the system for as many as it gives."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = wanted + SPARE_DESCRIPTORS
    if soft != resource.RLIM_INFINITY and soft < needed:
        soft = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return wanted if soft == resource.RLIM_INFINITY else max(1, min(wanted, soft - SPARE_DESCRIPTORS))

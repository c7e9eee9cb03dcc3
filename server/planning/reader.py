"""What clients send, read by a process beside the server; see `server.planning.reading`."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from runtime import InputError
from runtime.network.manifest import Manifest
from server.planning.messages import FILE, ReaderOptions, ReadReply, ReadRequest
from server.planning.process import READING_COMMAND, Child, keep
from server.problems import Problem, for_input
from server.settings import Settings
from server.shares import AGAIN, Turns

READ_AT_ONCE = 1 << 21
"""Bytes of bodies that are read side by side: what is made of them meanwhile is some ten times as large."""


@dataclass(eq=False)
class _Waiting:
    """A body that waits to be read, or is being read."""

    client: str
    request: ReadRequest
    result: asyncio.Future[Any]


class Reader:
    """Gives bodies to the reading process, and what it reads back.

    Args:
        manifest: of the bundle.
        settings: what a client may ask for.
        command: how the process is run.

    Attributes:
        process: the number of the reading process; None while there is none that is ready.
    """

    def __init__(self, manifest: Manifest, settings: Settings, command: Sequence[str] = READING_COMMAND) -> None:
        self.process: int | None = None
        bounds = {name: getattr(settings, name) for name in ReaderOptions._fields[1:]}
        self._options = ReaderOptions(manifest, **bounds)
        self._deadline, self._command = settings.deadline, command
        self._longest = settings.hang_deadlines * settings.deadline
        self._numbers = count()
        self._waiting: deque[_Waiting] = deque()
        self._read: dict[int, _Waiting] = {}
        self._turns = Turns(settings.shares_of_time)
        self._child: Child | None = None
        self._moved = asyncio.Event()

    async def run(self) -> None:
        """Keep a process that reads, until cancelled."""
        await keep("reading", self._options, self._command, self._use, self._lost)

    async def read(self, client: str, kind: str, body: bytes, **options: Any) -> Any:
        """Return what a body asks for.

        Raises:
            Problem: what is wrong with it; `not-ready` if the process ended, `deadline` if it took too long.
        """
        request = ReadRequest(next(self._numbers), client, kind, body, options)
        one = _Waiting(client, request, asyncio.get_running_loop().create_future())
        self._waiting.append(one)
        self._send()
        try:
            async with asyncio.timeout(self._deadline):
                result = await one.result
        except TimeoutError:
            raise Problem("deadline", f"the request was not read within {self._deadline:g} s") from None
        finally:
            if one in self._waiting:
                self._waiting.remove(one)
        if isinstance(result, InputError):
            raise for_input(result)
        if isinstance(result, Problem):
            raise result
        return result

    def _send(self) -> None:
        """Give the process as much as it may have at once, by turns of the clients."""
        while self._child is not None and (one := self._next()) is not None:
            self._waiting.remove(one)
            self._turns.charge(one.client, len(one.request.body))
            self._read[one.request.number] = one
            self._child.send(one.request)
            self._moved.set()

    def _next(self) -> _Waiting | None:
        """Return what the process may have next, if anything: one file, and beside it some other bodies."""
        busy = any(each.request.kind == FILE for each in self._read.values())
        waiting = [one for one in self._waiting if not (busy and one.request.kind == FILE)]
        if not waiting:
            return None
        first = self._turns.order({one.client for one in waiting})[0]
        one = next(each for each in waiting if each.client == first)
        read = [len(each.request.body) for each in self._read.values() if each.request.kind != FILE]
        room = one.request.kind == FILE or not read or sum(read) + len(one.request.body) <= READ_AT_ONCE
        return one if room else None

    async def _use(self, child: Child) -> None:
        """Take what the process has read.

        Raises:
            EOFError: it has ended.
            TimeoutError: it is at something for too long.
        """
        self._child, self.process = child, child.number
        self._send()
        while True:
            if not self._read:
                self._moved.clear()
                await self._moved.wait()
            async with asyncio.timeout(self._longest):
                reply: ReadReply
                reply, _ = await child.receive()
            _give(self._read.pop(reply.number), reply.result)
            self._send()

    def _lost(self) -> None:
        self._child = self.process = None
        for one in self._read.values():
            _give(one, Problem("not-ready", "the reading process ended", headers=AGAIN))
        self._read.clear()


def _give(one: _Waiting, result: Any) -> None:
    if not one.result.done():
        one.result.set_result(result)

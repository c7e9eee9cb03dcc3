"""The planning process, as the server sees it: started, watched, replaced."""

from __future__ import annotations

import asyncio
import pickle
import socket
import subprocess
import sys
import time
from typing import Any

from runtime import BundleError
from server.planning.messages import BUFFER, LENGTHS, Order, packed

COMMAND = [sys.executable, "-P", "-c", "from server.planning.worker import main; main()"]
"""How the planning process is run."""

ENDING = 0.5
"""Longest time until the process has ended by itself, once the server is done with it (s)."""


class Process:
    """The server's side of a planning process."""

    def __init__(self, process: subprocess.Popen[bytes], reader: asyncio.StreamReader, writer: asyncio.StreamWriter):
        self._process, self._reader, self._writer = process, reader, writer

    @classmethod
    async def start(cls, order: Order) -> Process:
        """Start a planning process and wait until it is ready.

        Raises:
            BundleError: it is not ready to plan; what it says is passed on.
        """
        ours, its = socket.socketpair()
        for end in (ours, its):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        with its:
            number = its.fileno()
            process = subprocess.Popen([*COMMAND, str(number)], stdin=subprocess.DEVNULL, pass_fds=(number,))
        it = cls(process, *await asyncio.open_connection(sock=ours, limit=BUFFER))
        try:
            it.send(order)
            wrong, _ = await it.receive()
            if wrong:
                raise BundleError(wrong)
        except EOFError:
            raise BundleError(f"the planning process ended before it was ready, with {await it.end()}") from None
        except BaseException:
            it.kill()
            raise
        return it

    @property
    def number(self) -> int:
        """Number of the process."""
        return self._process.pid

    def check(self) -> None:
        """Check that the process is there.

        Raises:
            EOFError: it has ended.
        """
        if self._process.poll() is not None:
            raise EOFError

    def send(self, message: object) -> None:
        """Send a message; it goes as the process reads."""
        self._writer.write(packed(message))

    async def receive(self) -> tuple[Any, bytes]:
        """Return the next message and what follows it.

        Raises:
            EOFError: the process has ended.
        """
        try:
            length, follows = LENGTHS.unpack(await self._reader.readexactly(LENGTHS.size))
            return pickle.loads(await self._reader.readexactly(length)), await self._reader.readexactly(follows)
        except (asyncio.IncompleteReadError, ConnectionError):
            raise EOFError from None

    async def end(self) -> int:
        """Let the process end, or end it, and return its exit code."""
        self._writer.close()
        until = time.monotonic() + ENDING
        while self._process.poll() is None and time.monotonic() < until:
            await asyncio.sleep(0.01)
        self.kill()
        return self._process.wait()

    def kill(self) -> None:
        """End the process at once."""
        self._writer.close()
        self._process.kill()
        self._process.wait()

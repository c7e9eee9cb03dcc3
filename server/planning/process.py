"""The planning process, as the server sees it: started, talked to, watched, stopped.

asyncio starts it and says when it has ended. No pool of processes does more for one process that may hang; see
`docs/decisions/015-no-process-pool.md`.
"""

from __future__ import annotations

import asyncio
import pickle
import socket
import sys
from asyncio.subprocess import DEVNULL
from collections.abc import Coroutine, Sequence
from typing import Any

from runtime import BundleError
from server.planning.messages import BUFFER, LENGTHS, PlannerOptions, frame

PLANNING_COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); from server.planning.worker import main; main()",
)
"""How the planning process is run: -P, so that no file of the folder it is run from is imported by its name; deaf to a
terminal's Ctrl-C, which is for the server, from its first instruction."""

GRACE = 0.5
"""Longest time until the process has ended by itself, once the server is done with it (s)."""


class PlanningProcess:
    """The server's side of a planning process."""

    def __init__(
        self, process: asyncio.subprocess.Process, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._process, self._reader, self._writer = process, reader, writer
        self._exit = asyncio.ensure_future(process.wait())

    @classmethod
    async def start(cls, options: PlannerOptions, command: Sequence[str] = PLANNING_COMMAND) -> PlanningProcess:
        """Start a planning process and wait until it is ready.

        Args:
            options: what it plans with.
            command: the program; its last argument is the number of its end of a socket.

        Raises:
            BundleError: it is not ready to plan; what it says is passed on.
        """
        ours, its = socket.socketpair()
        for end in (ours, its):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        with its:
            number = its.fileno()
            process = await asyncio.create_subprocess_exec(*command, str(number), stdin=DEVNULL, pass_fds=(number,))
        it = cls(process, *await asyncio.open_connection(sock=ours, limit=BUFFER))
        try:
            it.send(options)
            error, _ = await it.receive()
            if error:
                raise BundleError(error)
        except EOFError:
            raise BundleError(f"the planning process ended before it was ready, with {await it.stop()}") from None
        except BaseException:
            await it.stop(0.0)
            raise
        return it

    @property
    def number(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send(self, message: object) -> None:
        """Send a message; it goes as the process reads."""
        self._writer.write(frame(message))

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

    async def work(self, work: Coroutine[Any, Any, None]) -> None:
        """Do work that needs the process, until it is done or the process ends, which cancels it.

        Raises:
            EOFError: the process has ended.
        """
        task = asyncio.ensure_future(work)
        try:
            await asyncio.wait({task, self._exit}, return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                raise EOFError
            await task
        finally:
            task.cancel()

    async def stop(self, grace: float = GRACE) -> int:
        """Let the process end within this time (s), or kill it, and return its exit code."""
        self._writer.close()
        done, _ = await asyncio.wait({self._exit}, timeout=grace)
        if not done:
            self._process.kill()
        return await self._exit

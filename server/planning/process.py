"""A process beside the server, as the server sees it: started, talked to, watched, stopped, and replaced.

asyncio starts it and says when it has ended. No pool of processes does more for one process that may hang; see
`docs/decisions/015-no-process-pool.md`.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import socket
import sys
from asyncio.subprocess import DEVNULL
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from runtime import BundleError
from server.logs import Seldom
from server.planning.messages import BUFFER, LENGTHS, PIECE, frame

log = logging.getLogger("slide-serve")


def command_of(module: str) -> tuple[str, ...]:
    """Return how a module's `main` is run as a process: -P, so that no file of the folder it is run from is imported by
    its name; deaf to a terminal's Ctrl-C, which is for the server, from its first instruction."""
    deaf = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
    return sys.executable, "-P", "-c", f"{deaf}; from {module} import main; main()"


PLANNING_COMMAND = command_of("server.planning.worker")
READING_COMMAND = command_of("server.planning.reading")

GRACE = 0.5
"""Longest time until the process has ended by itself, once the server is done with it (s)."""

START_TIMEOUT = 60.0
"""Longest time until a process is ready (s); compiling takes ten of them on a busy machine."""

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 2.0
"""Pause before a process that did not become ready is started again (s): the first, and the longest."""


class Child:
    """The server's side of a process beside it."""

    def __init__(
        self, process: asyncio.subprocess.Process, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._process, self._reader, self._writer = process, reader, writer
        self._exit = asyncio.ensure_future(process.wait())

    @classmethod
    async def start(cls, options: object, command: Sequence[str]) -> Child:
        """Start a process and wait until it is ready.

        Args:
            options: its first message.
            command: the program; its last argument is the number of its end of a socket.

        Raises:
            BundleError: it says that it cannot do its work; what it says is passed on.
            EOFError: it has ended before it was ready.
            OSError: the system has no room for it.
        """
        ours, its = socket.socketpair()
        try:
            for end in (ours, its):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            number = its.fileno()
            process = await asyncio.create_subprocess_exec(*command, str(number), stdin=DEVNULL, pass_fds=(number,))
        except BaseException:
            ours.close()
            raise
        finally:
            its.close()
        it = cls(process, *await asyncio.open_connection(sock=ours, limit=BUFFER))
        try:
            it.send(options)
            error, _ = await it.receive()
            if error:
                raise BundleError(error)
        except EOFError:
            raise EOFError(str(await it.stop())) from None
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

    async def receive(self) -> tuple[Any, list[bytes]]:
        """Return the next message and what follows it, in pieces.

        Raises:
            EOFError: the process has ended.
        """
        try:
            length, follows = LENGTHS.unpack(await self._reader.readexactly(LENGTHS.size))
            message = pickle.loads(await self._reader.readexactly(length))
            pieces = []
            while follows:
                pieces.append(await self._reader.readexactly(min(PIECE, follows)))
                follows -= len(pieces[-1])
            return message, pieces
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


async def keep(
    name: str,
    options: object,
    command: Sequence[str],
    use: Callable[[Child], Coroutine[Any, Any, None]],
    lost: Callable[[], None],
) -> None:
    """Have a process do its work, one after another, until cancelled.

    A process that ends, or is not ready in time, or for which the system has no room, is replaced; pauses grow while
    none becomes ready.

    Args:
        name: of the process, for the log.
        options: its first message.
        command: how it is run.
        use: what is done with it while it is there; a TimeoutError says that it hangs.
        lost: called when it is there no more.

    Raises:
        BundleError: it says that it cannot do its work.
    """
    pause, seldom = 0.0, Seldom()
    while True:
        try:
            async with asyncio.timeout(START_TIMEOUT):
                child = await Child.start(options, command)
        except (EOFError, OSError) as error:
            seldom.error(log, f"the {name} process {_why(error)} before it was ready: another one is started")
            pause = min(LONGEST_PAUSE, 2.0 * pause or FIRST_PAUSE)
            await asyncio.sleep(pause)
            continue
        hung, pause = False, 0.0
        try:
            await child.work(use(child))
        except EOFError:
            pass
        except TimeoutError:
            hung = True
        finally:
            lost()
            code = await (child.stop(0.0) if hung else child.stop())
        log.error("the %s process %s (%d): a new one is started", name, "hung" if hung else "has ended", code)


async def once(name: str, options: object, command: Sequence[str]) -> None:
    """Start a process, and let it end as soon as it is ready; if it never is, a line says why.

    Args:
        name: of the process, for the log.
        options: its first message.
        command: how it is run.

    Raises:
        BundleError: it says that it cannot do its work.
    """
    try:
        async with asyncio.timeout(START_TIMEOUT):
            child = await Child.start(options, command)
    except (EOFError, OSError) as error:
        log.error("the %s process %s before it was ready", name, _why(error))
    else:
        await child.stop()


def _why(error: Exception) -> str:
    """Return what became of a process that did not become ready."""
    if isinstance(error, EOFError):
        return f"has ended ({error})"
    return "hangs" if isinstance(error, TimeoutError) else f"cannot be started: {error}"

"""Load on a server from a process of its own: connections kept open, requests made beforehand, answers timed."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from runtime.documents.checks import FloatArray


class Answer(NamedTuple):
    """A status, the header in lower case, the body, and the time it took (s)."""

    status: int
    header: bytes
    body: bytes
    duration: float


class Connection:
    """One HTTP connection to this machine's `port`, opened when it is first used and again after it was closed.

    Args:
        port: of the server.
        address: of this machine, that it is opened from: a client of its own to the server.
    """

    def __init__(self, port: int, address: str = "127.0.0.1") -> None:
        self._port, self._address = port, address
        self._ends: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def ask(self, request: bytes) -> Answer:
        """Send a request and wait for all of its answer.

        Raises:
            OSError, asyncio.IncompleteReadError: the connection is lost.
        """
        begin, used = time.perf_counter(), self._ends is not None
        try:
            return await self._ask(request, begin)
        except (OSError, asyncio.IncompleteReadError) as error:
            if not used or (isinstance(error, asyncio.IncompleteReadError) and error.partial):
                raise
            return await self._ask(request, begin)  # it was closed while nobody used it, as a server may

    async def _ask(self, request: bytes, begin: float) -> Answer:
        if self._ends is None:
            here = self._address, 0
            self._ends = await asyncio.open_connection("127.0.0.1", self._port, limit=1 << 20, local_addr=here)
        reader, writer = self._ends
        try:
            writer.write(request)
            header = (await reader.readuntil(b"\r\n\r\n")).lower()
            body = await reader.readexactly(_content_length(header))
        except BaseException:
            self.close()
            raise
        if b"connection: close" in header:
            self.close()
        return Answer(int(header[9:12]), header, body, time.perf_counter() - begin)

    def close(self) -> None:
        """Hang up."""
        if self._ends is not None:
            self._ends[1].close()
            self._ends = None


class LoneConnection:
    """One HTTP connection to this machine's `port` that waits for each answer, with next to no cost of its own."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._buffer = bytearray(1 << 20)

    def ask(self, request: bytes) -> Answer:
        """Send a request and wait for all of its answer, which must say how long it is, and be shorter than 1 MiB.

        Raises:
            OSError: the connection is lost.
        """
        begin, view = time.perf_counter(), memoryview(self._buffer)
        self._socket.sendall(request)
        size, needed, end = 0, len(view), -1
        while size < needed:
            received = self._socket.recv_into(view[size:])
            if not received:
                raise ConnectionError("the server has hung up")
            size += received
            if end < 0 and (end := self._buffer.find(b"\r\n\r\n", 0, size)) >= 0:
                header = bytes(view[: end + 4]).lower()
                needed = len(header) + _content_length(header)
        duration = time.perf_counter() - begin
        return Answer(int(header[9:12]), header, bytes(view[len(header) : needed]), duration)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def _content_length(header: bytes) -> int:
    return int(header.partition(b"content-length: ")[2].partition(b"\r\n")[0])


def get(path: str) -> bytes:
    """Return the bytes of a GET request."""
    return f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()


def post_plan(position: FloatArray, **options: Any) -> bytes:
    """Return the bytes of a request for a plan."""
    return post("/plan", json.dumps({"command": {"dt": 0.001, "position": position.tolist()}, **options}).encode())


def post(path: str, body: bytes) -> bytes:
    """Return the bytes of a POST request of JSON."""
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {len(body)}"
    return head.encode() + b"\r\n\r\n" + body


async def in_turn(port: int, clients: int, requests: Sequence[bytes], check: Callable[[int, Answer], None]) -> float:
    """Let clients ask one request after the other until none is left; return the time that took (s)."""
    numbers = iter(range(len(requests)))

    async def client() -> None:
        connection = Connection(port)
        for number in numbers:
            check(number, await connection.ask(requests[number]))
        connection.close()

    begin = time.perf_counter()
    await asyncio.gather(*(client() for _ in range(clients)))
    return time.perf_counter() - begin


@dataclass
class Flood:
    """What came of requests sent at a rate, whatever the server does.

    Attributes:
        answers: (status, whether it says when to come back, duration (s)) of each.
        lost: requests without an answer.
        unsent: requests that were not sent because all connections waited.
    """

    answers: list[tuple[int, bool, float]] = field(default_factory=list)
    lost: int = 0
    unsent: int = 0


async def at_rate(port: int, rate: float, seconds: float, requests: Sequence[bytes], connections: int) -> Flood:
    """Send requests evenly at a rate (1/s), over connections that are all open before and all in use."""
    flood, free = Flood(), deque(Connection(port) for _ in range(connections))
    await asyncio.gather(*(connection.ask(get("/health/live")) for connection in free))

    async def one(connection: Connection, request: bytes) -> None:
        try:
            answer = await connection.ask(request)
            flood.answers.append((answer.status, b"\r\nretry-after:" in answer.header, answer.duration))
        except (OSError, asyncio.IncompleteReadError):
            flood.lost += 1
        free.append(connection)

    begin, sent, tasks = time.perf_counter(), 0, set()
    while (elapsed := time.perf_counter() - begin) < seconds:
        while sent < elapsed * rate:
            sent += 1
            if not free:
                flood.unsent += 1
                continue
            task = asyncio.create_task(one(free.popleft(), requests[sent % len(requests)]))
            tasks.add(task)
            task.add_done_callback(tasks.discard)
        await asyncio.sleep(0.002)
    await asyncio.gather(*tasks)
    for connection in free:
        connection.close()
    return flood


async def probe(port: int, path: str, every: float, until: asyncio.Event) -> list[float]:
    """Ask for a path again and again (s); return how long each answer took."""
    connection, durations = Connection(port), []
    while not until.is_set():
        durations.append((await connection.ask(get(path))).duration)
        await asyncio.sleep(every)
    connection.close()
    return durations

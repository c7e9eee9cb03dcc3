"""What one client may do to the others."""

from __future__ import annotations

import asyncio
import json
import select
import signal
import socket
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress

from benchmarks.harness.load import post, post_plan
from benchmarks.suite.families import spline
from server.http.connections import most_connections

DEAD = 1100
"""Connections that are opened with an upgrade that comes to nothing."""

UNREAD = 60
"""Connections whose answers are not read."""

BUSY_STREAMS = 31

LONG = {"t": [0.0, 10.0, 19.9], "position": [[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]]}


def knots(count: int, dt: float = 0.0001) -> bytes:
    """Return the body of a request for a plan with so many positions."""
    return b'{"command": {"dt": %g, "position": [' % dt + b",".join([b"[0,0]"] * count) + b"]}}"


def with_line(request: bytes, line: bytes) -> bytes:
    """Return a request with one line more in its header."""
    return request.replace(b"\r\n", b"\r\n" + line + b"\r\n", 1)


def ask_again(port: int, seconds: float, request: bytes, connections: int) -> None:
    """Ask the same from several connections, each anew as soon as it has its answer."""
    once = with_line(request, b"Connection: close")

    async def ask(until: float) -> None:
        while time.monotonic() < until:
            with suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(once)
                while time.monotonic() < until and await reader.read(1 << 18):
                    pass
                writer.close()

    async def ask_all() -> None:
        until = time.monotonic() + seconds
        async with asyncio.timeout(seconds + 1.0):
            await asyncio.gather(*(ask(until) for _ in range(connections)))

    with suppress(TimeoutError):
        asyncio.run(ask_all())


def refining(port: int, seconds: float) -> None:
    """Refine by 200 ms, over 10 connections."""
    ask_again(port, seconds, post_plan(spline().positions[0], refine_ms=200.0), 10)


def long_commands(port: int, seconds: float) -> None:
    """Ask for 64 plans of 19.9 s at a time, over 2 connections."""
    ask_again(port, seconds, post("/plans", json.dumps({"commands": [LONG] * 64}).encode()), 2)


def many_knots(port: int, seconds: float) -> None:
    """Send 150,000 positions, over 4 connections."""
    ask_again(port, seconds, post("/plan", knots(150_000)), 4)


def most_knots(port: int, seconds: float) -> None:
    """Send as many positions as are taken, 20,000, over 4 connections."""
    ask_again(port, seconds, post("/plan", knots(20_000)), 4)


def candidates(port: int, seconds: float) -> None:
    """Ask for 16 candidates, over 8 connections."""
    ask_again(port, seconds, post_plan(spline().positions[0], candidates=16), 8)


def unread(port: int, seconds: float) -> None:
    """Ask for plans of 7 MB over UNREAD connections, and read nothing."""
    with ExitStack() as stack:
        for number in range(UNREAD):
            connection = stack.enter_context(socket.socket())
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.connect(("127.0.0.1", port))
            path, asked = ("/plan", {"command": LONG}) if number % 2 else ("/plans", {"commands": [LONG] * 64})
            connection.sendall(post(path, json.dumps(asked).encode()))
        time.sleep(seconds)


UPGRADE = (
    b"GET /stream HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)

DEAD_UPGRADES = (
    UPGRADE + b"\r\n",  # without the token
    UPGRADE + b"Content-Length: 10\r\n\r\n",
    UPGRADE + b"Transfer-Encoding: chunked\r\n\r\n5\r\nhel",
    UPGRADE + b"X: " + b"a" * 9000 + b"\r\n\r\n",
    UPGRADE + b"X: 1\r\n" * 140 + b"\r\n",
    UPGRADE,
)


def dead_upgrades(port: int, seconds: float) -> float:
    """Open DEAD connections by upgrades that come to nothing; return how long the last one is open (s)."""
    most_connections(DEAD)
    with ExitStack() as stack:
        opened: dict[socket.socket, float] = {}
        for number in range(DEAD):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            with suppress(OSError):
                connection.sendall(DEAD_UPGRADES[number % len(DEAD_UPGRADES)])
            opened[connection] = time.monotonic()
        poll, by_number, longest = select.poll(), {each.fileno(): each for each in opened}, 0.0
        for each in opened:
            poll.register(each, select.POLLIN)
        until = time.monotonic() + 3.0 * seconds
        while by_number and time.monotonic() < until:
            for found, _ in poll.poll(100.0):
                if _is_over(by_number[found]):
                    poll.unregister(found)
                    longest = max(longest, time.monotonic() - opened[by_number.pop(found)])
        return longest if not by_number else time.monotonic() - min(opened.values())


def _is_over(connection: socket.socket) -> bool:
    try:
        return not connection.recv(1 << 16)
    except OSError:
        return True


def frame(data: bytes) -> bytes:
    """Return a text message as a client sends it, masked with zeros."""
    size = struct.pack("!B", 0x80 | len(data)) if len(data) < 126 else struct.pack("!BH", 0x80 | 126, len(data))
    return b"\x81" + size + bytes(4) + data


def busy_streams(port: int, seconds: float) -> None:
    """Step BUSY_STREAMS streams, each as soon as it has its answer."""
    command = {"dt": 0.001, "position": [[0, 0]] * 2000}
    opening = frame(json.dumps({"format": "slide-stream/1", "command": command}).encode())
    with ExitStack() as stack:
        opened = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(BUSY_STREAMS)]
        numbers = dict.fromkeys(opened, 0)
        for each in opened:
            each.sendall(UPGRADE + b"\r\n")
            if b"101 " not in each.recv(1 << 16):
                raise ConnectionError("a stream is refused")
            each.sendall(opening)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for each in select.select(opened, [], [], 0.1)[0]:
                if not each.recv(1 << 17):
                    raise ConnectionError("a stream has ended")
                state = [[1e-6 * numbers[each], 0.0, 0.0, 0.0]]
                each.sendall(frame(json.dumps({"sequence": numbers[each], "pan": state, "object": state}).encode()))
                numbers[each] += 1


ATTACKS: dict[str, tuple[str, Callable[[int, float], float | None]]] = {
    each.__name__: (what, each)
    for what, each in (
        ("10 x refine", refining),
        ("64 x 19.9 s", long_commands),
        ("150,000 positions", many_knots),
        ("20,000 positions", most_knots),
        ("16 candidates", candidates),
        ("unread plans", unread),
        ("31 busy streams", busy_streams),
        ("1,100 dead upgrades", dead_upgrades),
    )
}
"""Attacks by name: what each is, and what does it."""


def run(name: str, port: int, seconds: float) -> float | None:
    """Attack a server for some time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program that measures ends this one
    return ATTACKS[name][1](port, seconds)

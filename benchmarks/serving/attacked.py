"""What others notice of an attack, and what the server holds and does meanwhile.

Each attack runs in a process of its own, as a client's would.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.harness.load import Answer, Connection, post, post_plan, probe
from benchmarks.serving.attacks import LONG, knots, run, with_line
from benchmarks.serving.process import PATIENCE, PLANNING, Serving, is_ready
from benchmarks.suite.families import spline

OTHER = "127.0.0.2"
"""Address of the client that is attacked; the attacker's is 127.0.0.1."""

PAUSE = 0.02
"""Between two requests of the client that is attacked (s)."""

SMALL = 300
"""Samples of its plans."""

KILLS, KILLING = 20, 120.0
"""Times that the planning process is killed, and the longest that this may take (s)."""

SLOW_PACE = 0.1
"""Time between two steps of a slow stream (s)."""


@dataclass(frozen=True)
class Attacked:
    """What another client notices, that asks for small plans and for the health.

    Attributes:
        refused: its plans that were refused.
        plan_p99: time of its plans, 99th percentile (s).
        live_p99: time of `GET /health/live`, 99th percentile (s).
        turn: longest turn of the server's event loop, of a processor's time (s).
        memory: the most that all processes of the server held together (bytes).
    """

    refused: int
    plan_p99: float
    live_p99: float
    turn: float
    memory: int


@contextmanager
def attacking(name: str, port: int, seconds: float) -> Iterator[Callable[[], float | None]]:
    """Attack from another process; gives what waits for the end of it and returns its figure."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(os.getpid).result()  # it has started, and imported what it needs
        yield pool.submit(run, name, port, seconds).result


def beside(server: Serving, name: str, seconds: float, token: str | None = None) -> tuple[Attacked, float | None]:
    """Ask for small plans and for the health while a server is attacked; the attack's own figure comes too."""
    server.forget()
    with attacking(name, server.port, seconds) as end:
        figures = asyncio.run(_be_attacked(server.port, seconds, token))
        found = Attacked(**figures, turn=server.turn.seconds, memory=server.most_memory())
        return found, end()


async def _be_attacked(port: int, seconds: float, token: str | None) -> dict[str, Any]:
    small = post_plan(spline().positions[0][:SMALL])
    if token is not None:
        small = with_line(small, b"Authorization: Bearer " + token.encode())
    over, answers = asyncio.Event(), []
    probing = asyncio.create_task(probe(port, "/health/live", PAUSE, over))
    other, until = Connection(port, OTHER), time.monotonic() + seconds
    while time.monotonic() < until:
        answers.append(await other.ask(small))
        await asyncio.sleep(PAUSE)
    other.close()
    over.set()
    return {
        "refused": sum(answer.status != 200 for answer in answers),
        "plan_p99": float(np.percentile([answer.duration for answer in answers], 99.0)),
        "live_p99": float(np.percentile(await probing, 99.0)),
    }


def slow_stream(server: Serving, seconds: float) -> float:
    """Return the longest delay (s) of a stream's step at 10 Hz, beside BUSY_STREAMS."""
    from runtime.client.stream import RemoteStream

    url, longest = f"http://127.0.0.1:{server.port}", 0.0
    with (
        RemoteStream(url, spline().positions[0], timeout=PATIENCE) as stream,
        attacking("busy_streams", server.port, seconds),
    ):
        until = time.monotonic() + seconds - SLOW_PACE
        while time.monotonic() < until:
            time.sleep(SLOW_PACE)
            begin = time.perf_counter()
            stream.step()
            longest = max(longest, time.perf_counter() - begin)
        return longest


@dataclass(frozen=True)
class Killed:
    """The planning process is killed again and again: at once, while it starts, when it is ready, while it plans.

    Attributes:
        times: that it was killed.
        longest: longest time until the server took work again (s).
        ends: times that the server itself ended.
    """

    times: int
    longest: float
    ends: int


def kill_again(server: Serving, times: int = KILLS, seconds: float = KILLING) -> Killed:
    """Kill the planning process so many times, for no longer than that."""
    until, killed, longest = time.monotonic() + seconds, 0, 0.0
    while killed < times and time.monotonic() < until:
        time.sleep(0.3 * (killed % 4))
        process = server.process(PLANNING)
        if process is None:
            time.sleep(0.01)
            continue
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
            killed += 1
        if killed % 4 == 0:  # and the three times before while the next one started
            begin = time.monotonic()
            asyncio.run(_until_it_plans(server.port, until))
            longest = max(longest, time.monotonic() - begin)
    return Killed(killed, longest, int(not server.alive))


async def _until_it_plans(port: int, until: float) -> None:
    small = post_plan(spline().positions[0][:SMALL])
    while time.monotonic() < until:
        with suppress(OSError, asyncio.IncompleteReadError):
            if await is_ready(port) and (await _once(port, small)).status == 200:
                return
        await asyncio.sleep(0.02)


async def _once(port: int, request: bytes) -> Answer:
    connection = Connection(port)
    try:
        return await connection.ask(request)
    finally:
        connection.close()


@dataclass(frozen=True)
class Worst:
    """The requests that cost most of those that are taken, one after the other.

    Attributes:
        turn: longest turn of the event loop, of a processor's time (s).
        memory: the most that all processes held more than before (bytes).
    """

    turn: float
    memory: int


def worst_requests() -> Sequence[bytes]:
    """Return them."""
    full = b'{"command": {"dt": 0.001, "position": [' + b",".join([b"[0.01234567890123,0.01]"] * 20_000) + b"]}}"
    return (
        post("/plan", json.dumps({"command": LONG}).encode()),
        post("/plan", knots(20_000)),
        post("/plan", full),
        post("/plan", knots(150_000)),
        post(
            "/plan", json.dumps({"command": {"t": [0, 1.9], "position": [[0, 0], [0.1, 0]]}, "candidates": 16}).encode()
        ),
        post("/plans", json.dumps({"commands": [{"dt": 0.001, "position": [[0, 0]] * 1000}] * 64}).encode()),
    )


def ask_for_the_worst(server: Serving) -> Worst:
    """Ask for each by itself, after all have been asked for once, which makes room that stays."""
    turn, more = 0.0, 0
    for counts in (False, True):
        for request in worst_requests():
            turn, more = _watched(server, turn, more, partial(_read_all, server.port, request))
        turn, more = _watched(server, turn, more, partial(_follow_the_longest, server.port))
        if not counts:
            turn, more = 0.0, 0
    return Worst(turn, more)


def _watched(server: Serving, turn: float, more: int, ask: Callable[[], None]) -> tuple[float, int]:
    """Ask; return the longest turn, and the most memory that was held more than before, of this and of others."""
    before = server.memory()
    server.forget()
    ask()
    return max(turn, server.turn.seconds), max(more, server.most_memory() - before)


def _follow_the_longest(port: int) -> None:
    """Follow the longest command that is taken, and another one from the second step on."""
    from websockets.sync.client import connect

    command = {"dt": 0.001, "position": [[0, 0]] * 20_000}
    asked = ({"format": "slide-stream/2", "command": command}, {"sequence": 0}, {"sequence": 1, "command": command})
    with connect(f"ws://127.0.0.1:{port}/stream") as stream:
        for message in asked:
            stream.send(json.dumps(message))
            stream.recv()


def _read_all(port: int, request: bytes) -> None:
    with socket.create_connection(("127.0.0.1", port)) as connection, suppress(ConnectionError):
        connection.sendall(with_line(request, b"Connection: close"))
        while connection.recv(1 << 18):
            pass

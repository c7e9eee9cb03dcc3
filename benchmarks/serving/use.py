"""A server in use: a lone client, many at once, more than it can do, streams, and half of what it can do for long."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.load import Answer, Connection, LoneConnection, at_rate, in_turn, post_plan, probe
from benchmarks.harness.section import NAME
from benchmarks.serving.process import process_state, processor_time
from benchmarks.suite.families import spline
from runtime.cli.console import say
from runtime.errors import SlideError
from runtime.physics.pan import integrate_pan

WARM_UP = 20
"""Requests of a lone client before those that count."""

NONCE_SAMPLES, NONCE_CLIENTS = 100, 32
"""Samples of a command that is looked for in its answer, and clients that ask for them."""

FLOOD_CONNECTIONS = 400

STREAM_PACE = 0.01
"""Time between two steps of the stream (s): ten times as often as a controller steps."""

RECOVERY = 10.0
"""Longest wait for the server to be as fast as before (s)."""

BUSY = (429, 503)
"""Statuses that tell a client to come back later."""

MIB = 1 << 20


@dataclass(frozen=True)
class Lone:
    """A lone client of `POST /plan`.

    Attributes:
        p50, p99: time of a request (s).
        parts: of it what the header Server-Timing says, median (s), by name.
        own: what is neither planning nor JSON: the server's own cost, the connection and the client, median (s).
        server_time, planning_time: processor time that a request takes of the server's two processes (s).
        rate: plans a second.
    """

    p50: float
    p99: float
    parts: dict[str, float]
    own: float
    server_time: float
    planning_time: float
    rate: float


@dataclass(frozen=True)
class Clients:
    """Many clients at once.

    Attributes:
        rate: plans a second.
        ratio: that over the rate of a lone client.
        refused: requests that were answered by something else than a plan.
    """

    rate: float
    ratio: float
    refused: int


@dataclass(frozen=True)
class Flooded:
    """Three times as many requests as can be planned.

    Attributes:
        rate: requests a second.
        planned, refused: answered with 200, and with 429 or 503.
        other: answered otherwise, or without Retry-After.
        unanswered: without an answer.
        unsent: not sent because all connections waited.
        longest: longest time of an answer (s).
        ready_p99: time of `GET /health/ready` meanwhile, 99th percentile (s).
        recovery: time after it until a lone request takes no more than twice the usual (s).
    """

    rate: float
    planned: int
    refused: int
    other: int
    unanswered: int
    unsent: int
    longest: float
    ready_p99: float
    recovery: float


@dataclass(frozen=True)
class Soaked:
    """A long time at half load.

    Attributes:
        minutes: how long (min).
        slope_server, slope_planning, slope: growth of the memory in 10 minutes after the first quarter, of each
            process and of both (bytes).
        threads, descriptors: more of them at the end than after the first quarter.
    """

    minutes: float
    slope_server: float
    slope_planning: float
    slope: float
    threads: float
    descriptors: float


def time_lone_client(port: int, processes: Sequence[int], requests: Sequence[bytes], count: int) -> Lone:
    """Time a client that waits for each of `count` answers."""
    connection, answers = LoneConnection(port), []
    for index in range(WARM_UP + count):
        if index == WARM_UP:
            before = [processor_time(each) for each in processes]
        answers.append(connection.ask(requests[index % len(requests)]))
        if answers[-1].status != 200:
            raise SlideError(f"slide-serve answers {answers[-1].status}: {answers[-1].body[:200]!r}")
    server, planning = (processor_time(each) - at for each, at in zip(processes, before, strict=True))
    connection.close()
    totals = np.array([answer.duration for answer in answers[WARM_UP:]])
    parts = [server_timing(answer) for answer in answers[WARM_UP:]]
    spent = np.array([sum(part[name] for name in ("read", "encode", "decode", "write")) for part in parts])
    p50, p99 = np.percentile(totals, [50.0, 99.0]).tolist()
    return Lone(
        p50=p50,
        p99=p99,
        parts={name: float(np.median([part[name] for part in parts])) for name in parts[0]},
        own=float(np.median(totals - spent)),
        server_time=server / count,
        planning_time=planning / count,
        rate=1.0 / float(np.mean(totals)),
    )


def time_python_client(port: int, count: int) -> float:
    """Return the median time of a plan through the client in Python (s): its own JSON, written and read, is in it."""
    from runtime.client import Client

    durations, positions = [], spline().positions
    with Client(f"http://127.0.0.1:{port}") as client:
        for index in range(count):
            begin = time.perf_counter()
            client.plan(positions[index % len(positions)])
            durations.append(time.perf_counter() - begin)
    return float(np.median(durations))


def server_timing(answer: Answer) -> dict[str, float]:
    """Return the times that the header Server-Timing tells (s)."""
    line = answer.header.partition(b"server-timing: ")[2].partition(b"\r\n")[0].decode()
    parts = (part.split(";dur=") for part in line.split(", ") if ";dur=" in part)
    return {name: float(milliseconds) * 1e-3 for name, milliseconds in parts}


async def count_plans(port: int, requests: Sequence[bytes], clients: int, rounds: int, lone_rate: float) -> Clients:
    """Count the plans a second of many clients at once; what is refused is no plan."""
    planned = 0

    def check(_: int, answer: Answer) -> None:
        nonlocal planned
        planned += answer.status == 200

    await in_turn(port, clients, [*requests] * 2, lambda *_: None)
    asked = [*requests] * rounds
    duration = await in_turn(port, clients, asked, check)
    rate = planned / duration
    return Clients(rate, rate / lone_rate, len(asked) - planned)


async def look_through_answers(port: int, count: int) -> tuple[int, int]:
    """Give each request a command of its own; return how many plans came of them, and how many have another one."""
    nonces = [1e-9 * (index + 1) for index in range(count)]
    requests = [post_plan(np.full((NONCE_SAMPLES, 2), (nonce, 0.0))) for nonce in nonces]
    planned = wrong = 0

    def check(index: int, answer: Answer) -> None:
        nonlocal planned, wrong
        if answer.status == 200:
            planned += 1
            wrong += json.loads(answer.body)["command"]["position"] != [[nonces[index], 0.0]] * NONCE_SAMPLES

    await in_turn(port, NONCE_CLIENTS, requests, check)
    return planned, wrong


async def flood(port: int, requests: Sequence[bytes], peak: float, lone_p99: float, seconds: float) -> Flooded:
    """Ask for three times as many plans as can be made, watch the health, and wait until all is as before."""
    over = asyncio.Event()
    watching = asyncio.create_task(probe(port, "/health/ready", 0.02, over))
    sent = await at_rate(port, 3.0 * peak, seconds, requests, FLOOD_CONNECTIONS)
    over.set()
    ended, connection = time.perf_counter(), Connection(port)
    while time.perf_counter() - ended < RECOVERY:
        answer = await connection.ask(requests[0])
        if answer.status == 200 and answer.duration <= 2.0 * lone_p99:
            break
    recovery = time.perf_counter() - ended
    right = [status == 200 or (status in BUSY and retry) for status, retry, _ in sent.answers]
    return Flooded(
        rate=3.0 * peak,
        planned=sum(status == 200 for status, *_ in sent.answers),
        refused=sum(status in BUSY for status, *_ in sent.answers),
        other=len(right) - sum(right),
        unanswered=sent.lost,
        unsent=sent.unsent,
        longest=max(duration for *_, duration in sent.answers),
        ready_p99=float(np.percentile(await watching, 99.0)),
        recovery=recovery,
    )


def time_stream(port: int, packed: bool, steps: int) -> float:
    """Return the 99th percentile of a step's round trip (s)."""
    from runtime.client.stream import RemoteStream

    durations, pan = [], np.zeros(4)
    position = spline().positions[0]
    with RemoteStream(f"http://127.0.0.1:{port}", position, packed=packed) as remote:
        sliding = np.array([*position[0], 0.0, 0.0])
        for _ in range(steps):
            begin = time.perf_counter()
            u = remote.step(np.tile(pan, (remote.chunk, 1)), np.tile(sliding, (remote.chunk, 1)))
            durations.append(time.perf_counter() - begin)
            pan = integrate_pan(pan, u[:, :2])[-1]
            time.sleep(STREAM_PACE)
    return float(np.percentile(durations, 99.0))


async def soak(
    port: int, processes: Sequence[int], requests: Sequence[bytes], rate: float, clients: int, minutes: float
) -> Soaked:
    """Ask for plans at a rate (1/s), for long or until interrupted, and watch what the processes hold.

    Args:
        port: of the server.
        processes: the one that serves, and the one that plans.
        requests: for plans, one after the other.
        rate: at which they are sent (1/s).
        clients: connections.
        minutes: how long (min).
    """
    over, begin = asyncio.Event(), time.perf_counter()
    held: list[list[float]] = []

    async def watch() -> None:
        while not over.is_set():
            elapsed = time.perf_counter() - begin
            if len(held) % 60 == 0:
                say(NAME, f"soak: {elapsed / 60.0:.0f} of {minutes:g} min, {_told(held)}")
            held.append([elapsed, *(number for each in processes for number in process_state(each))])
            await asyncio.sleep(1.0)

    watching = asyncio.create_task(watch())
    with suppress(asyncio.CancelledError):  # interrupted: what has been seen is told
        await at_rate(port, rate, minutes * 60.0, requests, clients)
    over.set()
    await watching
    states = np.array(held[len(held) // 4 :])
    slopes = [float(np.polyfit(states[:, 0], states[:, column], 1)[0]) * 600.0 for column in (1, 4)]
    more = states[-10:].max(axis=0) - states[:10].max(axis=0)
    return Soaked(
        minutes=held[-1][0] / 60.0,
        slope_server=slopes[0],
        slope_planning=slopes[1],
        slope=sum(slopes),
        threads=float(more[2] + more[5]),
        descriptors=float(more[3] + more[6]),
    )


def _told(held: list[list[float]]) -> str:
    if not held:
        return "begun"
    _, *states = held[-1]
    names = [f"{which} {what}" for which in ("server", "planning") for what in ("MiB", "threads", "descriptors")]
    numbers = [
        f"{it / MIB:.1f}" if name.endswith("MiB") else f"{it:.0f}" for name, it in zip(names, states, strict=True)
    ]
    return ", ".join(f"{name} {number}" for name, number in zip(names, numbers, strict=True))

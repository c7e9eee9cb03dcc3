"""The server under load.

The server and its planning are two processes, and this load is a third. Where other programs want the cores too, a
figure says as much of them as of the server: beside each stands what the processes took of a processor.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from benchmarks.harness.load import Answer, Connection, LoneConnection, at_rate, get, in_turn, post, post_plan, probe
from benchmarks.harness.section import NAME, Measured, Section, Subject, at_least
from benchmarks.harness.tables import targets_table
from benchmarks.harness.targets import COUNT, MILLISECONDS, SECONDS, TIMES, Target, Unit, Verdict
from benchmarks.suite.families import spline
from runtime.cli.console import say
from runtime.documents.options import option
from runtime.errors import SlideError, extra
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

PATIENCE = 120.0
"""Longest wait for the server to be ready (s)."""

BUSY = (429, 503)
"""Statuses that tell a client to come back later."""

MIB = 1 << 20


@dataclass(frozen=True)
class ServerSettings:
    """How much is asked of the server.

    Attributes:
        soak: flood for longer, and go on at half load.
        minutes: of half load.
        lone: requests of a lone client.
        python: requests of the client in Python.
        clients: at once.
        rounds: times that each of the suite's 64 spline commands is planned for them.
        nonces: requests whose command is looked for in the answer.
        flood_seconds, soak_flood_seconds: length of the flood, without and with `soak`.
        steps: of a stream.
        attack_seconds: length of each attack.
    """

    soak: bool = option("Flood the server for 60 s, then go on at half load.", False)
    minutes: float = option("Length of the server's half load (min).", 20.0, "MIN")
    lone: int = 300
    python: int = 50
    clients: int = 64
    rounds: int = 16
    nonces: int = 10_000
    flood_seconds: float = 20.0
    soak_flood_seconds: float = 60.0
    steps: int = 500
    attack_seconds: float = 10.0

    def __post_init__(self) -> None:
        at_least(1, minutes=self.minutes)


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
class Attacked:
    """One client asks for as much as it can, from several connections; another, for small plans and for the health.

    Attributes:
        refused: small plans that were refused.
        plan_p99: time of a small plan, 99th percentile (s).
        live_p99: time of `GET /health/live`, 99th percentile (s).
    """

    refused: int
    plan_p99: float
    live_p99: float


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


@dataclass(frozen=True)
class Server:
    """Everything this section measures; None where it was interrupted before, or is not part of it.

    Attributes:
        lone: a lone client.
        python_p50: a request through the client in Python, median (s).
        clients: many clients at once.
        looked_through: plans in which the command of the request was looked for.
        wrong: plans that have another command.
        flood: a flood of requests.
        stream_json_p99, stream_packed_p99: round trip of a step of `WS /stream`, 99th percentile (s).
        refining: beside a client that refines by 200 ms over 10 connections.
        long_commands: beside one that sends 64 commands of 19.9 s at a time over 2.
        many_knots: beside one that sends 150,000 positions over 4.
        memory: largest resident memory of all processes so far (bytes).
        soak: a long time at half load.
    """

    lone: Lone | None = None
    python_p50: float | None = None
    clients: Clients | None = None
    looked_through: int | None = None
    wrong: int | None = None
    flood: Flooded | None = None
    stream_json_p99: float | None = None
    stream_packed_p99: float | None = None
    refining: Attacked | None = None
    long_commands: Attacked | None = None
    many_knots: Attacked | None = None
    memory: float | None = None
    soak: Soaked | None = None


PLANS_PER_SECOND = Unit("plans/s", show="{:.0f}")
MEBIBYTES = Unit("MiB", 1.0 / MIB)

TARGETS = (
    Target("lone.p50", "POST /plan, lone client, median", MILLISECONDS, "<=", 15e-3),
    Target("lone.p99", "POST /plan, lone client, 99 %", MILLISECONDS, "<=", 40e-3),
    Target("lone.own", "own cost beyond planning and JSON", MILLISECONDS, "<=", 1e-3),
    Target("lone.server_time", "processor time of the server", MILLISECONDS),
    Target("lone.planning_time", "processor time of planning", MILLISECONDS),
    Target("python_p50", "the client in Python, median", MILLISECONDS),
    Target("lone.rate", "one client", PLANS_PER_SECOND),
    Target("clients.rate", "64 clients", PLANS_PER_SECOND),
    Target("clients.ratio", "64 clients over one", TIMES, ">=", 3.0),
    Target("clients.refused", "64 clients: refused", COUNT),
    Target("looked_through", "answers looked through", COUNT),
    Target("wrong", "answers to another request", COUNT, "<=", 0),
    Target("flood.rate", "flood at 3 x the peak", Unit("requests/s", show="{:.0f}")),
    Target("flood.planned", "flood: planned", COUNT),
    Target("flood.refused", "flood: refused with 429 or 503", COUNT),
    Target("flood.other", "flood: neither 200 nor these with Retry-After", COUNT, "<=", 0),
    Target("flood.unanswered", "flood: without an answer", COUNT, "<=", 0),
    Target("flood.unsent", "flood: not sent, all connections waited", COUNT),
    Target("flood.longest", "flood: longest answer", SECONDS, "<=", 1.0),
    Target("flood.ready_p99", "flood: health/ready, 99 %", MILLISECONDS, "<=", 50e-3),
    Target("flood.recovery", "time until latency is back to normal", SECONDS, "<=", 5.0),
    Target("stream_json_p99", "WS /stream round trip, JSON, 99 %", MILLISECONDS, "<=", 5e-3),
    Target("stream_packed_p99", "WS /stream round trip, packed, 99 %", MILLISECONDS, "<=", 5e-3),
    *(
        Target(f"{name}.{figure}", f"{words}: {what}", unit, "<=", limit)
        for name, words in (
            ("refining", "10 x refine"),
            ("long_commands", "64 x 19.9 s"),
            ("many_knots", "150,000 positions"),
        )
        for figure, what, unit, limit in (
            ("refused", "others refused", COUNT, 0),
            ("plan_p99", "others, 99 %", MILLISECONDS, 250e-3),
            ("live_p99", "health/live, 99 %", MILLISECONDS, 50e-3),
        )
    ),
    Target("memory", "memory of all processes, at most", MEBIBYTES, "<=", 512 * MIB),
    Target("soak.minutes", "half load", Unit("min", show="{:.1f}")),
    Target("soak.slope", "memory's growth in 10 minutes", MEBIBYTES, "<", MIB),
    Target("soak.threads", "threads more at the end", COUNT, "<=", 0),
    Target("soak.descriptors", "descriptors more at the end", COUNT, "<=", 0),
)


class Serving(NamedTuple):
    """A running server: its port, and the numbers of its two processes."""

    port: int
    processes: list[int]


@contextmanager
def serving(model: Path | None = None) -> Iterator[Serving]:
    """Run `slide-serve` with a bundle, the shipped one if None, on a free port of this machine.

    Raises:
        SlideError: it ends, or is not ready within PATIENCE.
    """
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    environment = {**os.environ, "SLIDE_PORT": str(port), "OMP_NUM_THREADS": "1", "SLIDE_STREAM_RATE": "1000"}
    process = subprocess.Popen(
        [Path(sys.executable).with_name("slide-serve"), *([] if model is None else ["--model", str(model)])],
        env=environment,
        stderr=subprocess.DEVNULL,
        process_group=0,  # what interrupts this program is not for the server
    )
    try:
        asyncio.run(_ready(port, process))
        planning = [each for each in children_of(process.pid) if "planning.worker" in _command_line(each)]
        yield Serving(port, [process.pid, *planning])
    finally:
        process.terminate()
        process.wait(timeout=30.0)


async def _ready(port: int, process: subprocess.Popen[bytes]) -> None:
    connection, until = Connection(port), time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if process.poll() is not None:
            raise SlideError(f"slide-serve ended with exit code {process.returncode}: run it to see why")
        try:
            if (await connection.ask(get("/health/ready"))).status == 200:
                connection.close()
                return
        except (OSError, asyncio.IncompleteReadError):
            pass
        await asyncio.sleep(0.05)
    raise SlideError(f"slide-serve is not ready after {PATIENCE:g} s")


def measure_server(subject: Subject, settings: ServerSettings) -> Measured:
    """Put a server under load; interrupted, tell what has been measured.

    Raises:
        MissingExtraError: the server is not installed.
        SlideError: it does not start.
    """
    with extra("server"):
        import server.run  # noqa: F401 (what slide-serve runs)
    requests = [post_plan(position) for position in spline().positions]
    found: dict[str, Any] = {}
    with suppress(KeyboardInterrupt), serving(subject.folder) as (port, processes):
        found["lone"] = lone = time_lone_client(port, processes, requests, settings.lone)
        found["python_p50"] = time_python_client(port, settings.python)
        found["clients"] = clients = asyncio.run(
            count_plans(port, requests, settings.clients, settings.rounds, lone.rate)
        )
        found["looked_through"], found["wrong"] = asyncio.run(look_through_answers(port, settings.nonces))
        seconds = settings.soak_flood_seconds if settings.soak else settings.flood_seconds
        found["flood"] = asyncio.run(flood(port, requests, clients.rate, lone.p99, seconds))
        for form in ("json", "packed"):
            found[f"stream_{form}_p99"] = time_stream(port, form == "packed", settings.steps)
        for name, (attack, connections) in attacks().items():
            found[name] = asyncio.run(beside(port, attack, connections, settings.attack_seconds))
        found["memory"] = float(sum(map(most_memory, children_of(processes[0]))))
        if settings.soak:
            found["soak"] = asyncio.run(soak(port, processes, requests, clients, settings))
    return Measured(Server(**found))


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


def attacks() -> dict[str, tuple[bytes, int]]:
    """Return what a client may send to take much for little, and over how many connections."""
    long = {"t": [0.0, 10.0, 19.9], "position": [[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]]}
    knots = b'{"command": {"dt": 0.0001, "position": [' + b",".join([b"[0,0]"] * 150_000) + b"]}}"
    return {
        "refining": (post_plan(spline().positions[0], refine_ms=200.0), 10),
        "long_commands": (post("/plans", json.dumps({"commands": [long] * 64}).encode()), 2),
        "many_knots": (post("/plan", knots), 4),
    }


async def beside(port: int, attack: bytes, connections: int, seconds: float) -> Attacked:
    """Ask for small plans and for the health, from another address than the one that attacks."""
    over = asyncio.Event()

    async def ask_without_end() -> None:
        while not over.is_set():
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(attack.replace(b"\r\n", b"\r\nConnection: close\r\n", 1))
            while not over.is_set() and await reader.read(1 << 18):
                pass
            writer.close()

    attacking = [asyncio.create_task(ask_without_end()) for _ in range(connections)]
    probing = asyncio.create_task(probe(port, "/health/live", 0.02, over))
    other, small, answers = Connection(port, "127.0.0.2"), post_plan(spline().positions[0][:300]), []
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        answers.append(await other.ask(small))
        await asyncio.sleep(0.02)
    over.set()
    live = await probing
    for task in attacking:
        task.cancel()
    await asyncio.gather(*attacking, return_exceptions=True)
    other.close()
    return Attacked(
        refused=sum(answer.status != 200 for answer in answers),
        plan_p99=float(np.percentile([answer.duration for answer in answers], 99.0)),
        live_p99=float(np.percentile(live, 99.0)),
    )


async def soak(
    port: int, processes: Sequence[int], requests: Sequence[bytes], clients: Clients, settings: ServerSettings
) -> Soaked:
    """Ask for half as many plans as can be made, for long or until interrupted, and watch what the processes hold."""
    over, begin = asyncio.Event(), time.perf_counter()
    held: list[list[float]] = []

    async def watch() -> None:
        while not over.is_set():
            elapsed = time.perf_counter() - begin
            if len(held) % 60 == 0:
                say(NAME, f"soak: {elapsed / 60.0:.0f} of {settings.minutes:g} min, {_told(held)}")
            held.append([elapsed, *(number for each in processes for number in process_state(each))])
            await asyncio.sleep(1.0)

    watching = asyncio.create_task(watch())
    with suppress(asyncio.CancelledError):  # interrupted: what has been seen is told
        await at_rate(port, 0.5 * clients.rate, settings.minutes * 60.0, requests, settings.clients)
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


def process_state(number: int) -> tuple[int, int, int]:
    """Return a process's resident bytes, threads and open descriptors."""
    lines = Path(f"/proc/{number}/status").read_text().splitlines()
    status = dict(line.split(":", 1) for line in lines if ":" in line)
    return int(status["VmRSS"].split()[0]) << 10, int(status["Threads"]), len(os.listdir(f"/proc/{number}/fd"))


def children_of(number: int) -> list[int]:
    """Return a process and those that it has started."""
    return [number, *map(int, Path(f"/proc/{number}/task/{number}/children").read_text().split())]


def _command_line(number: int) -> str:
    return Path(f"/proc/{number}/cmdline").read_text()


def most_memory(number: int) -> int:
    """Return the largest resident memory that a process has had (bytes)."""
    text = Path(f"/proc/{number}/status").read_text()
    return int(text.partition("VmHWM:")[2].split()[0]) << 10


def processor_time(number: int) -> float:
    """Return how long a process has run on a processor (s), in all its threads."""
    fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def server_tables(measured: Server, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the server's figures, beside their targets."""
    parts = {} if measured.lone is None else measured.lone.parts
    details = {"lone.p99": [(f"  {name}, median", MILLISECONDS.text(each)) for name, each in parts.items()]}
    return targets_table("slide-serve under load", verdicts, details)


SECTION = Section(
    "server",
    "slide-serve under load: latency, throughput, a flood, streams; some minutes",
    ServerSettings(),
    measure_server,
    TARGETS,
    server_tables,
    timed=True,
    usual=False,
)

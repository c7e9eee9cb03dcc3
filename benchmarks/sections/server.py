"""The server under load.

The server, what reads and what plans are three processes, and this load is another. Where other programs want the cores
too, a figure says as much of them as of the server: beside each stands what the processes took of a processor.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from rich.table import Table

from benchmarks.harness.load import post_plan
from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import targets_table
from benchmarks.harness.targets import COUNT, MILLISECONDS, SECONDS, TIMES, Target, Unit, Verdict
from benchmarks.serving.attacked import Attacked, Killed, Worst, ask_for_the_worst, beside, kill_again, slow_stream
from benchmarks.serving.attacks import ATTACKS
from benchmarks.serving.process import PLANNING, Serving, serving
from benchmarks.serving.use import (
    Clients,
    Flooded,
    Lone,
    Soaked,
    count_plans,
    flood,
    look_through_answers,
    soak,
    time_lone_client,
    time_python_client,
    time_stream,
)
from benchmarks.suite.families import spline
from runtime.documents.options import option
from runtime.errors import SlideError, extra

MIB = 1 << 20

TOKEN = "a-token"
"""Of the server that dead upgrades come to."""


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
        attack_seconds, soak_attack_seconds: length of each attack, without and with `soak`.
        kills: times that the planning process is killed.
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
    soak_attack_seconds: float = 60.0
    kills: int = 20

    def __post_init__(self) -> None:
        at_least(1, minutes=self.minutes)


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
        worst: the requests that cost most of those that are taken.
        attacked: what another client notices of each attack, by its name.
        dead_closed: longest that a connection of a dead upgrade is open (s).
        slow_stream: longest delay of a stream at 10 Hz beside 31 that step as fast as they are answered (s).
        killed: the planning process is killed again and again.
        memory: the most that all processes held together, of all attacks (bytes).
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
    worst: Worst | None = None
    attacked: dict[str, Attacked] = field(default_factory=dict)
    dead_closed: float | None = None
    slow_stream: float | None = None
    killed: Killed | None = None
    memory: float | None = None
    soak: Soaked | None = None


PLANS_PER_SECOND = Unit("plans/s", show="{:.0f}")
MEBIBYTES = Unit("MiB", 1.0 / MIB)

TARGETS = (
    Target("lone.p50", "POST /plan, lone client, median", MILLISECONDS, "<=", 4.6e-3),
    Target("lone.p99", "POST /plan, lone client, 99 %", MILLISECONDS, "<=", 40e-3),
    Target("lone.own", "own cost beyond planning and JSON", MILLISECONDS, "<=", 1e-3),
    Target("lone.server_time", "processor time of the server", MILLISECONDS),
    Target("lone.planning_time", "processor time of planning", MILLISECONDS),
    Target("python_p50", "the client in Python, median", MILLISECONDS),
    Target("lone.rate", "one client", PLANS_PER_SECOND),
    Target("clients.rate", "64 clients", PLANS_PER_SECOND, ">=", 600.0),
    Target("clients.ratio", "64 clients over one", TIMES, ">=", 2.9),
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
    Target("worst.turn", "worst request: turn of the event loop", MILLISECONDS, "<=", 5e-3),
    Target("worst.memory", "worst request: memory of all processes", MEBIBYTES, "<=", 16 * MIB),
    *(
        Target(f"attacked.{name}.{figure}", f"{words}: {what}", unit, "<=" if limit is not None else "", limit)
        for name, (words, _) in ATTACKS.items()
        for figure, what, unit, limit in (
            ("refused", "others refused", COUNT, 0),
            ("plan_p99", "others, 99 %", MILLISECONDS, 250e-3),
            ("live_p99", "health/live, 99 %", MILLISECONDS, 50e-3),
            ("turn", "turn of the event loop", MILLISECONDS, None),
            ("memory", "memory", MEBIBYTES, 512 * MIB),
        )
    ),
    Target("dead_closed", "1,100 dead upgrades: all closed", SECONDS, "<=", 10.0),
    Target("slow_stream", "10 Hz beside 31 streams: longest delay", MILLISECONDS, "<=", 50e-3),
    Target("killed.times", "planning killed", COUNT),
    Target("killed.longest", "planning killed: plans again", SECONDS, "<=", 6.0),
    Target("killed.ends", "planning killed: the server ends", COUNT, "<=", 0),
    Target("memory", "memory of all processes, at most", MEBIBYTES, "<=", 512 * MIB),
    Target("soak.minutes", "half load", Unit("min", show="{:.1f}")),
    Target("soak.slope", "memory's growth in 10 minutes", MEBIBYTES, "<", MIB),
    Target("soak.threads", "threads more at the end", COUNT, "<=", 0),
    Target("soak.descriptors", "descriptors more at the end", COUNT, "<=", 0),
)


def measure_server(subject: Subject, settings: ServerSettings) -> Measured:
    """Put a server under load; interrupted, tell what has been measured.

    Raises:
        MissingExtraError: the server is not installed.
        SlideError: it does not start.
    """
    with extra("server"):
        import server.run  # noqa: F401 (what slide-serve runs)
    found: dict[str, Any] = {"attacked": {}}
    seconds = settings.soak_attack_seconds if settings.soak else settings.attack_seconds
    with suppress(KeyboardInterrupt):
        with serving(subject.folder) as running:
            _use(running, settings, found)
            _attack(running, settings, seconds, found)
        with serving(subject.folder, token=TOKEN, max_refine_ms=0) as running:
            found["attacked"]["dead_upgrades"], found["dead_closed"] = beside(running, "dead_upgrades", seconds, TOKEN)
    if found["attacked"]:
        found["memory"] = float(max(each.memory for each in found["attacked"].values()))
    return Measured(Server(**found))


def _use(running: Serving, settings: ServerSettings, found: dict[str, Any]) -> None:
    """Ask for as much as clients do, and for more than can be done."""
    port = running.port
    requests = [post_plan(position) for position in spline().positions]
    processes = [running.program.pid, _of(running, PLANNING)]
    found["lone"] = lone = time_lone_client(port, processes, requests, settings.lone)
    found["python_p50"] = time_python_client(port, settings.python)
    found["clients"] = clients = asyncio.run(count_plans(port, requests, settings.clients, settings.rounds, lone.rate))
    found["looked_through"], found["wrong"] = asyncio.run(look_through_answers(port, settings.nonces))
    seconds = settings.soak_flood_seconds if settings.soak else settings.flood_seconds
    found["flood"] = asyncio.run(flood(port, requests, clients.rate, lone.p99, seconds))
    for form in ("json", "packed"):
        found[f"stream_{form}_p99"] = time_stream(port, form == "packed", settings.steps)
    if settings.soak:
        half = 0.5 * clients.rate
        found["soak"] = asyncio.run(soak(port, processes, requests, half, settings.clients, settings.minutes))


def _attack(running: Serving, settings: ServerSettings, seconds: float, found: dict[str, Any]) -> None:
    """Do to it what one client may do to the others."""
    found["worst"] = ask_for_the_worst(running)
    for name in ATTACKS:
        if name != "dead_upgrades":  # which come to a server with a token
            found["attacked"][name], _ = beside(running, name, seconds)
    found["slow_stream"] = slow_stream(running, seconds)
    found["killed"] = kill_again(running, settings.kills)


def _of(running: Serving, module: str) -> int:
    """Return the number of a process beside the server.

    Raises:
        SlideError: it is not there.
    """
    number = running.process(module)
    if number is None:
        raise SlideError(f"slide-serve has no process that runs {module}")
    return number


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

"""The server under load: `python -m benchmarks.server`, and with `--soak` for as long as the issue of stability asks.

The server is a process of its own, and so is this load: on two cores they share nothing but the wire.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import orjson
import typer

from benchmarks.load import Answer, Connection, at_rate, get, in_turn, post_plan, probe
from benchmarks.suite import SAMPLES, spline
from benchmarks.targets import Target
from runtime.cli import AsJson, print_json, print_table, run
from runtime.friction import integrate_pan
from runtime.planner import Planner
from runtime.remote import RemoteStream
from server.schemas import PlanRequest, read
from server.worker import as_json

LONE = 300
"""Requests of a lone client."""

CLIENTS = 64
NONCES = 10_000
NONCE_SAMPLES = 100
FLOOD_CONNECTIONS = 400
STREAM_STEPS = 500
STREAM_PACE = 0.01
"""Time between two steps of the stream (s): ten times as often as a controller steps."""

RECOVERY = 10.0
"""Longest wait for the server to be as fast as before (s)."""

MIB = 1 << 20

TARGETS = (
    Target("lone.p50", "POST /plan, lone client, median", "ms", "<=", 15e-3, "{:.1f}", 1e3),
    Target("lone.p99", "POST /plan, lone client, 99 %", "ms", "<=", 40e-3, "{:.1f}", 1e3),
    Target("lone.own", "own cost beyond planning and JSON", "ms", "<=", 1e-3, "{:.2f}", 1e3),
    Target("clients.ratio", "plans a second, 64 clients over one", "x", ">=", 3.0, "{:.2f}"),
    Target("nonce.wrong", "replies to another request, of 10,000", "", "<=", 0, "{:.0f}"),
    Target("flood.other", "3 x peak: neither 200 nor 503 with Retry-After", "", "<=", 0, "{:.0f}"),
    Target("flood.unanswered", "3 x peak: requests without an answer", "", "<=", 0, "{:.0f}"),
    Target("flood.longest", "3 x peak: longest answer", "s", "<=", 1.0, "{:.2f}"),
    Target("flood.ready_p99", "3 x peak: health/ready, 99 %", "ms", "<=", 50e-3, "{:.1f}", 1e3),
    Target("flood.recovery", "as fast as before after", "s", "<=", 5.0, "{:.2f}"),
    Target("stream.json_p99", "WS /stream round trip, JSON, 99 %", "ms", "<=", 5e-3, "{:.2f}", 1e3),
    Target("stream.packed_p99", "WS /stream round trip, packed, 99 %", "ms", "<=", 5e-3, "{:.2f}", 1e3),
    Target("soak.slope", "memory, growth in 10 minutes after the warm-up", "MiB", "<", MIB, "{:.2f}", 1.0 / MIB),
    Target("soak.threads", "threads more at the end", "", "<=", 0, "{:.0f}"),
    Target("soak.descriptors", "descriptors more at the end", "", "<=", 0, "{:.0f}"),
)


@contextmanager
def serving(port: int) -> Iterator[int]:
    """Run `slide-serve` on a port and give its process's number, once it is ready."""
    environment = {**os.environ, "SLIDE_PORT": str(port), "OMP_NUM_THREADS": "1", "SLIDE_STREAM_RATE": "1000"}
    process = subprocess.Popen(
        [Path(sys.executable).with_name("slide-serve")], env=environment, stderr=subprocess.DEVNULL
    )
    try:
        asyncio.run(_ready(port))
        yield process.pid
    finally:
        process.terminate()
        process.wait(timeout=30.0)


async def _ready(port: int) -> None:
    connection, until = Connection(port), time.monotonic() + 120.0
    while time.monotonic() < until:
        try:
            if (await connection.ask(get("/health/ready"))).status == 200:
                connection.close()
                return
        except (OSError, asyncio.IncompleteReadError):
            pass
        await asyncio.sleep(0.05)
    raise TimeoutError("the server is never ready")


async def measure_lone(port: int, requests: list[bytes]) -> dict[str, float]:
    """Time a lone client; what is neither planning nor JSON is the server's own cost."""
    totals, plannings = [], []

    def check(_: int, answer: Answer) -> None:
        assert answer.status == 200, answer.body[:200]
        totals.append(answer.duration)
        plannings.append(planning_time(answer))

    await in_turn(port, 1, requests[:20], lambda *_: None)
    await in_turn(port, 1, [requests[index % len(requests)] for index in range(LONE)], check)
    own = float(np.median(np.array(totals) - np.array(plannings))) - json_time(requests[0])
    p50, p99 = np.percentile(totals, [50.0, 99.0]).tolist()
    return {
        "p50": p50,
        "p99": p99,
        "planning_p50": float(np.median(plannings)),
        "own": own,
        "rate": 1.0 / np.mean(totals),
    }


def planning_time(answer: Answer) -> float:
    """Return the time in encoder and decoder that the header Server-Timing tells (s)."""
    line = answer.header.partition(b"server-timing: ")[2].partition(b"\r\n")[0].decode()
    parts = dict(part.strip().split(";dur=") for part in line.split(","))
    return (float(parts["encode"]) + float(parts["decode"])) * 1e-3


def json_time(request: bytes) -> float:
    """Return the time to read this request and to write its answer (s), measured in this process."""
    body = request.partition(b"\r\n\r\n")[2]
    plan = Planner().plan(read(PlanRequest, body).command.command())

    def once() -> float:
        begin = time.perf_counter()
        read(PlanRequest, body).command.command()
        as_json(plan)
        return time.perf_counter() - begin

    return float(np.median([once() for _ in range(50)]))


async def measure_clients(port: int, requests: list[bytes], lone_rate: float) -> dict[str, float]:
    """Count the plans a second of many clients at once; what is refused is no plan."""
    planned = 0

    def check(_: int, answer: Answer) -> None:
        nonlocal planned
        planned += answer.status == 200

    await in_turn(port, CLIENTS, requests * 2, lambda *_: None)
    asked = requests * 16
    duration = await in_turn(port, CLIENTS, asked, check)
    rate = planned / duration
    return {"rate": rate, "ratio": rate / lone_rate, "refused": len(asked) - planned}


async def measure_nonce(port: int) -> dict[str, float]:
    """Give each request a command of its own and look for it in its reply."""
    nonces = [1e-9 * (index + 1) for index in range(NONCES)]
    requests = [post_plan(np.full((NONCE_SAMPLES, 2), (nonce, 0.0))) for nonce in nonces]
    wrong = 0

    def check(index: int, answer: Answer) -> None:
        nonlocal wrong
        found = orjson.loads(answer.body)["command"]["position"] if answer.status == 200 else []
        wrong += found != [[nonces[index], 0.0]] * NONCE_SAMPLES

    await in_turn(port, 32, requests, check)
    return {"wrong": wrong}


async def measure_flood(
    port: int, requests: list[bytes], peak: float, lone_p99: float, seconds: float
) -> dict[str, float]:
    """Ask for three times as many plans as can be made, watch the health, and wait until all is as before."""
    over = asyncio.Event()
    watching = asyncio.create_task(probe(port, "/health/ready", 0.02, over))
    flood = await at_rate(port, 3.0 * peak, seconds, requests, FLOOD_CONNECTIONS)
    over.set()
    ended, connection = time.perf_counter(), Connection(port)
    while time.perf_counter() - ended < RECOVERY:
        answer = await connection.ask(requests[0])
        if answer.status == 200 and answer.duration <= 2.0 * lone_p99:
            break
    recovery = time.perf_counter() - ended
    right = [status == 200 or (status == 503 and retry) for status, retry, _ in flood.answers]
    return {
        "rate": 3.0 * peak,
        "planned": sum(status == 200 for status, *_ in flood.answers),
        "refused": sum(status == 503 for status, *_ in flood.answers),
        "other": len(right) - sum(right),
        "unanswered": flood.lost,
        "unsent": flood.unsent,
        "longest": max(duration for *_, duration in flood.answers),
        "ready_p99": float(np.percentile(await watching, 99.0)),
        "recovery": recovery,
    }


def measure_stream(port: int, packed: bool) -> float:
    """Return the 99th percentile of a step's round trip (s)."""
    durations, pan = [], np.zeros(4)
    position = spline().positions[0]
    with RemoteStream(f"http://127.0.0.1:{port}", position, packed=packed) as remote:
        sliding = np.array([*position[0], 0.0, 0.0])
        for _ in range(STREAM_STEPS):
            begin = time.perf_counter()
            u = remote.step(np.tile(pan, (remote.chunk, 1)), np.tile(sliding, (remote.chunk, 1)))
            durations.append(time.perf_counter() - begin)
            pan = integrate_pan(pan, u)[-1]
            time.sleep(STREAM_PACE)
    return float(np.percentile(durations, 99.0))


async def measure_soak(port: int, pid: int, requests: list[bytes], peak: float, minutes: float) -> dict[str, float]:
    """Ask for half as many plans as can be made, for long, and watch what the process holds."""
    over, held = asyncio.Event(), []

    async def watch() -> None:
        begin = time.perf_counter()
        while not over.is_set():
            held.append((time.perf_counter() - begin, *process_state(pid)))
            await asyncio.sleep(1.0)

    watching = asyncio.create_task(watch())
    await at_rate(port, 0.5 * peak, minutes * 60.0, requests, CLIENTS)
    over.set()
    await watching
    states = np.array(held[len(held) // 4 :])
    slope = float(np.polyfit(states[:, 0], states[:, 1], 1)[0]) * 600.0
    threads, descriptors = (float(states[-10:, column].max() - states[:10, column].max()) for column in (2, 3))
    return {"minutes": minutes, "slope": slope, "threads": threads, "descriptors": descriptors}


def process_state(pid: int) -> tuple[int, int, int]:
    """Return a process's resident bytes, threads and open descriptors."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines() if ":" in line)
    return int(status["VmRSS"].split()[0]) << 10, int(status["Threads"]), len(os.listdir(f"/proc/{pid}/fd"))


def bench_server(
    soak: Annotated[bool, typer.Option("--soak", help="Flood for 60 s, and 20 minutes at half load.")] = False,
    port: Annotated[int, typer.Option("--port", help="Port to serve on.")] = 8765,
    as_json: AsJson = False,
) -> None:
    """Measure the server under load, and say what is missed."""
    requests = [post_plan(position) for position in spline().positions]
    results: dict[str, dict[str, Any]] = {"samples": {"each": SAMPLES}}
    with serving(port) as pid:
        results["lone"] = lone = asyncio.run(measure_lone(port, requests))
        results["clients"] = clients = asyncio.run(measure_clients(port, requests, lone["rate"]))
        results["nonce"] = asyncio.run(measure_nonce(port))
        seconds = 60.0 if soak else 20.0
        results["flood"] = asyncio.run(measure_flood(port, requests, clients["rate"], lone["p99"], seconds))
        results["stream"] = {
            "json_p99": measure_stream(port, packed=False),
            "packed_p99": measure_stream(port, packed=True),
        }
        if soak:
            results["soak"] = asyncio.run(measure_soak(port, pid, requests, clients["rate"], 20.0))
    missed = []
    rows = [
        (f"{name} {key}".replace("_", " "), f"{it:.4g}") for name, part in results.items() for key, it in part.items()
    ]
    for target in TARGETS:
        name, key = target.figure.split(".")
        if name in results:
            value = results[name][key]
            met = target.met(value)
            missed += [] if met else [target.what]
            verdict = f"{target.text(value)} {target.unit}".rstrip() + ("" if met else ", MISSED")
            rows.append((f"{target.what} ({target.asked} asked)", verdict))
    if as_json:
        print_json({**results, "missed": missed})
    else:
        print_table("slide-serve under load", rows)
    if missed:
        raise typer.Exit(1)


if __name__ == "__main__":
    run("benchmarks.server", bench_server)

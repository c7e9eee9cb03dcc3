"""The server under load: `python -m benchmarks.sections.server`; `--soak` goes on for half an hour.

The server and its planning are two processes, and this load is a third. Where other programs want the cores too, a
figure says as much of them as of the server: beside each stands what the processes took of a processor.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import orjson
import typer

from benchmarks.harness.load import Answer, Connection, LoneConnection, at_rate, get, in_turn, post_plan, probe
from benchmarks.harness.targets import Target
from benchmarks.suite.families import SAMPLES, spline
from runtime.cli.console import AsJson, print_json, print_table, run, say
from runtime.client.client import Client
from runtime.client.stream import RemoteStream
from runtime.physics.pan import integrate_pan

LONE = 300
"""Requests of a lone client."""

HTTPX = 50
"""Of these through the client in Python, which reads the answer too."""

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
def serving(port: int) -> Iterator[list[int]]:
    """Run `slide-serve` on a port and give the numbers of its two processes, once it is ready."""
    environment = {**os.environ, "SLIDE_PORT": str(port), "OMP_NUM_THREADS": "1", "SLIDE_STREAM_RATE": "1000"}
    process = subprocess.Popen(
        [Path(sys.executable).with_name("slide-serve")],
        env=environment,
        stderr=subprocess.DEVNULL,
        process_group=0,  # what interrupts this program is not for the server
    )
    try:
        asyncio.run(_ready(port))
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        yield [process.pid, *map(int, children)]
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


def measure_lone(port: int, processes: list[int], requests: list[bytes]) -> dict[str, float]:
    """Time a lone client; what is neither planning nor JSON is the server's own cost, the wire and the client."""
    connection, answers = LoneConnection(port), []
    for index in range(20 + LONE):
        if index == 20:
            before = [processor_time(each) for each in processes]
        answers.append(connection.ask(requests[index % len(requests)]))
        assert answers[-1].status == 200, answers[-1].body[:200]
    server, planning = (processor_time(each) - at for each, at in zip(processes, before, strict=True))
    connection.close()
    totals = np.array([answer.duration for answer in answers[20:]])
    parts = [server_timing(answer) for answer in answers[20:]]
    spent = np.array([sum(part[name] for name in ("read", "encode", "decode", "write")) for part in parts])
    p50, p99 = np.percentile(totals, [50.0, 99.0]).tolist()
    return {
        "p50": p50,
        "p99": p99,
        **{f"{name}_p50": float(np.median([part[name] for part in parts])) for name in parts[0]},
        "own": float(np.median(totals - spent)),
        "server_processor_time": server / LONE,
        "planning_processor_time": planning / LONE,
        "rate": 1.0 / float(np.mean(totals)),
    }


def measure_httpx(port: int) -> dict[str, float]:
    """Time the client in Python: its own JSON, written and read, is in it."""
    durations, positions = [], spline().positions
    with Client(f"http://127.0.0.1:{port}") as client:
        for index in range(HTTPX):
            begin = time.perf_counter()
            client.plan(positions[index])
            durations.append(time.perf_counter() - begin)
    return {"p50": float(np.median(durations))}


def server_timing(answer: Answer) -> dict[str, float]:
    """Return the times that the header Server-Timing tells (s)."""
    line = answer.header.partition(b"server-timing: ")[2].partition(b"\r\n")[0].decode()
    parts = (part.split(";dur=") for part in line.split(", "))
    return {name: float(milliseconds) * 1e-3 for name, milliseconds in parts}


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


async def measure_soak(
    port: int, processes: list[int], requests: list[bytes], peak: float, minutes: float
) -> dict[str, float]:
    """Ask for half as many plans as can be made, for long or until interrupted, and watch what the processes hold."""
    over, begin = asyncio.Event(), time.perf_counter()
    held: list[list[float]] = []

    async def watch() -> None:
        while not over.is_set():
            elapsed = time.perf_counter() - begin
            if len(held) % 60 == 0:
                say("benchmarks.sections.server", f"soak: {elapsed / 60.0:.0f} of {minutes:g} min, {_told(held)}")
            held.append([elapsed, *(number for each in processes for number in process_state(each))])
            await asyncio.sleep(1.0)

    watching = asyncio.create_task(watch())
    with suppress(asyncio.CancelledError):  # interrupted: what has been seen is told
        await at_rate(port, 0.5 * peak, minutes * 60.0, requests, CLIENTS)
    over.set()
    await watching
    states = np.array(held[len(held) // 4 :])
    slopes = [float(np.polyfit(states[:, 0], states[:, column], 1)[0]) * 600.0 for column in (1, 4)]
    more = states[-10:].max(axis=0) - states[:10].max(axis=0)
    return {
        "minutes": held[-1][0] / 60.0,
        "slope_server": slopes[0],
        "slope_planning": slopes[1],
        "slope": sum(slopes),
        "threads": float(more[2] + more[5]),
        "descriptors": float(more[3] + more[6]),
    }


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


def processor_time(number: int) -> float:
    """Return how long a process has run on a processor (s), in all its threads."""
    fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def bench_server(
    soak: Annotated[bool, typer.Option("--soak", help="Flood for 60 s, and long at half load.")] = False,
    minutes: Annotated[float, typer.Option("--minutes", min=1.0, help="Length of the soak.")] = 20.0,
    port: Annotated[int, typer.Option("--port", help="Port to serve on.")] = 8765,
    as_json: AsJson = False,
) -> None:
    """Measure the server under load, and say what is missed; interrupted, tell what has been measured."""
    requests = [post_plan(position) for position in spline().positions]
    results: dict[str, dict[str, Any]] = {"samples": {"each": SAMPLES}}
    with suppress(KeyboardInterrupt), serving(port) as processes:
        results["lone"] = lone = measure_lone(port, processes, requests)
        results["httpx"] = measure_httpx(port)
        results["clients"] = clients = asyncio.run(measure_clients(port, requests, lone["rate"]))
        results["nonce"] = asyncio.run(measure_nonce(port))
        seconds = 60.0 if soak else 20.0
        results["flood"] = asyncio.run(measure_flood(port, requests, clients["rate"], lone["p99"], seconds))
        results["stream"] = {
            "json_p99": measure_stream(port, packed=False),
            "packed_p99": measure_stream(port, packed=True),
        }
        if soak:
            results["soak"] = asyncio.run(measure_soak(port, processes, requests, clients["rate"], minutes))
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
    run("benchmarks.sections.server", bench_server)

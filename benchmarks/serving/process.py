"""`slide-serve` as processes of this machine: what they are, and what they hold and take."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness.load import Connection, get
from benchmarks.serving.watched import LongestTurn
from runtime.errors import SlideError

PATIENCE = 300.0
"""Longest wait for the server to be ready (s)."""

PLANNING = "planning.worker"
"""Module of the process that plans."""


class Serving(NamedTuple):
    """A running server.

    Attributes:
        port: that it listens on.
        program: its process.
        turn: the longest turn of its event loop.
    """

    port: int
    program: subprocess.Popen[bytes]
    turn: LongestTurn

    @property
    def alive(self) -> bool:
        """Whether it has not ended."""
        return self.program.poll() is None

    def processes(self) -> list[int]:
        """Return the numbers of its processes: the server, those that it has started, and theirs."""
        started = children_of(self.program.pid)
        return [self.program.pid, *started, *(each for one in started for each in children_of(one))]

    def process(self, module: str) -> int | None:
        """Return the number of the process beside it that runs a module, if there is one."""
        for each in children_of(self.program.pid):
            with suppress(OSError):
                if module in Path(f"/proc/{each}/cmdline").read_text():
                    return each
        return None

    def memory(self) -> int:
        """Return what its processes hold (bytes)."""
        return sum(memory(each, "VmRSS") for each in self.processes())

    def most_memory(self) -> int:
        """Return the most that each process has held since `forget`, all together (bytes)."""
        return sum(memory(each, "VmHWM") for each in self.processes())

    def forget(self) -> None:
        """Begin anew to watch for the longest turn and the most memory."""
        self.turn.seconds = 0.0
        for each in self.processes():
            with suppress(OSError):
                Path(f"/proc/{each}/clear_refs").write_text("5")


@contextmanager
def serving(model: Path | None = None, **settings: object) -> Iterator[Serving]:
    """Run `slide-serve` with a bundle, the shipped one if None, on a free port of this machine.

    Args:
        model: the bundle's folder.
        settings: of the server, besides.

    Raises:
        SlideError: it ends, or is not ready within PATIENCE.
    """
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    given = {"port": port, "stream_rate": 1000, "stream_idle": 60, **settings}  # of a busy machine's clients
    if model is not None:
        given["model"] = model
    environment = {f"SLIDE_{name.upper()}": str(value) for name, value in given.items()}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "turn"
        turn = LongestTurn(file)
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.serving.watched", file],
            env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
            cwd=Path(__file__).parents[2],
            stderr=subprocess.DEVNULL,
            process_group=0,  # what interrupts this program is not for the server
        )
        try:
            asyncio.run(_ready(port, process))
            yield Serving(port, process, turn)
        finally:
            process.terminate()
            process.wait(timeout=30.0)


async def _ready(port: int, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if process.poll() is not None:
            raise SlideError(f"slide-serve ended with exit code {process.returncode}: run it to see why")
        if await is_ready(port):
            return
        await asyncio.sleep(0.05)
    raise SlideError(f"slide-serve is not ready after {PATIENCE:g} s")


async def is_ready(port: int) -> bool:
    """Return whether a server takes work."""
    connection = Connection(port)
    try:
        return (await connection.ask(get("/health/ready"))).status == 200
    except (OSError, asyncio.IncompleteReadError):
        return False
    finally:
        connection.close()


def children_of(number: int) -> list[int]:
    """Return the processes that a process has started; none if it has ended."""
    with suppress(OSError):
        return [int(each) for each in Path(f"/proc/{number}/task/{number}/children").read_text().split()]
    return []


def memory(number: int, which: str) -> int:
    """Return VmRSS or VmHWM of a process (bytes); 0 if it has ended."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{number}/status").read_text().partition(f"{which}:")[2].split()[0]) << 10
    return 0


def process_state(number: int) -> tuple[int, int, int]:
    """Return a process's resident bytes, threads and open descriptors."""
    lines = Path(f"/proc/{number}/status").read_text().splitlines()
    status = dict(line.split(":", 1) for line in lines if ":" in line)
    return int(status["VmRSS"].split()[0]) << 10, int(status["Threads"]), len(os.listdir(f"/proc/{number}/fd"))


def processor_time(number: int) -> float:
    """Return how long a process has run on a processor (s), in all its threads."""
    fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))

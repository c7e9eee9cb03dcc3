from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from server.app import create_app
from server.planning.process import PLANNING_COMMAND
from server.run import Server
from server.service import Service
from server.settings import Settings


def ask(method: str, url: str, **content: Any) -> httpx.Response:
    """Send a request; patient, since the machine may be busy, and without the certificates that https would need."""
    return httpx.request(method, url, timeout=60.0, verify=False, **content)


SLIDE_SERVE = Path(sys.executable).with_name("slide-serve")


class Running(NamedTuple):
    """A server that listens on a port of its own, in a thread of this process."""

    url: str
    port: int
    service: Service

    def get(self, path: str, **content: Any) -> httpx.Response:
        return ask("GET", f"{self.url}{path}", **content)

    def post(self, path: str, **content: Any) -> httpx.Response:
        return ask("POST", f"{self.url}{path}", **content)

    def raw(self, data: bytes, timeout: float = 60.0) -> bytes:
        """Send bytes as they are and return all that comes back until the server closes or stops talking."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=timeout) as connection:
            connection.sendall(data)
            return received(connection)


def received(connection: socket.socket) -> bytes:
    """Return one answer: the header, and as much as it declares."""
    answer = b""
    while part := connection.recv(1 << 16):
        answer += part
        head, found, body = answer.partition(b"\r\n\r\n")
        length = [line for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:")]
        if found and length and len(body) >= int(length[0].split(b":")[1]):
            break
    return answer


@contextmanager
def running(command: Sequence[str] = PLANNING_COMMAND, *, tracing: Any = None, **settings: Any) -> Iterator[Running]:
    """Run a server with these settings until the block is left; it plans by this command, and traces what is asked."""
    listening = socket.create_server(("127.0.0.1", 0))
    given = {"port": 0, "max_refine_ms": 0.0, **settings}  # a process that refines compiles first
    app = create_app(Settings(**given), command, tracing)
    server = Server(app, app.state.service.settings)
    thread = threading.Thread(target=lambda: asyncio.run(server.serve(sockets=[listening])), daemon=True)
    thread.start()
    port = listening.getsockname()[1]
    url = f"http://127.0.0.1:{port}"
    try:
        until = time.monotonic() + 240.0
        while ask("GET", f"{url}/health/ready").status_code != 200:
            assert time.monotonic() < until, "the server is never ready"
            time.sleep(0.02)
        yield Running(url, port, app.state.service)
    finally:
        server.should_exit = True
        thread.join(timeout=30.0)
        assert not thread.is_alive()


class Process:
    """`slide-serve` as a process of its own, on a port that was free."""

    def __init__(
        self, *arguments: str, output: Any = subprocess.PIPE, cwd: Path | None = None, **settings: Any
    ) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        given = {"SLIDE_PORT": self.port, "SLIDE_MAX_REFINE_MS": 0, **settings}
        environment = {**os.environ, **{name: str(value) for name, value in given.items()}}
        self.url = f"http://127.0.0.1:{self.port}"
        self.process = subprocess.Popen(
            [SLIDE_SERVE, *arguments],
            env=environment,
            cwd=cwd,
            stdout=output,
            stderr=output,
            text=True,
            start_new_session=True,  # as in a terminal, where Ctrl-C is sent to the server with its planning process
        )

    def get(self, path: str) -> httpx.Response:
        return ask("GET", f"{self.url}{path}")

    def post(self, path: str, **content: Any) -> httpx.Response:
        return ask("POST", f"{self.url}{path}", **content)

    def wait_until_ready(self) -> None:
        until = time.monotonic() + 240.0
        while time.monotonic() < until and self.process.poll() is None:
            try:
                if self.get("/health/ready").status_code == 200:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.05)
        pytest.fail(f"the server is never ready: {self.process.poll()}")

    def ended(self) -> tuple[int, str]:
        """Return exit code and what was said on standard error."""
        _, said = self.process.communicate(timeout=60.0)
        return self.process.returncode, said


@contextmanager
def process(*arguments: str, **settings: Any) -> Iterator[Process]:
    it = Process(*arguments, **settings)
    try:
        it.wait_until_ready()
        yield it
    finally:
        it.process.kill()
        it.process.communicate()


@pytest.fixture(scope="session")
def run_server() -> Callable[..., Any]:
    return running


@pytest.fixture(scope="session")
def server() -> Iterator[Running]:
    with ExitStack() as stack:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("NUMBA_DISABLE_JIT", "1")  # compiling takes ten seconds; the runtime's tests do it
            it = stack.enter_context(running(max_refine_ms=200.0))
        yield it


@pytest.fixture(scope="session")
def page_server() -> Iterator[Running]:
    """A patient server that refines nothing: uncompiled that would take long."""
    with running(max_wait=20.0, deadline=20.0) as it:
        yield it


def wait_for(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    """Wait until a condition holds; fails if it does not within that time."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, f"it does not happen within {seconds:g} s"
        time.sleep(0.005)


def curve(samples: int = 300, seed: int = 0) -> NDArray[np.float64]:
    """Return (samples, 2) positions (m): a few slow sines of random phase."""
    random = np.random.default_rng(seed)
    t = np.arange(samples)[:, None, None] * 0.001
    rate, phase = random.uniform(1.0, 8.0, (2, 3)), random.uniform(0.0, 6.28, (2, 3))
    drawn: NDArray[np.float64] = (0.02 * np.sin(rate * t + phase)).sum(axis=2)
    return drawn - drawn[0]


@pytest.fixture(scope="session")
def make_curve() -> Callable[..., NDArray[np.float64]]:
    return curve


@pytest.fixture(scope="session")
def make_request() -> Callable[..., dict[str, Any]]:
    def make(samples: int = 300, seed: int = 0, **others: Any) -> dict[str, Any]:
        return {"command": {"dt": 0.001, "position": curve(samples, seed).tolist()}, **others}

    return make


@pytest.fixture(scope="session")
def get_problem() -> Callable[[bytes], dict[str, Any]]:
    def get(answer: bytes) -> dict[str, Any]:
        document: dict[str, Any] = json.loads(answer.partition(b"\r\n\r\n")[2])
        return document

    return get

"""What one client may do to the others: it gets its share, and they do not notice."""

from __future__ import annotations

import json
import os
import resource
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.sync.client import connect

from .conftest import Process, process, wait_for
from .http.test_connections import frame, upgrade
from .planning.test_faults import begin_of_post, children

SECONDS = float(os.environ.get("SLIDE_ATTACK_SECONDS", "3"))
"""How long each attack goes on; `make soak` takes 60 s."""

PATIENCE = 5
"""Longest wait of a command in these tests (s): a busy machine is no fault of the server's."""

MIB = 1 << 20
MOST_MEMORY = 512 * MIB

LONG = {"t": [0, 10, 19.9], "position": [[0, 0], [0.1, 0], [0, 0]]}


def knots(count: int) -> bytes:
    return b'{"command":{"dt":0.0001,"position":[' + b",".join([b"[0,0]"] * count) + b"]}}"


def heaviest(server: int) -> int:
    """Return the most memory that each of a server's processes has held at once, all together (bytes)."""
    numbers = [server, *map(int, Path(f"/proc/{server}/task/{server}/children").read_text().split())]
    peaks = [Path(f"/proc/{number}/status").read_text().partition("VmHWM:")[2].split()[0] for number in numbers]
    return sum(map(int, peaks)) << 10


class Other(threading.Thread):
    """Somebody else, from another address: asks for the health and for small plans, and keeps what came of it."""

    def __init__(self, server: Any, request: dict[str, Any]) -> None:
        super().__init__()
        self.over = threading.Event()
        self.statuses: list[int] = []
        self.refusals: list[dict[str, Any]] = []
        self.live: list[float] = []
        self.plans: list[float] = []
        self._server, self._request = server, request

    def run(self) -> None:
        transport = httpx.HTTPTransport(local_address="127.0.0.2")
        with httpx.Client(base_url=self._server.url, transport=transport, timeout=60.0) as client:
            while not self.over.is_set():
                begin = time.perf_counter()
                assert client.get("/health/live").status_code == 200
                self.live.append(time.perf_counter() - begin)
                begin = time.perf_counter()
                answer = client.post("/plan", json=self._request)
                self.statuses.append(answer.status_code)
                if answer.status_code != 200:
                    self.refusals.append(answer.json())
                self.plans.append(time.perf_counter() - begin)
                time.sleep(0.02)


@contextmanager
def watched(server: Any, request: dict[str, Any]) -> Iterator[Other]:
    other = Other(server, request)
    other.start()
    try:
        yield other
    finally:
        other.over.set()
        other.join()


@pytest.fixture(scope="module")
def attacked() -> Iterator[Process]:
    with process(SLIDE_MAX_WAIT=PATIENCE) as it:
        yield it


def ask_in_a_loop(server: Any, clients: int, path: str, body: bytes) -> None:
    """Let clients send a request again and again, reading all of each answer, as long as an attack goes on."""
    until = time.monotonic() + SECONDS

    def one() -> None:
        with httpx.Client(base_url=server.url, timeout=60.0) as client:
            while time.monotonic() < until:
                with client.stream("POST", path, content=body, headers={"Content-Type": "application/json"}) as answer:
                    for _ in answer.iter_raw():
                        if time.monotonic() > until:
                            break

    with ThreadPoolExecutor(clients) as threads:
        for each in [threads.submit(one) for _ in range(clients)]:
            each.result()


LOOPS = {
    "64 commands of 19.9 s": ("/plans", json.dumps({"commands": [LONG] * 64}).encode(), 2),
    "150,000 knots": ("/plan", knots(150_000), 4),
    "20,000 knots": ("/plan", knots(20_000), 4),
    "16 candidates": (
        "/plan",
        json.dumps({"command": {"t": [0, 2], "position": [[0, 0], [0.1, 0]]}, "candidates": 16}).encode(),
        8,
    ),
}


@pytest.mark.parametrize("kind", LOOPS)
def test_others_are_planned_for_while_one_client_asks_for_much(
    attacked: Process, make_request: Callable[..., Any], kind: str
) -> None:
    path, body, clients = LOOPS[kind]
    with watched(attacked, make_request(300)) as other:
        ask_in_a_loop(attacked, clients, path, body)
    assert other.refusals == []
    assert len(other.statuses) > SECONDS  # `slide-bench server` holds them to 250 ms on a quiet machine
    assert heaviest(attacked.process.pid) < MOST_MEMORY


def test_others_are_planned_for_while_one_client_refines(make_request: Callable[..., Any]) -> None:
    pytest.importorskip("numba")
    with process(SLIDE_MAX_REFINE_MS=200, SLIDE_MAX_WAIT=PATIENCE) as server:
        body = json.dumps({**make_request(300), "refine_ms": 200}).encode()
        with watched(server, make_request(300)) as other:
            ask_in_a_loop(server, 10, "/plan", body)
        assert other.refusals == []
        assert heaviest(server.process.pid) < MOST_MEMORY


def test_plans_that_nobody_reads_are_bounded_and_keep_nobody_out(
    attacked: Process, make_request: Callable[..., Any]
) -> None:
    """Replies of /plan and of /plans, of 7 MB each, left unread on many connections."""
    with ExitStack() as stack:
        for number in range(60):
            connection = stack.enter_context(socket.socket())
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.connect(("127.0.0.1", attacked.port))
            path, document = ("/plan", {"command": LONG}) if number % 2 else ("/plans", {"commands": [LONG] * 64})
            body = json.dumps(document).encode()
            connection.sendall(begin_of_post(path, len(body)) + body)
        with watched(attacked, make_request(300)) as other:
            time.sleep(2.0 * SECONDS)
        assert other.refusals == []
        assert heaviest(attacked.process.pid) < MOST_MEMORY


def test_bodies_that_never_end_are_bounded(attacked: Process, make_request: Callable[..., Any]) -> None:
    with ExitStack() as stack:
        for _ in range(100):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", attacked.port)))
            connection.setblocking(False)
            with suppress(BlockingIOError):
                connection.send(begin_of_post("/plan", 1_000_000) + b" " * 900_000)
        with watched(attacked, make_request(300)) as other:
            time.sleep(SECONDS)
        assert other.refusals == []
        assert heaviest(attacked.process.pid) < MOST_MEMORY


SLOW_STOPS = {
    "a limit of 1e-5 m/s^2": {"limits": {"pan_reach": 100.0, "acceleration": 1e-5, "jerk": 1e-5}},
    "a jerk of 0.1 of the acceleration": {"limits": {"acceleration": 10.0, "jerk": 1.0}},
    "hardly any friction": {"friction": {"static": 1e-6, "kinetic": 1e-6}},
}


@pytest.mark.parametrize("kind", SLOW_STOPS)
def test_stream_whose_stops_would_take_minutes_is_refused_with_the_number(server: Any, kind: str) -> None:
    with connect(server.url.replace("http", "ws") + "/stream") as stream:
        command = {"dt": 0.001, "position": [[0, 0], [0, 0]]}
        stream.send(json.dumps({"format": "slide-stream/1", "command": command, **SLOW_STOPS[kind]}))
        problem = json.loads(stream.recv())
        assert problem["status"] == 422
        assert "a stop may take" in problem["detail"]
        assert "at most 10 s are taken" in problem["detail"]


def test_pan_measured_too_fast_to_stop_ends_the_stream_with_the_number(server: Any) -> None:
    with connect(server.url.replace("http", "ws") + "/stream") as stream:
        command = {"dt": 0.001, "position": [[0, 0], [0, 0]]}
        stream.send(json.dumps({"format": "slide-stream/1", "command": command}))
        stream.recv()
        stream.send(json.dumps({"sequence": 0, "pan": [[0, 0, 999, 0]], "object": [[0, 0, 0, 0]]}))
        assert "a pan of 999 m/s needs too long to stop" in json.loads(stream.recv())["detail"]


@pytest.mark.parametrize("kind", list(SLOW_STOPS)[:2])
def test_plan_whose_stop_would_take_minutes_is_refused_with_the_number(server: Any, kind: str) -> None:
    command = {"dt": 0.001, "position": [[0, 0], [0, 0]]}
    problem = server.post("/plan", json={"command": command, **SLOW_STOPS[kind]}).json()
    assert problem["status"] == 422
    assert "a stop may take" in problem["detail"]


def test_candidates_that_are_too_much_together_are_refused_with_the_number(server: Any) -> None:
    problem = server.post("/plan", json={"command": LONG, "candidates": 16}).json()
    assert problem["place"] == "candidates"
    assert "at most 560 are planned" in problem["detail"]


def test_more_positions_than_samples_are_refused_with_the_number(server: Any) -> None:
    answer = server.post("/plan", content=knots(20_001), headers={"Content-Type": "application/json"})
    assert "has 20001 positions, at most 20000 are taken" in answer.json()["detail"]


OPENING = json.dumps({"format": "slide-stream/1", "command": {"dt": 0.001, "position": [[0, 0]] * 2000}})


def keep_busy(port: int, streams: int, over: threading.Event) -> None:
    """Step streams as fast as they answer, each at its rate at most, from one thread."""
    steps = []
    for number in range(4000):
        state = [[1e-6 * number, 0.0, 0.0, 0.0]]
        steps.append(frame(1, json.dumps({"sequence": number, "pan": state, "object": state}).encode()))
    with ExitStack() as stack:
        opened = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(streams)]
        numbers, due = dict.fromkeys(opened, 0), dict.fromkeys(opened, 0.0)
        for each in opened:
            each.sendall(upgrade())
            assert b"101 " in each.recv(1 << 16)
            each.sendall(frame(1, OPENING.encode()))
        answered: list[socket.socket] = []
        while not over.is_set():
            readable, _, _ = select.select([each for each in opened if each not in answered], [], [], 0.001)
            for each in readable:
                assert each.recv(1 << 17)
            answered += readable
            for each in [each for each in answered if time.monotonic() > due[each]]:
                answered.remove(each)
                each.sendall(steps[numbers[each]])
                numbers[each] += 1
                due[each] = time.monotonic() + 0.0055


def test_slow_stream_is_answered_soon_beside_busy_ones(attacked: Process) -> None:
    over = threading.Event()
    with ThreadPoolExecutor(1) as threads:
        load = threads.submit(keep_busy, attacked.port, 31, over)
        delays = []
        with connect(attacked.url.replace("http", "ws") + "/stream") as stream:
            stream.send(OPENING)
            stream.recv()
            for number in range(int(10 * SECONDS)):
                begin = time.perf_counter()
                stream.send(json.dumps({"sequence": number}))
                json.loads(stream.recv())
                delays.append(time.perf_counter() - begin)
                time.sleep(0.1)
        over.set()
        load.result()
    assert sorted(delays)[len(delays) // 2] < 0.5  # `slide-bench server` holds the longest to 50 ms


def test_client_has_its_share_of_streams_and_another_still_finds_room(run_server: Callable[..., Any]) -> None:
    opening = json.dumps({"format": "slide-stream/1", "command": {"dt": 0.001, "position": [[0, 0], [0, 0]]}})
    with run_server(max_streams=8) as server, ExitStack() as stack:
        url, opened, refusal = server.url.replace("http", "ws") + "/stream", 0, None
        while refusal is None:
            try:
                stack.enter_context(connect(url)).send(opening)
                opened += 1
            except Exception as error:
                refusal = error.response  # type: ignore[attr-defined]
        assert opened == 4
        assert refusal.status_code == 429
        assert refusal.headers["Retry-After"] == "1"
        assert "4 of 8 streams are this client's" in refusal.body.decode()
        stack.enter_context(connect(url, source_address=("127.0.0.2", 0))).send(opening)


def test_clients_with_tokens_of_their_own_are_told_apart(run_server: Callable[..., Any]) -> None:
    with run_server(tokens="arm=one, page=two", max_streams=2) as server, ExitStack() as stack:
        url = server.url.replace("http", "ws") + "/stream"
        for token in ("one", "two"):
            stack.enter_context(connect(url, additional_headers={"Authorization": f"bearer {token}"}))
        for header, status in (("Bearer three", 401), ("BEARER one", 200), ("Basic one", 401), ("Bearer", 401)):
            assert server.get("/info", headers={"Authorization": header}).status_code == status


@pytest.mark.parametrize("which", ["planning", "reading"])
def test_process_killed_again_and_again_in_any_state_is_replaced(which: str, make_request: Callable[..., Any]) -> None:
    kills = 5 if SECONDS < 10 else 20
    module = {"planning": "planning.worker", "reading": "planning.reading"}[which]
    with process() as server:
        for number in range(kills):
            wait_for(
                lambda: any(module in Path(f"/proc/{c}/cmdline").read_text() for c in children(server.process.pid))
            )
            time.sleep(0.3 * (number % 4))  # at once, while it starts, and when it is ready
            for child in children(server.process.pid):
                with suppress(OSError):
                    if module in Path(f"/proc/{child}/cmdline").read_text():
                        os.kill(child, 9)
        begin = time.monotonic()
        wait_for(lambda: server.post("/plan", json=make_request()).status_code == 200)
        assert time.monotonic() - begin < 6.0
        assert server.get("/health/ready").status_code == 200
        assert server.process.poll() is None


def test_process_stopped_while_it_plans_or_reads_is_replaced(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server(deadline=0.5, hang_deadlines=1.0) as server:
        for which in ("reader", "dispatcher"):
            stopped = getattr(server.service, which).process
            os.kill(stopped, 19)
            assert server.post("/plan", json=make_request()).status_code in (503, 504)
            wait_for(lambda number=stopped: not Path(f"/proc/{number}").exists(), 6.0)
            wait_for(lambda: server.get("/health/ready").status_code == 200, 6.0)
        wait_for(lambda: server.post("/plan", json=make_request()).status_code == 200)


def test_server_without_descriptors_says_so_seldom_and_recovers(make_request: Callable[..., Any]) -> None:
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    with process(SLIDE_MAX_CONNECTIONS=400) as server, ExitStack() as stack:
        resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE, (60, most))
        connections = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port))) for _ in range(120)]
        time.sleep(SECONDS)
        for connection in connections:
            connection.close()
        wait_for(lambda: server.post("/plan", json=make_request()).status_code == 200)
        server.process.terminate()
        _, said = server.ended()
        assert "Too many open files" in said
        assert len(said.splitlines()) < 10 + SECONDS
        assert "Traceback" not in said

"""What may go wrong around a server: nothing that was taken is lost, and it answers afterwards."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from runtime.bundle import Bundle
from runtime.planner import DEFAULT_BUNDLE

SLIDE_SERVE = Path(sys.executable).with_name("slide-serve")


class Process:
    """`slide-serve` as a process of its own, on a port that was free."""

    def __init__(self, *arguments: str, output: Any = subprocess.PIPE, **settings: Any) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        given = {"SLIDE_PORT": self.port, "SLIDE_MAX_REFINE_MS": 0, **settings}
        environment = {**os.environ, **{name: str(value) for name, value in given.items()}}
        self.url = f"http://127.0.0.1:{self.port}"
        self.process = subprocess.Popen(
            [SLIDE_SERVE, *arguments], env=environment, stdout=output, stderr=output, text=True
        )

    def wait_until_ready(self) -> None:
        until = time.monotonic() + 60.0
        while time.monotonic() < until and self.process.poll() is None:
            try:
                if httpx.get(f"{self.url}/health/ready").status_code == 200:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.05)
        pytest.fail(f"the server is never ready: {self.process.poll()}")

    def ended(self) -> tuple[int, str]:
        """Return exit code and what was said on standard error."""
        _, said = self.process.communicate(timeout=30.0)
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


def assert_answers(server: Any, request: dict[str, Any]) -> None:
    assert httpx.post(f"{server.url}/plan", json=request, timeout=60.0).status_code == 200
    assert httpx.get(f"{server.url}/health/ready").status_code == 200


def test_sigterm_with_32_in_flight_finishes_them_and_ends_with_0(make_request: Callable[..., Any]) -> None:
    with process(SLIDE_DEADLINE=30) as server, ThreadPoolExecutor(32) as threads:
        clients = [httpx.Client(base_url=server.url, timeout=30.0) for _ in range(33)]
        for client in clients:  # connected, so that stopping to listen keeps none of them out
            client.get("/health/live")
        late = clients.pop()
        answers = [
            threads.submit(client.post, "/plan", json=make_request(3000, seed)) for seed, client in enumerate(clients)
        ]
        until = time.monotonic() + 10.0
        while "slide_requests_in_flight 32.0" not in late.get("/metrics").text and time.monotonic() < until:
            pass
        server.process.send_signal(signal.SIGTERM)
        begin = time.monotonic()
        statuses = []
        while server.process.poll() is None and time.monotonic() < begin + 20.0:
            try:
                statuses.append(late.post("/plan", json=make_request()).status_code)
                assert late.get("/health/live").status_code == 200
            except httpx.TransportError:
                break
        assert [answer.result().status_code for answer in answers] == [200] * 32
        assert set(statuses) <= {200, 503}
        assert 503 in statuses
        code, said = server.ended()
        assert code == 0
        assert time.monotonic() - begin < 10.0
        assert "Traceback" not in said


def test_client_gone_in_the_middle_of_its_body_costs_nothing(server: Any, make_request: Callable[..., Any]) -> None:
    body = json.dumps(make_request()).encode()
    head = f"POST /plan HTTP/1.1\r\nHost: here\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    for cut in (0, 1, len(body) // 2, len(body) - 1):
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.sendall(head.encode() + body[:cut])
    assert_answers(server, make_request())
    assert server.service.in_flight == 0


def test_client_gone_in_the_middle_of_the_answer_costs_nothing(server: Any, make_request: Callable[..., Any]) -> None:
    for request, path in ((make_request(3000), "/plan"), ({"commands": [make_request()["command"]] * 32}, "/plans")):
        body = json.dumps(request).encode()
        head = (
            f"POST {path} HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        )
        for read in (0, 100, 5000):
            with socket.create_connection(("127.0.0.1", server.port)) as connection:
                connection.sendall(head.encode() + body)
                while read > 0:
                    read -= len(connection.recv(read))
    assert_answers(server, make_request())
    assert server.service.in_flight == 0


def test_200_slow_sockets_keep_nobody_out(server: Any, make_request: Callable[..., Any]) -> None:
    connections = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(200)]
    try:
        for index, connection in enumerate(connections):
            if index % 3 == 0:
                connection.sendall(b"POST /plan HTTP/1.1\r\nHost:")
            elif index % 3 == 1:
                connection.sendall(
                    b"POST /plan HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 90\r\n\r\n{"
                )
        assert_answers(server, make_request())
    finally:
        for connection in connections:
            connection.close()


def test_slow_header_and_slow_body_are_given_up(run_server: Callable[..., Any], monkeypatch: Any) -> None:
    monkeypatch.setattr("server.protocol.HEADER_TIMEOUT", 0.3)
    with run_server(body_timeout=0.3) as server:
        assert server.raw(b"GET / HT") == b""
        assert server.raw(b"") == b""
        head = b"POST /plan HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 90\r\n\r\n{"
        assert server.raw(head).startswith(b"HTTP/1.1 408 ")


def test_decoder_that_hangs_times_out_and_the_worker_lives_on(
    run_server: Callable[..., Any], make_request: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with run_server(deadline=0.5) as server:
        threads = threading.active_count()
        decode_step, hang = Bundle.decode_step, [2.0]

        def hanging(*args: Any) -> Any:
            if hang:
                time.sleep(hang.pop())
            return decode_step(*args)

        monkeypatch.setattr(Bundle, "decode_step", hanging)
        begin = time.monotonic()
        response = httpx.post(f"{server.url}/plan", json=make_request())
        assert response.status_code == 504
        assert response.json()["type"].endswith(":deadline")
        assert time.monotonic() - begin < 1.8
        assert httpx.get(f"{server.url}/health/live").status_code == 200
        ready = httpx.get(f"{server.url}/health/ready")
        assert ready.status_code == 503
        assert ready.headers["retry-after"] == "1"
        time.sleep(2.0)
        assert_answers(server, make_request())
        assert threading.active_count() <= threads + 1


def test_onnxruntime_exception_is_a_500_and_the_next_plan_is_made(
    server: Any, make_request: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: Any) -> Any:
        raise RuntimeError("[ONNXRuntimeError] : 1 : FAIL : /secret/path")

    with monkeypatch.context() as patch:
        patch.setattr(Bundle, "decode_step", failing)
        response = httpx.post(f"{server.url}/plan", json=make_request())
    assert response.status_code == 500
    assert response.json()["type"].endswith(":failed")
    assert "secret" not in response.text
    assert_answers(server, make_request())


def test_full_disk_stops_no_plan(make_request: Callable[..., Any], tmp_path: Path) -> None:
    """All a server writes is what it says; where that fails, plans go on."""
    with open("/dev/full", "w") as full, process(output=full, TMPDIR=tmp_path / "nowhere") as server:
        assert_answers(server, make_request())
        assert httpx.post(f"{server.url}/plan", content=b"{").status_code in (400, 415)
        assert_answers(server, make_request())


def test_port_in_use_is_said_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, said = Process(SLIDE_PORT=port).ended()
    assert code == 2
    assert said == f"slide-serve: error: cannot listen on 127.0.0.1:{port}: Address already in use\n"


def test_bundle_changed_on_disk_changes_nothing_until_a_start_which_refuses_it(
    make_request: Callable[..., Any], tmp_path: Path
) -> None:
    bundle = tmp_path / "bundle"
    shutil.copytree(DEFAULT_BUNDLE, bundle)
    with process(SLIDE_MODEL=bundle) as server:
        before = httpx.get(f"{server.url}/info").json()
        plan = httpx.post(f"{server.url}/plan", json=make_request()).json()
        data = bytearray((bundle / "decoder_step.onnx").read_bytes())
        data[len(data) // 2] ^= 1
        (bundle / "decoder_step.onnx").write_bytes(data)
        assert httpx.post(f"{server.url}/plan", json=make_request()).json() == plan
        assert httpx.get(f"{server.url}/info").json() == before
    code, said = Process(SLIDE_MODEL=bundle).ended()
    assert code == 2
    assert "decoder_step.onnx: sha256 is" in said
    assert "Traceback" not in said


def test_bundle_of_another_sha256_is_refused() -> None:
    code, said = Process("--bundle-sha256", "0" * 64).ended()
    assert code == 2
    assert "it must be 000" in said


def test_queue_that_is_full_says_when_to_come_back(
    run_server: Callable[..., Any], make_request: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with run_server(max_queue=2, deadline=10.0) as server, ThreadPoolExecutor(16) as threads:
        gate, decode_step = threading.Event(), Bundle.decode_step

        def held(*args: Any) -> Any:
            gate.wait(10.0)
            return decode_step(*args)

        monkeypatch.setattr(Bundle, "decode_step", held)
        asked = [threads.submit(httpx.post, f"{server.url}/plan", json=make_request(), timeout=30) for _ in range(12)]
        time.sleep(1.0)
        assert httpx.get(f"{server.url}/health/live").status_code == 200
        gate.set()
        answers = [each.result() for each in asked]
        assert {answer.status_code for answer in answers} == {200, 503}
        assert all(answer.headers["retry-after"] == "1" for answer in answers if answer.status_code == 503)
        assert_answers(server, make_request())

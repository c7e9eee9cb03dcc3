"""Connections that are opened and left: each is closed in time, whatever it was doing, and none keeps others out."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from server.http.connections import most_connections

from ..conftest import process, wait_for

MANY = int(os.environ.get("SLIDE_ATTACKERS", "60"))
"""Connections that an attack opens; `make soak` takes 1,100."""

UPGRADE = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
KEY = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"


def upgrade(line: str = "GET /stream HTTP/1.1", headers: str = UPGRADE + KEY, body: str = "") -> bytes:
    return f"{line}\r\nHost: localhost\r\n{headers}\r\n{body}".encode()


UPGRADES = {
    "no token": upgrade(),
    "no key": upgrade(headers=UPGRADE),
    "a body that never comes": upgrade(headers=UPGRADE + KEY + "Content-Length: 10\r\n"),
    "a body in chunks": upgrade(headers=UPGRADE + KEY + "Transfer-Encoding: chunked\r\n", body="5\r\nhel"),
    "many headers": upgrade(headers=UPGRADE + KEY + "".join(f"X-{k}: 1\r\n" for k in range(140))),
    "a large header": upgrade(headers=UPGRADE + KEY + f"X: {'a' * 9000}\r\n"),
    "a large path": upgrade(line=f"GET /stream?{'a' * 9000} HTTP/1.1"),
    "a header with a space in its name": upgrade(headers=UPGRADE + KEY + "X : 1\r\n"),
    "a POST": upgrade(line="POST /stream HTTP/1.1"),
    "HTTP/1.0": upgrade(line="GET /stream HTTP/1.0"),
    "another path": upgrade(line="GET /nowhere HTTP/1.1"),
    "another version": upgrade(headers=UPGRADE.replace("13", "12") + KEY),
    "another protocol": upgrade(headers=UPGRADE.replace("websocket", "h2c") + KEY),
    "another protocol, with a body": upgrade(
        line="POST /plan HTTP/1.1", headers=UPGRADE.replace("websocket", "h2c") + "Content-Length: 5\r\n", body="{}"
    ),
    "half a header": upgrade()[:-4],
}


most_connections(MANY + 100)  # which both ends of each need a descriptor for


def opened(server: Any) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=30.0)


def all_closed(connections: list[socket.socket], seconds: float) -> bool:
    """Whether the server closes all of them within this time, whatever it says before."""
    until = time.monotonic() + seconds
    for connection in connections:
        try:
            connection.settimeout(max(0.01, until - time.monotonic()))
            while connection.recv(1 << 16):
                pass
        except TimeoutError:
            return False
        except OSError:
            pass
    return True


@pytest.mark.parametrize("kind", UPGRADES)
def test_upgrade_that_goes_nowhere_is_closed(run_server: Any, limited_server: Any, kind: str) -> None:
    connections = [opened(limited_server) for _ in range(5)]
    for connection in connections:
        connection.sendall(UPGRADES[kind])
    assert all_closed(connections, 10.0)
    wait_for(lambda: limited_server.get("/health/live").status_code == 200)


@pytest.fixture(scope="module")
def limited_server(run_server: Callable[..., Any]) -> Any:
    with run_server(token="a token", header_timeout=1.0, body_timeout=1.0, max_connections=40) as server:
        yield server


def test_dead_upgrades_by_the_hundred_keep_nobody_out(limited_server: Any) -> None:
    with ExitStack() as stack:
        connections = []
        for number in range(MANY):
            connections.append(stack.enter_context(opened(limited_server)))
            connections[-1].sendall([*UPGRADES.values()][number % len(UPGRADES)])
            if number % 10 == 0:
                assert limited_server.get("/health/ready").status_code == 200
        assert limited_server.get("/health/ready").status_code == 200
        assert all_closed(connections, 10.0)


def test_connections_that_only_wait_make_room_for_others(limited_server: Any) -> None:
    with ExitStack() as stack:
        connections = [stack.enter_context(opened(limited_server)) for _ in range(MANY)]
        assert limited_server.get("/health/ready").status_code == 200
        assert all_closed(connections, 10.0)


def test_request_whose_trailers_never_end_is_given_up(limited_server: Any) -> None:
    head = (
        b"POST /plan HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer a token\r\nContent-Type: application/json\r\n"
    )
    with opened(limited_server) as connection:
        connection.sendall(head + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n")
        begin = time.monotonic()
        try:
            while time.monotonic() - begin < 10.0:
                connection.sendall(b"X: " + b"a" * 1000 + b"\r\n")
                time.sleep(0.001)
        except OSError:
            pass
        assert time.monotonic() - begin < 9.0


def test_more_requests_in_one_piece_than_can_wait_are_given_up(limited_server: Any) -> None:
    with opened(limited_server) as connection:
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n" * 5000)
        assert all_closed([connection], 10.0)
    assert limited_server.get("/health/live").status_code == 200


def test_a_few_requests_in_one_piece_are_answered(limited_server: Any) -> None:
    with opened(limited_server) as connection:
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n" * 8)
        answers = b""
        while answers.count(b"200 OK") < 8:
            more = connection.recv(1 << 16)
            assert more, f"closed after {answers.count(b'200 OK')} answers"
            answers += more


def frame(opcode: int, data: bytes = b"", final: bool = True) -> bytes:
    """Return a frame as a client sends it, masked with zeros."""
    size = struct.pack("!B", 0x80 | len(data)) if len(data) < 126 else struct.pack("!BH", 0x80 | 126, len(data))
    return bytes([(0x80 if final else 0) | opcode]) + size + bytes(4) + data


OPENING = json.dumps({"format": "slide-stream/1", "command": {"dt": 0.001, "position": [[0, 0], [0, 0]]}}).encode()

FRAMES = {
    "pings": frame(9, b"x"),
    "empty fragments": frame(0, b"", final=False),
    "tiny fragments": frame(0, b"{", final=False),
    "empty messages": frame(1),
    "pongs": frame(10),
}


@pytest.mark.parametrize("kind", FRAMES)
def test_frames_by_the_thousand_are_given_up_and_stop_nobody(run_server: Any, server: Any, kind: str) -> None:
    with opened(server) as connection:
        connection.sendall(upgrade())
        assert b"101 " in connection.recv(1 << 16)
        connection.sendall(frame(1, OPENING))
        assert connection.recv(1 << 16)
        if "fragments" in kind:
            connection.sendall(frame(1, b"{", final=False))
        worst, until, ended = 0.0, time.monotonic() + 5.0, False
        connection.setblocking(False)
        while time.monotonic() < until and not ended:
            try:
                connection.send(FRAMES[kind] * 2000)
            except BlockingIOError:
                pass
            except OSError:
                ended = True
            begin = time.perf_counter()
            assert server.get("/health/live").status_code == 200
            worst = max(worst, time.perf_counter() - begin)
        assert worst < 0.5  # `slide-bench server` holds it to 50 ms on a quiet machine
        assert ended or kind == "pongs"


def test_pongs_that_are_not_read_are_not_heaped_up(run_server: Callable[..., Any]) -> None:
    with run_server(write_timeout=1.0) as server, opened(server) as connection:
        connection.sendall(upgrade())
        assert b"101 " in connection.recv(1 << 16)
        connection.sendall(frame(1, OPENING))
        connection.settimeout(8.0)
        pings = frame(9, b"x" * 125) * 30 + frame(1, b'{"sequence": 0}')
        with suppress(OSError):
            while True:
                connection.sendall(pings)
        wait_for(lambda: server.service.streams == 0)


STATES = {
    "nothing": b"",
    "half a header": b"GET / HT",
    "half a body": b"POST /plan HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    b"Content-Length: 9\r\n\r\n{",
    "an idle connection": b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "an upgrade": upgrade(),
    "a dead upgrade": UPGRADES["a body that never comes"],
    "a stream": upgrade() + frame(1, OPENING),
    "an answer that is not read": b"GET /viewer/viewer.js HTTP/1.1\r\nHost: localhost\r\n\r\n" * 15,
}


def test_sigterm_ends_with_0_within_10_s_whatever_is_open(make_request: Callable[..., Any]) -> None:
    with process() as server, ExitStack() as stack:
        for data in STATES.values():
            for _ in range(3):
                stack.enter_context(opened(server)).sendall(data)
        streams = [connect(server.url.replace("http", "ws") + "/stream").__enter__() for _ in range(2)]
        streams[0].send(OPENING.decode())
        body = json.dumps({"commands": [{"t": [0, 19.9], "position": [[0, 0], [0.1, 0]]}] * 40}).encode()
        head = (
            f"POST /plans HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {len(body)}"
        )
        stack.enter_context(opened(server)).sendall(head.encode() + b"\r\n\r\n" + body)
        time.sleep(0.5)
        begin = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        code, said = server.ended()
        assert code == 0
        assert time.monotonic() - begin < 10.0
        assert "Traceback" not in said
        for stream in streams:
            with suppress(ConnectionClosed):
                while True:
                    stream.recv(timeout=5.0)

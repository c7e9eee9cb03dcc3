"""Who is let in, and what is said of it afterwards."""

from __future__ import annotations

import base64
import json
import signal
import socket
from collections.abc import Callable
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from runtime.errors import plain

from ..conftest import process


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost", 200),
        ("LOCALHOST:8000", 200),
        ("127.0.0.1", 200),
        ("192.0.2.7:80", 200),
        ("[::1]:8000", 200),
        ("elsewhere.example", 421),
        ("localhost.elsewhere.example", 421),
        ("127.0.0.1.elsewhere.example", 421),
        ("", 421),
        ("local host", 421),
    ],
)
def test_server_answers_to_addresses_and_its_own_names_only(server: Any, host: str, status: int) -> None:
    for path in ("/", "/info", "/openapi.json"):
        assert server.get(path, headers={"Host": host}).status_code == status
    assert server.get("/health/live", headers={"Host": host}).status_code == 200
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        lines = ["GET /stream HTTP/1.1", f"Host: {host}", "Connection: Upgrade", "Upgrade: websocket"]
        lines += ["Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", ""]
        connection.sendall("\r\n".join(lines).encode())
        assert connection.recv(100).startswith(b"HTTP/1.1 101 " if status == 200 else b"HTTP/1.1 421 ")


def test_request_without_a_host_or_with_two_is_refused(server: Any) -> None:
    assert server.raw(b"GET / HTTP/1.1\r\n\r\n").startswith(b"HTTP/1.1 400 ")
    assert server.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: other\r\n\r\n").startswith(b"HTTP/1.1 400 ")
    assert server.raw(b"GET / HTTP/1.0\r\n\r\n").startswith(b"HTTP/1.1 200 ")


def test_names_that_the_server_was_told_are_its_own(run_server: Callable[..., Any]) -> None:
    with run_server(hosts="slide.example.com, slide") as server:
        for host, status in (("slide.example.com", 200), ("Slide:80", 200), ("example.com", 421)):
            assert server.get("/", headers={"Host": host}).status_code == status


@pytest.mark.parametrize("origin", ["http://elsewhere", "null", "http://[", "http://[::1", "", "//", "http://\u00e9"])
def test_any_origin_but_the_servers_own_is_refused(server: Any, origin: str) -> None:
    with pytest.raises(InvalidStatus) as caught:
        connect(server.url.replace("http", "ws") + "/stream", additional_headers={"Origin": origin}).__enter__()
    assert caught.value.response.status_code == 403


def test_figures_have_a_port_of_their_own_that_needs_no_token_and_gives_nothing_else() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with process(SLIDE_TOKEN="canary", SLIDE_METRICS_PORT=port) as server:
        assert server.get("/metrics").status_code == 401
        server.url = f"http://127.0.0.1:{port}"
        assert "slide_queue_depth 0.0" in server.get("/metrics").text
        assert server.get("/health/ready").status_code == 200
        for path in ("/", "/info", "/openapi.json"):
            assert server.get(path).status_code == 404
        assert server.post("/plan", json={}).status_code == 404
        with pytest.raises(InvalidStatus):
            connect(server.url.replace("http", "ws") + "/stream").__enter__()


def test_request_has_one_name_in_answer_timing_and_problem(server: Any, make_request: Callable[..., Any]) -> None:
    answer = server.post("/plan", json=make_request(), headers={"X-Request-ID": "mine-1"})
    assert answer.headers["x-request-id"] == "mine-1"
    assert 'request;desc="mine-1"' in answer.headers["server-timing"]
    problem = server.post("/plan", json={}, headers={"X-Request-ID": "mine-2"})
    assert problem.json()["request"] == problem.headers["x-request-id"] == "mine-2"
    for bad in ("a b", "<script>", "x" * 65, "\u00e9"):
        given = server.get("/health/live", headers={"X-Request-ID": bad.encode()}).headers["x-request-id"]
        assert len(given) == 16


@pytest.mark.parametrize("form", ["text", "json"])
def test_log_names_requests_and_shows_no_token_and_no_escape(form: str) -> None:
    with process(SLIDE_LOG=form, SLIDE_LOG_REQUESTS="true", SLIDE_TOKENS="arm=canary") as server:
        path = "/\x1b[31mred%1b%0aforged?token=canary"
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.sendall(b"GET " + path.replace("\x1b", "%1b").encode() + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"404" in connection.recv(1000)
        headers = {"Authorization": "Bearer canary", "X-Request-ID": "mine-3"}
        assert server.post("/plan", json={}, headers=headers).status_code == 422
        server.process.send_signal(signal.SIGTERM)
        _, said = server.ended()
    assert "canary" not in said
    assert "\x1b" not in said
    assert all(line.startswith("slide-serve: " if form == "text" else "{") for line in said.splitlines())
    if form == "json":
        (line,) = (each for each in map(json.loads, said.splitlines()) if each.get("request") == "mine-3")
        assert (line["path"], line["status"], line["client"]) == ("/plan", 422, "arm")
    else:
        assert "POST /plan 422 in " in said
        assert "for arm [request mine-3]" in said


def test_what_is_printed_of_files_and_replies_moves_no_cursor() -> None:
    assert plain("a\x1b[2Jb\u202ec\r\x07") == "a\\x1b[2Jb\\u202ec\\r\\x07"
    assert plain("µ “fine”") == "µ “fine”"


def named(token: bytes) -> str:
    return "bearer." + base64.urlsafe_b64encode(token).decode().rstrip("=")


def test_a_token_may_be_named_as_a_subprotocol_which_is_not_repeated(run_server: Callable[..., Any]) -> None:
    with run_server(tokens="page=s\u00e9cret/1") as server:
        url = server.url.replace("http", "ws") + "/stream"
        with connect(
            url, subprotocols=[Subprotocol("slide-stream"), Subprotocol(named("s\u00e9cret/1".encode()))]
        ) as it:
            assert it.subprotocol == "slide-stream"
            assert it.response is not None
            assert "bearer" not in str(it.response.headers)
        for wrong in (named(b"secret"), named(b""), "bearer.", "bearer.!", "Bearer.c2Vj"):
            status = handshake(server, f"slide-stream, {wrong}")
            assert status == 401, wrong
        assert (
            server.get("/info", headers={"Sec-WebSocket-Protocol": named("s\u00e9cret/1".encode())}).status_code == 401
        )


def handshake(server: Any, subprotocols: str) -> int:
    lines = ["GET /stream HTTP/1.1", f"Host: 127.0.0.1:{server.port}", "Connection: Upgrade", "Upgrade: websocket"]
    lines += ["Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="]
    answer = server.raw("\r\n".join([*lines, f"Sec-WebSocket-Protocol: {subprotocols}", "", ""]).encode())
    return int(answer.split(b" ")[1])

"""Requests that no client of ours sends: each is answered in time, costs little, and is felt by nobody else."""

from __future__ import annotations

import io
import json
import socket
import struct
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .http.test_bad_requests import post
from .http.test_connections import OPENING, all_closed, frame, opened, upgrade

HOST = b"Host: localhost\r\n"
JSON = b"Content-Type: application/json\r\n"
BODY = b'{"command": {"dt": 0.001, "position": [[0, 0], [0, 0]]}}'


def get(target: bytes, headers: bytes = b"") -> bytes:
    return b"GET " + target + b" HTTP/1.1\r\n" + HOST + headers + b"\r\n"


def send(headers: bytes, body: bytes = BODY) -> bytes:
    return b"POST /plan HTTP/1.1\r\n" + HOST + JSON + headers + b"\r\n" + body


LENGTH = b"Content-Length: %d\r\n" % len(BODY)
BINARY = "Content-Type: application/octet-stream\r\n"
CHUNKS = b"Transfer-Encoding: chunked\r\n"
CHUNKED = b"%x\r\n%s\r\n0\r\n\r\n" % (len(BODY), BODY)

REQUESTS = {
    "Expect, and a body that is not wanted": (
        send(b"Content-Encoding: gzip\r\nContent-Length: 99\r\nExpect: 100-continue\r\n", b""),
        415,
    ),
    "an address of its own": (get(b"http://localhost/health/live"), 200),
    "an address of another server": (get(b"http://elsewhere.example/info"), 400),
    "an address behind a user": (get(b"http://localhost@elsewhere.example/info"), 400),
    "a tunnel": (b"CONNECT elsewhere.example:443 HTTP/1.1\r\n" + HOST + b"\r\n", 400),
    "OPTIONS *": (b"OPTIONS * HTTP/1.1\r\n" + HOST + b"\r\n", 405),
    "TRACE": (b"TRACE / HTTP/1.1\r\n" + HOST + b"\r\n", 405),
    "the length twice": (send(LENGTH * 2), 400),
    "a list of lengths": (send(b"Content-Length: 2, 2\r\n", b"{}"), 400),
    "a length with a plus": (send(b"Content-Length: +2\r\n", b"{}"), 400),
    "a length and chunks": (send(LENGTH + CHUNKS, CHUNKED), 400),
    "chunks in chunks": (send(b"Transfer-Encoding: chunked, chunked\r\n", CHUNKED), 400),
    "chunks, then as it is": (send(b"Transfer-Encoding: chunked, identity\r\n", CHUNKED), 400),
    "a coding nobody knows": (send(b"Transfer-Encoding: xchunked\r\n", CHUNKED), 400),
    "a length in a trailer": (send(CHUNKS, CHUNKED[:-2] + b"Content-Length: 9\r\n\r\n"), 400),
    "a chunk with a megabyte of extensions": (
        send(CHUNKS, CHUNKED.replace(b"\r\n", b";" + b"a" * 1_000_000 + b"\r\n", 1)),
        200,
    ),
    "lines that end too soon": (b"GET /health/live HTTP/1.1\nHost: localhost\n\n", 400),
    "a header on two lines": (get(b"/health/live", b"X: a\r\n b\r\n"), 400),
    "a zero in a header": (get(b"/health/live", b"X: a\0b\r\n"), 400),
    "HTTP/2": (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 400),
    "a query of 28 kB": (
        b"POST /command?" + b"a=b&" * 7000 + b" HTTP/1.1\r\n" + HOST + b"Content-Length: 0\r\n\r\n",
        422,
    ),
    "60,000 names": (post(b"{" + b",".join(b'"n%d": 1' % each for each in range(60_000)) + b"}"), 422),
    "a number of a million digits": (post(b'{"command": {"dt": ' + b"1" * 1_000_000 + b"}}"), 400),
    "a whole number of 100,000 digits": (post(b'{"candidates": ' + b"9" * 100_000 + b"}"), 400),
    "2,500 ranges": (
        get(b"/index.html", b"Range: bytes=" + b",".join(b"%d-" % each for each in range(2500)) + b"\r\n"),
        200,
    ),
}


@pytest.mark.parametrize("kind", REQUESTS)
def test_odd_request_is_answered_at_once(server: Any, kind: str) -> None:
    data, status = REQUESTS[kind]
    begin = time.monotonic()
    answer = server.raw(data)
    assert answer.startswith(b"HTTP/1.1 %d " % status), answer[:300]
    assert time.monotonic() - begin < 5.0


def test_body_is_asked_for_and_read(server: Any) -> None:
    with opened(server) as connection:
        connection.sendall(send(LENGTH + b"Expect: 100-continue\r\n", b""))
        assert connection.recv(1 << 16) == b"HTTP/1.1 100 Continue\r\n\r\n"
        connection.sendall(BODY)
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200 ")


def test_what_comes_behind_a_doubtful_length_is_no_request(server: Any) -> None:
    """A proxy that reads the length otherwise must not be led to take a body's rest for a request."""
    hidden = b"GET /health/live HTTP/1.1\r\n" + HOST + b"\r\n"
    with opened(server) as connection:
        connection.sendall(send(LENGTH + CHUNKS, CHUNKED + hidden))
        answers = b""
        with suppress(OSError):
            while part := connection.recv(1 << 16):
                answers += part
    assert answers.count(b"HTTP/1.1 ") == 1


def unpacking(size: int) -> bytes:
    """Return an npz file of so many zeros."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("position.npy", "w") as file:
        np.lib.format.write_array(file, np.zeros((size // 2, 2)))
    return made.getvalue()


SVG = b"<svg xmlns='http://www.w3.org/2000/svg'>"
ENTITIES = b"".join(b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9))

FILES = {
    "a header of 400,000 names": b",".join([b"x"] * 200_000) + b"\n1\n",
    "400,000 columns": b"0 " * 400_000,
    "entities in entities": b'<!DOCTYPE s [<!ENTITY a "aaaaaaaaaa">'
    + ENTITIES
    + b"]>"
    + SVG
    + b"<path d='&j;'/></svg>",
    "a file of this machine": b"<!DOCTYPE s [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>"
    + SVG
    + b"<text>&a;</text></svg>",
    "groups in groups": SVG + b"<g>" * 100_000,
    "50,000 transforms": SVG + b"<path transform='" + b"scale(2) " * 50_000 + b"' d='M0 0L1 1'/></svg>",
    "arcs of 1e300": SVG + b"<path d='M0 0 " + b"A1e300 1e300 0 1 1 1e-300 5 " * 20_000 + b"'/></svg>",
    "curves without end": SVG + b"<path d='M0 0" + b"c1 1 1 1 1 1" * 70_000 + b"'/></svg>",
    "zeros of 160 MB": unpacking(20_000_000),
    "an array of a terabyte": b"\x93NUMPY\x01\x00v\x00"
    + b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 2), }".ljust(117)
    + b"\n",
    "an array of objects": b"\x93NUMPY\x01\x00v\x00"
    + b"{'descr': '|O', 'fortran_order': False, 'shape': (2, 2), }".ljust(117)
    + b"\ncos\nsystem\n(S'false'\ntR.",
    "200,000 lists in one another": b"[" * 200_000,
    "no zip": b"PK\x03\x04" + bytes(1000),
}


@pytest.mark.parametrize("kind", FILES)
def test_hostile_file_is_refused_in_time_and_memory_and_holds_up_nobody(
    server: Any, make_request: Callable[..., Any], kind: str
) -> None:
    reading = server.service.reader.process
    before = resident(reading)
    with opened(server) as connection:
        connection.sendall(post(FILES[kind], "/command", BINARY))
        assert server.post("/plan", json=make_request()).status_code == 200
        connection.settimeout(60.0)
        answer = connection.recv(1 << 16)
    assert answer.startswith((b"HTTP/1.1 422 ", b"HTTP/1.1 504 ")), answer[:300]
    assert server.service.reader.process == reading
    assert resident(reading) < before + (16 << 20)


def resident(process: int) -> int:
    """Return what a process holds (bytes)."""
    return int(Path(f"/proc/{process}/status").read_text().partition("VmRSS:")[2].split()[0]) << 10


FRAMES = {
    "compressed, which was not agreed on": bytes([0xC1, 0x85, 0, 0, 0, 0]) + b"\x00" * 5,
    "without a mask": bytes([0x81, 5]) + b"hello",
    "of 2^62 bytes": bytes([0x81, 0xFF]) + struct.pack("!Q", 1 << 62) + bytes(4),
    "of a kind nobody knows": frame(3, b"x"),
    "a ping in two parts": frame(9, b"x", final=False),
    "a ping of 200 bytes": frame(9, b"x" * 200),
    "a close with no code": frame(8, b"\x03"),
    "words that are no UTF-8": frame(1, b"\xff\xfe"),
    "the rest of nothing": frame(0, b"x"),
}


@pytest.mark.parametrize("kind", FRAMES)
@pytest.mark.parametrize("open_first", [False, True], ids=["first", "in a stream"])
def test_frame_that_is_none_ends_the_stream(server: Any, kind: str, open_first: bool) -> None:
    with opened(server) as connection:
        connection.sendall(upgrade(headers=UPGRADE_WITH_COMPRESSION))
        answer = connection.recv(1 << 16)
        assert b"101 " in answer
        assert b"permessage-deflate" not in answer  # a few bytes would unfold to gigabytes
        if open_first:
            connection.sendall(frame(1, OPENING))
            assert connection.recv(1 << 16)
        connection.sendall(FRAMES[kind])
        assert all_closed([connection], 10.0)


UPGRADE_WITH_COMPRESSION = (
    "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    "Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits\r\n"
)


def test_message_that_comes_a_byte_at_a_time_is_given_up(run_server: Callable[..., Any]) -> None:
    with run_server(stream_idle=1.0) as server, opened(server) as connection:
        connection.sendall(upgrade())
        assert b"101 " in connection.recv(1 << 16)
        begin = time.monotonic()
        with suppress(OSError):
            for byte in frame(1, OPENING)[:-1]:
                connection.sendall(bytes([byte]))
                time.sleep(0.1)
        assert time.monotonic() - begin < 5.0
        assert all_closed([connection], 5.0)


def test_requests_by_the_thousand_without_a_body_keep_nobody_waiting(server: Any) -> None:
    """HEAD, OPTIONS and what else is cheap, as fast as they are answered, over connections that may be closed on us."""
    request = b"HEAD / HTTP/1.1\r\n" + HOST + b"\r\n" + b"OPTIONS /plan HTTP/1.1\r\n" + HOST + b"\r\n"
    until, worst, answered = time.monotonic() + 2.0, 0.0, 0
    while time.monotonic() < until:
        with suppress(ConnectionError), opened(server) as connection:
            connection.setblocking(False)
            rest = request
            while time.monotonic() < until:
                with suppress(BlockingIOError):
                    rest = rest[connection.send(rest) :] or request  # it takes part of one when it is full
                with suppress(BlockingIOError):
                    answered += connection.recv(1 << 16).count(b"HTTP/1.1 ")
                begin = time.perf_counter()
                assert server.get("/health/live").status_code == 200
                worst = max(worst, time.perf_counter() - begin)
    assert answered > 100
    assert worst < 0.5


def test_file_that_takes_too_long_does_not_hold_up_another(server: Any) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.sendall(post(FILES["50,000 transforms"], "/command", BINARY))
        table = b"t,x,y\n" + b"".join(b"%g,%g,0\n" % (0.01 * k, 0.0001 * k) for k in range(100))
        answer = server.post("/command", content=table, headers={"Content-Type": "application/octet-stream"})
        assert answer.status_code == 200
        assert json.loads(answer.content)["command"]["dt"] == 0.001

"""What a stranger may send: each gets the status that says what is wrong, in few bytes, and nothing of it back."""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import httpx
import pytest

MARK = "secret-canary"
"""Stands in what is sent, and must not stand in what comes back."""

MOVE = [[0.001 * k * k / 100, 0.0] for k in range(10)]
GOOD = {"command": {"dt": 0.001, "position": MOVE}}


def post(body: bytes | str, path: str = "/plan", head: str = "", length: int | None = None) -> bytes:
    """Return a request's bytes as a client would send them; a content type in `head` replaces the usual one."""
    data = body.encode("utf-8", "surrogatepass") if isinstance(body, str) else body
    size = len(data) if length is None else length
    kind = "" if "content-type" in head.lower() else "Content-Type: application/json\r\n"
    lines = f"POST {path} HTTP/1.1\r\nHost: localhost\r\n{kind}Content-Length: {size}\r\n{head}\r\n"
    return lines.encode("latin-1") + data


def plan(**changes: Any) -> bytes:
    """Return a request for a plan with these parts instead; `...` leaves one out."""
    return post(json.dumps({name: value for name, value in {**GOOD, **changes}.items() if value is not ...}))


def command(**changes: Any) -> bytes:
    parts = {**GOOD["command"], **changes}
    return plan(command={name: value for name, value in parts.items() if value is not ...})


def text(position: str, dt: str = "0.001") -> bytes:
    """Return a request with these bits of JSON as they are."""
    return post(f'{{"command": {{"dt": {dt}, "position": {position}}}}}')


def chunked(data: bytes, ending: bytes = b"0\r\n\r\n") -> bytes:
    head = b"POST /plan HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    head += b"Transfer-Encoding: chunked\r\n\r\n"
    return head + b"%x\r\n%s\r\n" % (len(data), data) + ending


BIG = b"[" + b"1," * (1 << 20) + b"1]"

TABLE = [
    # no JSON
    ("nothing", post(""), 400),
    ("words", post(MARK), 400),
    ("half a document", post('{"command": {"dt": 0.001, "position": [[0, 0], '), 400),
    ("two documents", post('{"command": 1} {"command": 2}'), 400),
    ("a comma too many", text("[[0, 0], [0, 0],]"), 400),
    ("single quotes", post("{'command': 1}"), 400),
    ("a comment", post('{"command": 1 /* here */}'), 400),
    ("utf-16", post(json.dumps(GOOD).encode("utf-16")), 400),
    ("a byte order mark", post(b"\xef\xbb\xbf" + json.dumps(GOOD).encode()), 400),
    ("broken utf-8", post(b'{"\xff\xfe": 1}'), 400),
    ("a zero byte", post(b'{"command": \x00}'), 400),
    ("100,000 brackets", post("[" * 100_000), 400),
    ("100,000 objects in one another", post('{"command":' * 50_000 + "1" + "}" * 50_000), 422),
    ("deep where a number is wanted", text("[[0, " + "[" * 5000 + "]" * 5000 + "]]"), 400),
    ("a name given twice", post('{"command": {"dt": 0.001, "dt": 0.001, "position": [[0, 0], [0, 0]]}}'), 400),
    ("a name given twice, once escaped", text("[[0, 0], [0, 0]]", '1, "d\\u0074": 0.001'), 400),
    ("a lone surrogate as a name", post('{"\\ud800": 1}'), 400),
    ("a lone surrogate as a value", post('{"command": "\\ud800"}'), 400),
    ("a raw surrogate", post('{"command": "\ud800"}'), 400),
    ("an octal number", text("[[0, 0], [0, 007]]"), 400),
    ("a hexadecimal number", text("[[0, 0], [0, 0x10]]"), 400),
    ("a number with a plus", text("[[0, 0], [0, +1]]"), 400),
    # numbers that are none
    ("NaN", text("[[0, 0], [NaN, 0]]"), 422),
    ("Infinity", text("[[0, 0], [0, Infinity]]"), 422),
    ("minus Infinity", text("[[0, 0], [0, -Infinity]]"), 422),
    ("1e999", text("[[0, 0], [0, 1e999]]"), 422),
    ("-1e999", text("[[0, 0], [-1e999, 0]]"), 422),
    ("a thousand digits", text(f"[[0, 0], [0, {'9' * 1000}]]"), 422),
    ("true", text("[[0, 0], [0, true]]"), 422),
    ("null", text("[[0, 0], [0, null]]"), 422),
    ("a number as a string", text('[[0, 0], [0, "1"]]'), 422),
    ("NaN as a string", text('[[0, 0], [0, "NaN"]]'), 422),
    ("an object as a number", text("[[0, 0], [0, {}]]"), 422),
    # other shapes
    ("a list", post("[]"), 422),
    ("a number", post("1"), 422),
    ("null for all", post("null"), 422),
    ("no command", plan(command=...), 422),
    ("a string for a command", plan(command=MARK), 422),
    ("a name nobody knows", plan(**{MARK: 1}), 422),
    ("a name nobody knows, in the command", command(**{MARK: 1}), 422),
    ("no position", command(position=...), 422),
    ("no positions", command(position=[]), 422),
    ("one position", command(position=[[0, 0]]), 422),
    ("three coordinates", command(position=[[0, 0, 0], [0, 0, 0]]), 422),
    ("one coordinate", command(position=[[0], [0]]), 422),
    ("flat positions", command(position=[0, 0, 0, 0]), 422),
    ("positions as an object", command(position={"0": [0, 0]}), 422),
    ("neither dt nor t", command(dt=...), 422),
    ("both dt and t", command(t=[0.0, 1.0]), 422),
    ("dt of zero", command(dt=0), 422),
    ("dt below zero", command(dt=-0.001), 422),
    ("dt of true", command(dt=True), 422),
    ("dt too large", command(dt=1e6), 422),
    ("t too short", command(dt=..., t=[0.0, 1.0]), 422),
    ("t of one", command(dt=..., t=[0.0]), 422),
    ("t that goes back", command(dt=..., t=[0.0, 0.2, 0.1], position=[[0, 0]] * 3), 422),
    ("t that stands still", command(dt=..., t=[0.0, 0.0], position=[[0, 0]] * 2), 422),
    ("ten minutes in a few bytes", command(dt=..., t=[0.0, 600.0], position=[[0, 0]] * 2), 422),
    ("1e308 s in a few bytes", command(dt=..., t=[-1e308, 1e308], position=[[0, 0]] * 2), 422),
    ("a microsecond", command(dt=..., t=[0.0, 1e-6], position=[[0, 0]] * 2), 422),
    ("a jump of a metre", command(position=[[0, 0], [1, 0]]), 422),
    ("kilometres", command(position=[[1000, 0], [1000, 0]]), 422),
    ("1e308", command(position=[[1e308, 0], [-1e308, 0]]), 422),
    # options
    ("friction as a list", plan(friction=[1.0, 0.5]), 422),
    ("half a friction", plan(friction={"static": 1.0}), 422),
    ("kinetic above static", plan(friction={"static": 0.3, "kinetic": 0.5}), 422),
    ("friction below zero", plan(friction={"static": -1.0, "kinetic": -2.0}), 422),
    ("a limit of zero", plan(limits={"jerk": 0}), 422),
    ("a limit nobody knows", plan(limits={MARK: 1}), 422),
    ("a start out of reach", plan(start={"pan_position": [5.0, 0.0]}), 422),
    ("a start too fast to stop", plan(start={"pan_velocity": [50.0, 0.0]}), 422),
    ("a start of four", plan(start={"pan_position": [0, 0, 0, 0]}), 422),
    ("a level pan that begins above its plane", plan(start={"pan_position": [0, 0, 0.1]}), 422),
    ("an object above the pan", plan(start={"object_position": [0, 0, 0]}), 422),
    ("a height below zero", plan(limits={"height": -0.1}), 422),
    ("a speed of zero", plan(limits={"speed": 0}), 422),
    ("a refinement of an hour", plan(refine_ms=3.6e6), 422),
    ("a refinement below zero", plan(refine_ms=-1), 422),
    ("a tolerance of zero", plan(tolerance=0), 422),
    # /plans
    ("no commands", post('{"commands": []}', "/plans"), 422),
    ("commands as an object", post('{"commands": {}}', "/plans"), 422),
    ("too many commands", post(json.dumps({"commands": [GOOD["command"]] * 65}), "/plans"), 422),
    ("one command of many is bad", post(json.dumps({"commands": [GOOD["command"], {"dt": 1}]}), "/plans"), 422),
    ("a command twice in /plans", post(json.dumps({"commands": [], "commands ": []}), "/plans"), 422),
    # size and shape of the request
    ("2 MiB", post(BIG), 413),
    ("2 MiB in chunks", chunked(BIG), 413),
    ("a petabyte declared", post("", length=1 << 50), 413),
    ("a length of 400 digits", post("", head="", length=int("9" * 400)), 400),
    ("no content type", post("{}", head="Content-Type:\r\n"), 415),
    ("a form", post("a=1", head="Content-Type: application/x-www-form-urlencoded\r\n"), 415),
    ("text", post(json.dumps(GOOD), head="Content-Type: text/plain\r\n"), 415),
    ("another charset", post("{}", head="Content-Type: application/json; charset=utf-16\r\n"), 415),
    ("compressed", post(b"\x1f\x8b", head="Content-Encoding: gzip\r\n"), 415),
    ("wants a picture", post(json.dumps(GOOD), head="Accept: image/png\r\n"), 406),
    ("wants nothing", post(json.dumps(GOOD), head="Accept: */*;q=0\r\n"), 406),
    # paths and methods
    ("GET /plan", b"GET /plan HTTP/1.1\r\nHost: localhost\r\n\r\n", 405),
    ("PUT /plans", b"PUT /plans HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n", 405),
    ("POST to the page", post("{}", "/"), 405),
    ("POST to the health", post("{}", "/health/live"), 405),
    ("an unknown path", b"GET /secret-canary HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
    ("out of the folder", b"GET /../settings.py HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
    ("out of the folder, escaped", b"GET /%2e%2e/%2e%2e/pyproject.toml HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
    ("a path with a zero", b"GET /a%00b HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
    ("a path of 5,000 letters", b"GET /" + b"a" * 5000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
    ("a header of 64 KiB", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * (1 << 16) + b"\r\n\r\n", 431),
    ("no HTTP", b"secret-canary\r\n\r\n", 400),
    ("TLS", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(64), 400),
    ("two lengths", b"POST /plan HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n{}", 400),
    ("a broken chunk", chunked(b"{}", b"secret-canary\r\n"), 400),
]


@pytest.mark.parametrize(("request_bytes", "status"), [row[1:] for row in TABLE], ids=[row[0] for row in TABLE])
def test_bad_request_gets_its_status_and_nothing_of_it_back(server: Any, request_bytes: bytes, status: int) -> None:
    answer = server.raw(request_bytes)
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 %d " % status), answer[:300]
    assert len(answer) < 4096
    assert MARK.encode() not in answer
    assert b"Traceback" not in answer
    assert b"/server/" not in answer
    document = json.loads(body)
    assert b"application/problem+json" in head
    assert document["status"] == status
    assert document["type"].startswith("urn:slide-planner:problem:")
    assert document["title"]
    if status == 405:
        assert b"\r\nallow: " in head.lower()


def test_problem_says_the_place_of_the_fault(server: Any) -> None:
    def place(**changes: Any) -> tuple[str | None, str]:
        problem = server.post("/plan", json={**GOOD, **changes}).json()
        return problem.get("place"), problem["detail"]

    assert place(command={"dt": 0.001, "position": [[0, 0], [0, "1"]]})[0] == "command.position[1][1]"
    assert place(friction={"static": 0.3, "kinetic": 0.5})[0] == "friction"
    assert place(friction={"static": 30.0, "kinetic": 0.5})[0] == "friction.static"
    assert place(limits={"jerk": 1e-9})[0] == "limits.jerk"
    assert place(start={"pan_position": [5.0, 0.0]})[0] == "start"
    assert place(start={"pan_position": [0.0, 1e9]})[0] == "start.pan_position"
    assert place(refine_ms=3.6e6)[0] == "refine_ms"
    assert place(candidates=200)[0] == "candidates"
    assert place(candidates=1.5)[0] == "candidates"
    assert place(robust=1.0)[0] == "robust"
    assert place(sizes={"pan_radius": 99.0})[0] == "sizes.pan_radius"
    assert place(sizes={"object_radius": 0.18})[0] == "sizes.object_radius"
    assert place(command={"t": [0.0, 0.2, 0.1], "position": [[0, 0]] * 3})[0] == "command.t[2]"
    many = server.post("/plans", json={"commands": [GOOD["command"], {"dt": 0.001, "position": [[0, 0], [0, 1000]]}]})
    assert many.json()["place"] == "commands[1].position[1][1]"
    where, detail = place(command={"dt": 0.001, "position": [[0, 0], [0, 0], [0.3, 0]]})
    assert where == "command.position[2]"
    assert "jumps by 0.3 m from waypoint 1 at 0.001 s to waypoint 2 at 0.002 s" in detail
    where, detail = place(command={"dt": 0.01, "position": [[0, 0], [0, 50], [50, 0]]})
    assert where == "command.position[1][1]"
    assert "are these millimetres (--scale 0.001)?" in detail
    where, detail = place(command={"t": [0, 500, 1000], "position": [[0, 0], [0.05, 0], [0.1, 0]]})
    assert where == "command.t"
    assert "are these milliseconds? --time-scale 0.001 makes them seconds" in detail
    assert place(command={"dt": 0.01, "rate": 100, "position": [[0, 0], [0, 0]]})[0] == "command"
    assert place(command={"dt": 0.01, "scale": 0, "position": [[0, 0], [0, 0]]})[0] == "command.scale"
    assert place(command={"dt": 0.01, "origin": "left", "position": [[0, 0], [0, 0]]})[0].startswith("command.origin")
    assert place(command={"dt": 0.01, "smooth": 999, "position": [[0, 0], [0, 0]]})[0] == "command.smooth"
    assert place(command={"speed": 1e-9, "position": [[0, 0], [0.1, 0]]})[0] == "command.speed"


def test_live_is_answered_at_once_while_bad_requests_rain(server: Any) -> None:
    worst, done = 0.0, threading.Event()

    def rain() -> None:
        for row in TABLE:
            server.raw(row[1])
        done.set()

    attacker = threading.Thread(target=rain)
    attacker.start()
    with httpx.Client(base_url=server.url, timeout=60.0, verify=False) as client:
        while not done.is_set():
            begin = time.perf_counter()
            assert client.get("/health/live").status_code == 200
            worst = max(worst, time.perf_counter() - begin)
            time.sleep(0.002)
    attacker.join()
    assert worst < 0.5  # `make bench-server` holds it to 50 ms on a quiet machine


def test_table_is_long_enough() -> None:
    assert len(TABLE) >= 60
    assert len({row[0] for row in TABLE}) == len(TABLE)

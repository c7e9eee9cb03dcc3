"""What may go wrong around a server: nothing that was taken is lost, and it answers afterwards."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from runtime.client import Client
from runtime.planner import DEFAULT_BUNDLE

from ..conftest import Process, process, received, wait_for


def assert_answers(server: Any, request: dict[str, Any]) -> None:
    assert server.post("/plan", json=request).status_code == 200
    assert server.get("/health/ready").status_code == 200


def post_plan(request: dict[str, Any], path: str = "/plan") -> bytes:
    body = json.dumps(request).encode()
    return begin_of_post(path, len(body)) + body


def begin_of_post(path: str, length: int) -> bytes:
    lines = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return f"{lines}Content-Length: {length}\r\n\r\n".encode()


def test_ctrl_c_in_its_terminal_stops_the_server_with_130() -> None:
    with process() as server:
        os.killpg(server.process.pid, signal.SIGINT)
        code, said = server.ended()
        assert code == 130
        assert "Traceback" not in said


def test_sigterm_with_32_in_flight_finishes_them_and_ends_with_0(make_request: Callable[..., Any]) -> None:
    with process(SLIDE_DEADLINE=60, SLIDE_MAX_WAIT=60) as server, ExitStack() as stack:
        late = stack.enter_context(httpx.Client(base_url=server.url, timeout=60.0, verify=False))
        clients = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port))) for _ in range(32)]
        requests = [post_plan(make_request(1000, seed)) for seed in range(32)]
        for client, request in zip(clients, requests, strict=True):
            client.sendall(request[:-1])
        wait_for(lambda: "slide_requests_in_flight 32.0" in late.get("/metrics").text)
        server.process.send_signal(signal.SIGTERM)
        begin = time.monotonic()
        wait_for(lambda: late.post("/plan", json={}).status_code == 503)
        refusal = late.post("/plan", json=make_request())
        assert refusal.json()["type"].endswith(":stopping")
        assert refusal.headers["retry-after"] == "1"
        assert late.get("/health/live").status_code == 200
        assert late.get("/health/ready").status_code == 503
        for client, request in zip(clients, requests, strict=True):
            client.sendall(request[-1:])
        for client in clients:
            client.settimeout(30.0)
            assert received(client).startswith(b"HTTP/1.1 200 ")
        code, said = server.ended()
        assert code == 0
        assert time.monotonic() - begin < 10.0
        assert "Traceback" not in said


def test_client_gone_in_the_middle_of_its_body_costs_nothing(server: Any, make_request: Callable[..., Any]) -> None:
    request = post_plan(make_request())
    begin = request.index(b"{")
    for cut in (begin, begin + 1, len(request) // 2, len(request) - 1):
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.sendall(request[:cut])
    assert_answers(server, make_request())
    wait_for(lambda: server.service.in_flight == 0)


def test_client_gone_in_the_middle_of_the_answer_costs_nothing(server: Any, make_request: Callable[..., Any]) -> None:
    for request in (
        post_plan(make_request(3000)),
        post_plan({"commands": [make_request()["command"]] * 32}, "/plans"),
    ):
        for read in (0, 100, 5000):
            with socket.create_connection(("127.0.0.1", server.port)) as connection:
                connection.sendall(request)
                while read > 0:
                    read -= len(connection.recv(read))
    assert_answers(server, make_request())
    wait_for(lambda: server.service.in_flight == 0)


def test_200_slow_sockets_keep_nobody_out(server: Any, make_request: Callable[..., Any]) -> None:
    connections = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(200)]
    try:
        for index, connection in enumerate(connections):
            if index % 3 == 0:
                connection.sendall(b"POST /plan HTTP/1.1\r\nHost:")
            elif index % 3 == 1:
                connection.sendall(begin_of_post("/plan", 90) + b"{")
        assert_answers(server, make_request())
    finally:
        for connection in connections:
            connection.close()


def test_slow_header_and_slow_body_are_given_up(run_server: Callable[..., Any]) -> None:
    with run_server(header_timeout=0.3, body_timeout=0.3) as server:
        assert server.raw(b"GET / HT") == b""
        assert server.raw(b"") == b""
        head = (
            b"POST /plan HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 90\r\n\r\n{"
        )
        assert server.raw(head).startswith(b"HTTP/1.1 408 ")


@contextmanager
def stopped(server: Any) -> Iterator[None]:
    """Let the planning process stand still, as if a decoder hung."""
    process = server.service.dispatcher.process
    os.kill(process, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(process, signal.SIGCONT)


def test_client_that_does_not_read_its_answer_is_given_up(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    commands = [make_request(600)["command"]] * 32
    with run_server(write_timeout=0.3) as server, socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", server.port))
        connection.sendall(post_plan({"commands": commands}, "/plans"))
        wait_for(lambda: server.service.in_flight == 1)
        wait_for(lambda: server.service.in_flight == 0)
        assert_answers(server, make_request())


def test_decoder_that_hangs_times_out_and_the_worker_lives_on(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server(deadline=0.5) as server:
        process = server.service.dispatcher.process
        with stopped(server):
            begin = time.monotonic()
            response = server.post("/plan", json=make_request())
            assert response.status_code == 504
            assert response.json()["type"].endswith(":deadline")
            assert time.monotonic() - begin < 1.8
            assert server.get("/health/live").status_code == 200
            wait_for(lambda: server.get("/health/ready").status_code == 503, 1.0)
            assert server.get("/health/ready").headers["retry-after"] == "1"
            time.sleep(max(0.0, begin + 2.0 - time.monotonic()))
        wait_for(lambda: server.post("/plan", json=make_request()).status_code == 200)
        assert server.get("/health/ready").status_code == 200
        assert server.service.dispatcher.process == process


def test_planning_process_that_hangs_for_good_is_replaced(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server(deadline=0.5, hang_deadlines=2.0) as server:
        process = server.service.dispatcher.process
        os.kill(process, signal.SIGSTOP)
        assert server.post("/plan", json=make_request()).status_code == 504
        wait_for(lambda: not Path(f"/proc/{process}").exists())
        wait_for(lambda: server.get("/health/ready").status_code == 200)
        wait_for(lambda: server.post("/plan", json=make_request()).status_code == 200)
        assert server.service.dispatcher.process != process


def test_planning_process_killed_in_mid_plan_is_replaced_and_nobody_is_left_without_an_answer(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server(max_wait=60.0, deadline=60.0) as server, ThreadPoolExecutor(8) as threads:
        process, dispatcher = server.service.dispatcher.process, server.service.dispatcher
        with Client(server.url) as client, client.stream([[0.0, 0.0]] * 300) as following:
            with stopped(server):
                first = threads.submit(server.post, "/plan", json=make_request())
                wait_for(lambda: dispatcher.busy > 0.0)
                waiting = [threads.submit(server.post, "/plan", json=make_request()) for _ in range(6)]
                wait_for(lambda: server.service.in_flight == 7)
                os.kill(process, signal.SIGKILL)
            assert first.result().status_code == 500
            assert first.result().json()["type"].endswith(":failed")
            for answer in (each.result() for each in waiting):
                assert answer.status_code == 503
                assert answer.json()["type"].endswith(":not-ready")
                assert answer.headers["retry-after"] == "1"
            assert server.get("/health/live").status_code == 200
            assert server.get("/health/ready").status_code == 503
            assert len(following.step()) == following.chunk
            wait_for(lambda: server.get("/health/ready").status_code == 200)
        assert_answers(server, make_request())
        assert dispatcher.process != process


def test_planning_process_killed_while_nothing_is_planned_is_replaced(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server() as server:
        process = server.service.dispatcher.process
        os.kill(process, signal.SIGKILL)
        wait_for(lambda: server.get("/health/ready").status_code == 503, 10.0)
        wait_for(lambda: server.get("/health/ready").status_code == 200)
        assert server.service.dispatcher.process != process
        assert_answers(server, make_request())


FAILING = """
from server.planning.worker import TimedBundle, load_planner, main

class FailingBundle(TimedBundle):
    def decode_step(self, observation, memory):
        if (observation[:, 1] == 0.0625).any():
            raise RuntimeError("[ONNXRuntimeError] : 1 : FAIL : /secret/path")
        return super().decode_step(observation, memory)

def load(options):
    planner = load_planner(options)
    planner.bundle = FailingBundle(**vars(planner.bundle))
    return planner

main(load)
"""
"""A planning process whose decoder fails where a pan begins at y = 0.0625 m."""


def test_onnxruntime_exception_is_a_500_and_the_next_plan_is_made(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    failing, command = make_request(start={"pan_position": [0.0, 0.0625]}), [sys.executable, "-P", "-c", FAILING]
    with run_server(command, max_wait=60.0, deadline=60.0) as server, ThreadPoolExecutor(8) as threads:
        process = server.service.dispatcher.process
        with stopped(server):  # so that they are planned together
            requests = [make_request(), *([failing, make_request()] * 3)]
            asked = [threads.submit(server.post, "/plan", json=request) for request in requests]
            wait_for(lambda: server.service.in_flight == len(requests))
        answers = [each.result() for each in asked]
        assert [answer.status_code for answer in answers] == [200, 500, 200, 500, 200, 500, 200]
        assert answers[1].json()["type"].endswith(":failed")
        assert "secret" not in answers[1].text
        assert_answers(server, make_request())
        assert server.service.dispatcher.process == process


FAILING_SEVERAL = FAILING.replace("(observation[:, 1] == 0.0625).any()", "len(observation) > 1")
"""A planning process that can plan no command several ways."""


def badly_planned() -> dict[str, Any]:
    """Return a request whose one plan is bad."""
    t = np.linspace(0.0, 9.0, 1000)
    return {
        "command": {"dt": 0.001, "position": (0.06 * np.stack([1.0 - np.cos(t), np.sin(t)], axis=1)).tolist()},
        "limits": {"pan_reach": 0.05, "acceleration": 15.0, "jerk": 3000.0},
    }


def test_a_bad_plan_is_not_planned_several_ways_for_a_client_that_has_left(run_server: Callable[..., Any]) -> None:
    with run_server() as server:
        with stopped(server), pytest.raises(httpx.ReadTimeout):
            httpx.post(f"{server.url}/plan", json=badly_planned(), timeout=0.5)
        wait_for(lambda: server.service.in_flight == 0)
        assert server.post("/plan", json={**badly_planned(), "candidates": 1}).status_code == 200
        wait_for(lambda: server.service.dispatcher.busy == 0.0)
        batches = re.search(r"^slide_batch_size_count (\S+)$", server.get("/metrics").text, re.M)
        assert batches is not None
        assert float(batches[1]) == 2.0


def test_a_bad_plan_is_the_answer_if_it_cannot_be_planned_several_ways(run_server: Callable[..., Any]) -> None:
    request = badly_planned()
    with run_server([sys.executable, "-P", "-c", FAILING_SEVERAL]) as server:
        bad = server.post("/plan", json=request)
        assert bad.status_code == 200
        assert bad.json() == server.post("/plan", json={**request, "candidates": 1}).json()
        assert server.post("/plan", json={**request, "candidates": 4}).status_code == 500
        wait_for(lambda: server.service.in_flight == 0)
        assert_answers(server, request)


WITHOUT_NUMBA = "import sys; sys.modules['numba'] = None; from server.planning.worker import main; main()"


def test_server_without_numba_refuses_to_refine_and_says_what_to_install(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server([sys.executable, "-P", "-c", WITHOUT_NUMBA], max_refine_ms=200.0) as server:
        answer = server.post("/plan", json=make_request(refine_ms=10.0))
        assert answer.status_code == 422
        assert answer.json()["place"] == "refine_ms"
        assert "numba is not installed" in answer.json()["detail"]
        assert_answers(server, make_request())


def test_full_disk_stops_no_plan(make_request: Callable[..., Any], tmp_path: Path) -> None:
    """All a server writes is what it says; where that fails, plans go on."""
    with open("/dev/full", "w") as full, process(output=full, TMPDIR=tmp_path / "nowhere") as server:
        assert_answers(server, make_request())
        assert server.post("/plan", content=b"{").status_code in (400, 415)
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
        before = server.get("/info").json()
        plan = server.post("/plan", json=make_request()).json()
        data = bytearray((bundle / "decoder_step.onnx").read_bytes())
        data[len(data) // 2] ^= 1
        (bundle / "decoder_step.onnx").write_bytes(data)
        assert server.post("/plan", json=make_request()).json() == plan
        assert server.get("/info").json() == before
        (planning,) = planning_processes(server.process.pid)
        os.kill(planning, signal.SIGKILL)
        code, said = server.ended()
        assert code == 2
        assert "the planning process has ended (-9): a new one is started" in said
        assert "decoder_step.onnx: sha256 is" in said
    code, said = Process(SLIDE_MODEL=bundle).ended()
    assert code == 2
    assert "decoder_step.onnx: sha256 is" in said
    assert "Traceback" not in said


def test_bundle_of_another_sha256_is_refused() -> None:
    code, said = Process("--bundle-sha256", "0" * 64).ended()
    assert code == 2
    assert "it must be 000" in said


def test_queue_that_is_full_says_when_to_come_back(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with (
        run_server(max_queue=2, client_share=1.0, deadline=60.0, max_wait=60.0) as server,
        ThreadPoolExecutor(16) as threads,
    ):
        with stopped(server):
            asked = [threads.submit(server.post, "/plan", json=make_request())]
            wait_for(lambda: server.service.dispatcher.busy > 0.0)  # by itself: of two at once, both would be taken
            asked += [threads.submit(server.post, "/plan", json=make_request()) for _ in range(11)]
            wait_for(lambda: server.service.dispatcher.full)
            assert server.get("/health/live").status_code == 200
            wait_for(lambda: sum(each.done() for each in asked) == 9)
        answers = [each.result() for each in asked]
        assert sorted(answer.status_code for answer in answers) == [200] * 3 + [503] * 9
        assert all(answer.headers["retry-after"] == "1" for answer in answers if answer.status_code == 503)
        assert_answers(server, make_request())


def test_command_that_waits_too_long_is_sent_away_while_the_one_being_planned_is_finished(
    run_server: Callable[..., Any], make_request: Callable[..., Any]
) -> None:
    with run_server(max_wait=0.2, deadline=60.0) as server, ThreadPoolExecutor(1) as threads:
        with stopped(server):
            first = threads.submit(server.post, "/plan", json=make_request())
            wait_for(lambda: server.service.dispatcher.busy > 0.0)
            second = server.post("/plan", json=make_request())
            assert second.status_code == 503
            assert second.json()["type"].endswith(":overloaded")
            assert second.headers["retry-after"] == "1"
        assert first.result().status_code == 200
        assert_answers(server, make_request())


def test_sigterm_while_the_planning_process_compiles_ends_with_0_at_once() -> None:
    pytest.importorskip("numba")
    server = Process(SLIDE_MAX_REFINE_MS=200)
    try:
        wait_for(lambda: planning_processes(server.process.pid) != [])
        (planning,) = planning_processes(server.process.pid)
        # Numba has been loaded, and compiling takes seconds more.
        wait_for(lambda: "numba" in Path(f"/proc/{planning}/maps").read_text(), 60.0)
        begin = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        code, said = server.ended()
        assert code == 0
        assert time.monotonic() - begin < 10.0
        assert "ready: model" not in said
        assert "Traceback" not in said
        assert not Path(f"/proc/{planning}").exists()
    finally:
        server.process.kill()


def planning_processes(server: int) -> list[int]:
    return [each for each in children(server) if "planning.worker" in Path(f"/proc/{each}/cmdline").read_text()]


def children(server: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{server}/task/{server}/children").read_text().split()]


def test_processes_end_with_a_server_that_is_killed() -> None:
    with process() as server:
        started = children(server.process.pid)
        assert len(started) == 2
        server.process.kill()
        wait_for(lambda: not any(Path(f"/proc/{each}").exists() for each in started))

"""The example configuration of nginx, as it stands, before two replicas of which one is killed under load."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from .conftest import Process, process, wait_for

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
EXAMPLE = Path(__file__).parents[2] / "docs/nginx/slide-planner.conf"

pytestmark = pytest.mark.skipif(NGINX is None, reason="nginx is not installed")


def configuration(folder: Path, port: int, replicas: list[int]) -> str:
    """Return the example for this machine: without TLS, with these ports; nothing else of it is changed."""
    text = EXAMPLE.read_text()
    for address, replica in zip(("10.0.0.11:8000", "10.0.0.12:8000"), replicas, strict=True):
        assert text.count(address) == 2
        text = text.replace(address, f"127.0.0.1:{replica}")
    text = re.sub(r"\n\s*ssl_certificate.*;", "", text).replace("listen 443 ssl;", f"listen 127.0.0.1:{port};")
    paths = "".join(
        f"{name}_temp_path {folder}/{name};" for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    head = f"pid {folder}/pid; error_log {folder}/error.log; daemon off; worker_processes 1;"
    return f"{head} events {{}} http {{ access_log off; {paths}\n{text}}}\n"


@contextmanager
def balanced(folder: Path, replicas: list[Process]) -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    path = folder / "nginx.conf"
    path.write_text(configuration(folder, port, [each.port for each in replicas]))
    nginx = subprocess.Popen([str(NGINX), "-p", folder, "-c", path])
    try:
        wait_for(lambda: socket.socket().connect_ex(("127.0.0.1", port)) == 0)
        yield f"http://127.0.0.1:{port}"
    finally:
        nginx.terminate()
        nginx.wait(10.0)


def test_replica_killed_under_load_costs_no_plan_and_streams_are_opened_again(
    tmp_path: Path, make_request: Callable[..., Any]
) -> None:
    told = {"SLIDE_HOSTS": "slide.example.com", "SLIDE_PROXIES": "127.0.0.1", "SLIDE_MAX_WAIT": 5}
    headers = {"Host": "slide.example.com"}
    statuses: list[int] = []
    over = threading.Event()

    def load(url: str, seed: int) -> None:
        with httpx.Client(base_url=url, headers=headers, timeout=60.0) as client:
            while not over.is_set():
                statuses.append(client.post("/plan", json=make_request(200, seed)).status_code)

    with ExitStack() as stack:
        replicas = [stack.enter_context(process(**told)) for _ in range(2)]
        url = stack.enter_context(balanced(tmp_path, replicas))
        assert httpx.get(f"{url}/", headers=headers).status_code == 200
        assert httpx.get(f"{url}/metrics", headers=headers).status_code == 403
        answer = httpx.post(f"{url}/plan", json={}, headers=headers)
        assert answer.json()["request"] == answer.headers["x-request-id"]
        assert len(answer.headers["x-request-id"]) == 32  # nginx's name for it

        threads = [threading.Thread(target=load, args=(url, seed)) for seed in range(4)]
        for thread in threads:
            thread.start()
            stack.callback(thread.join)
        stack.callback(over.set)
        stepped = [_step(url)]
        wait_for(lambda: len(statuses) > 20)
        with dial(url) as stream:
            _open(stream)
            holding = next(each for each in replicas if "slide_streams 1.0" in each.get("/metrics").text)
            holding.process.kill()
            with pytest.raises(ConnectionClosed):
                stream.recv()
        stepped.append(_step(url))
        before = len(statuses)
        wait_for(lambda: len(statuses) > before + 20)
        time.sleep(0.5)
    assert set(statuses) == {200}
    assert stepped == ["following", "following"]


def dial(url: str) -> Any:
    connection = socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])))
    return connect("ws://slide.example.com/stream", sock=connection)


def _open(stream: Any) -> None:
    command = {"dt": 0.001, "position": [[0, 0]] * 300}
    stream.send(json.dumps({"format": "slide-stream/1", "command": command}))
    assert json.loads(stream.recv())["chunk"] > 0


def _step(url: str) -> str:
    with dial(url) as stream:
        _open(stream)
        stream.send(json.dumps({"sequence": 0}))
        status: str = json.loads(stream.recv())["status"]
        return status

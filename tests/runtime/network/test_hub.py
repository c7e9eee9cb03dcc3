"""Bundles are fetched from the Hugging Face hub: here from a server on this machine that stands in for it."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from runtime import BundleError, Planner
from runtime.network.hub import fetch

pytest.importorskip("huggingface_hub")

COMMIT = "0123456789abcdef0123456789abcdef01234567"

PROGRAM = """
import sys
from runtime import Planner, SlideError
try:
    planner = Planner(sys.argv[1])
except SlideError as error:
    sys.exit(f"{type(error).__name__}: {error}")
print(planner.bundle.sha256, planner.bundle.path)
"""


@pytest.fixture
def hub(bundle_path: Path) -> Iterator[str]:
    """The address of a hub that has one bundle, as user/tiny."""
    files = {file.name: file.read_bytes() for file in bundle_path.iterdir()} | {"picture.png": b"not wanted"}

    class Hub(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            kind, _, rest = self.path.removeprefix("/").partition("/")
            if self.path.startswith("/api/models/user/tiny/revision/"):
                names = [{"rfilename": name} for name in files]
                self.answer(json.dumps({"id": "user/tiny", "sha": COMMIT, "siblings": names}).encode())
            elif self.path.startswith(f"/api/models/user/tiny/tree/{COMMIT}"):
                listed = [
                    {"type": "file", "path": name, "size": len(body), "oid": hashlib.sha1(body).hexdigest()}
                    for name, body in files.items()
                ]
                self.answer(json.dumps(listed).encode())
            elif kind == "user" and rest.rpartition("/")[2] in files:
                self.answer(files[rest.rpartition("/")[2]])
            else:
                self.send_response(404)
                self.send_header("X-Error-Code", "RepoNotFound")
                self.send_header("Content-Length", "0")
                self.end_headers()

        do_HEAD = do_GET

        def answer(self, body: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("ETag", f'"{hashlib.sha256(body).hexdigest()}"')
            self.send_header("X-Repo-Commit", COMMIT)
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def plan(name: str, address: str, home: Path) -> subprocess.CompletedProcess[str]:
    environment = {"HF_ENDPOINT": address, "HF_HOME": str(home), "HF_HUB_DISABLE_XET": "1"}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, name],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_bundle_is_fetched_once_and_then_used_without_the_hub(hub: str, planner: Planner, tmp_path: Path) -> None:
    fetched = plan("hf://user/tiny", hub, tmp_path)
    assert fetched.returncode == 0, fetched.stderr
    sha256, folder = fetched.stdout.split()
    assert sha256 == planner.bundle.sha256
    assert not (Path(folder) / "picture.png").exists()
    without = plan("hf://user/tiny", "http://127.0.0.1:9", tmp_path)
    assert without.stdout == fetched.stdout, without.stderr


def test_what_is_not_there_is_said_in_one_line(hub: str, tmp_path: Path) -> None:
    for address in (hub, "http://127.0.0.1:9"):
        missing = plan("hf://user/nothing", address, tmp_path)
        assert missing.returncode == 1
        assert missing.stderr.startswith("BundleError: hf://user/nothing: cannot be fetched: ")
        assert missing.stderr.count("\n") == 1


@pytest.mark.parametrize("name", ["hf://", "hf://user", "hf://user/a/b", "hf:/user/na me", "hf://user/name@"])
def test_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(BundleError, match="is hf://user/name or hf://user/name@revision"):
        fetch(name)

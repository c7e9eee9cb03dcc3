"""A user's folder may hold files called like this project's packages: nothing that is started there imports them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from runtime import Plan

from .conftest import process

NAMES = ("server", "train", "export", "benchmarks", "client", "planner", "planning", "settings", "messages", "worker")

PLANS = """
from runtime import Planner
print(Planner().plan([[0.0, 0.0]] * 300).quality.status)
"""

CALLS = """
import sys
from runtime.client import Client, RemoteStream

with Client(sys.argv[1]) as client:
    print(client.plan([[0.0, 0.0]] * 300).quality.status)
with RemoteStream(sys.argv[1], [[0.0, 0.0]] * 300) as stream:
    stream.step()
    print(stream.last.status)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"raise RuntimeError('{name}.py is the user\\'s')\n", encoding="utf-8")
    (tmp_path / "plans.py").write_text(PLANS, encoding="utf-8")
    (tmp_path / "calls.py").write_text(CALLS, encoding="utf-8")
    (tmp_path / "command.csv").write_text("x,y\n" + "0,0\n" * 300, encoding="utf-8")
    return tmp_path


def run(folder: Path, *arguments: str | Path) -> str:
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_script_plans_beside_files_called_like_our_packages(folder: Path) -> None:
    assert run(folder, sys.executable, "plans.py") == "ok\n"


def test_slide_plan_plans_in_a_folder_with_files_called_like_our_packages(folder: Path) -> None:
    run(folder, Path(sys.executable).with_name("slide-plan"), "command.csv", "-o", "plan.json")
    assert len(Plan.load(folder / "plan.json")) == 300


def test_server_is_started_and_called_in_a_folder_with_files_called_like_our_packages(folder: Path) -> None:
    with process(cwd=folder) as server:
        assert run(folder, sys.executable, "calls.py", server.url) == "ok\nfollowing\n"

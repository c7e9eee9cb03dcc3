"""What is compiled is compiled once: the processes that plan load it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ..conftest import process, wait_for

pytest.importorskip("numba")


def kept(folder: Path) -> dict[Path, int]:
    return {each: each.stat().st_mtime_ns for each in folder.rglob("*.nb?")}


def test_what_is_compiled_is_loaded_by_the_next_process_and_goes_with_the_server(
    make_request: Callable[..., Any], tmp_path: Path
) -> None:
    with process(SLIDE_MAX_REFINE_MS=200, TMPDIR=tmp_path) as server:
        compiled = kept(tmp_path)
        assert {"law.slide_along", "gauss_newton.sweep"} <= {each.name.partition("-")[0] for each in compiled}
        numbers = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text().split()
        for each in numbers:
            if "planning.worker" in Path(f"/proc/{each}/cmdline").read_text():
                os.kill(int(each), signal.SIGKILL)
        wait_for(lambda: server.get("/health/ready").status_code == 503)
        wait_for(lambda: server.get("/health/ready").status_code == 200)
        assert server.post("/plan", json=make_request(refine_ms=10)).status_code == 200
        assert kept(tmp_path) == compiled
        server.process.terminate()
        assert server.ended()[0] == 0
        assert list(tmp_path.iterdir()) == []


FULL = """
import resource, sys
from pathlib import Path
from server.planning.messages import PlannerOptions
from server.planning.worker import load_planner
from runtime import Planner

resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
planner = load_planner(PlannerOptions(None, Planner().bundle.sha256, True, Path(sys.argv[1])))
print(planner.plan([[0.0, 0.0]] * 300, refine_ms=10).quality.status.value)
"""


def test_full_disk_makes_compiling_slow_and_nothing_else(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", FULL, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout == "ok\n"
    assert "what is compiled cannot be kept: " in done.stderr
    assert "Traceback" not in done.stderr

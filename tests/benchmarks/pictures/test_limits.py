"""The error over the limit of acceleration: measured, and drawn."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from benchmarks.pictures.limits import ACCELERATIONS


def test_picture_and_figures_of_a_bundle(tiny_bundle: Path, tmp_path: Path) -> None:
    picture = tmp_path / "limits.png"
    effort = ["--commands", "1", "--candidates", "8", "--iterations", "1"]
    arguments = ["--model", tiny_bundle, "-o", picture, "--json", *effort]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.pictures.limits", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    errors = json.loads(done.stdout)["errors"]
    assert [each["acceleration"] for each in errors] == list(ACCELERATIONS)
    assert all(0.0 < each[name] < 0.5 for each in errors for name in each if name != "acceleration")
    assert picture.read_bytes().startswith(b"\x89PNG")

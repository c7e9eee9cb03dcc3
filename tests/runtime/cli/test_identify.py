"""`slide-identify` as a program: its table, its page, its exit codes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime import Friction
from runtime.cli.identify import identify_main
from runtime.physics.law import slide_one

Slide = Callable[..., tuple[int, str, str]]


@pytest.fixture
def identify(program: Callable[..., Slide]) -> Slide:
    return program(identify_main, "slide-identify", 120)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    t = np.arange(800) * 1e-3
    u = 12.0 * np.stack([np.sin(25.0 * t), np.cos(19.0 * t)], axis=1)
    sliding = slide_one(np.zeros(4), u, Friction(0.6, 0.45))
    rows = ["t,pan_ax,pan_ay,object_x,object_y"]
    for k in range(800):
        seen = f"{sliding[k - 1, 0]:.6f},{sliding[k - 1, 1]:.6f}" if k % 10 == 0 and k > 0 else ","
        rows.append(f"{t[k]:.3f},{u[k, 0]:.6f},{u[k, 1]:.6f},{seen}")
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows))
    return path


def test_table_document_and_page(identify: Slide, log: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    code, out, err = identify(log, "--report", page)
    assert (code, err) == (0, "")
    assert "kinetic friction" in out
    assert "0.450" in out
    assert page.read_text(encoding="utf-8").count("<svg") == 3
    document = json.loads(identify(log, "--json", "--noise", "1e-4")[1])
    assert document["friction"]["kinetic"] == pytest.approx(0.45, abs=0.005)
    assert document["noise"] == 1e-4


def test_log_that_cannot_be_read_ends_with_2_and_one_line(identify: Slide, tmp_path: Path) -> None:
    for content in ("t,x\n1,2\n", ""):
        path = tmp_path / "bad.csv"
        path.write_text(content)
        code, out, err = identify(path, "--report", tmp_path / "page.html")
        assert (code, out) == (2, "")
        assert "missing column" in err
        assert err.count("\n") == 1
    assert not (tmp_path / "page.html").exists()
    assert identify(tmp_path / "absent.csv")[0] == 2

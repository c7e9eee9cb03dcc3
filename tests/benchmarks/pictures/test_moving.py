"""The moving picture: frames of a report that differ, and a machine without a browser says so."""

from __future__ import annotations

import os
import shutil
import sys

import numpy as np
import pytest

from benchmarks.pictures import moving
from benchmarks.pictures.browser import chromium
from runtime import Planner
from runtime.cli.console import run


@pytest.mark.skipif(not (chromium() or os.environ.get("CI")), reason="no Chromium")
def test_pan_moves_from_frame_to_frame():
    frames = moving.film(Planner().plan(np.linspace([0.0, 0.0], [0.01, 0.0], 60)))
    assert len(frames) == 5
    assert len({frame.size for frame in frames}) == 1
    assert len({frame.tobytes() for frame in frames}) > 1


def test_without_a_browser_it_says_what_to_do(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("SLIDE_CHROMIUM", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["moving", str(tmp_path / "plan.webp")])
    with pytest.raises(SystemExit) as caught:
        run(moving.NAME, moving.moving)
    assert caught.value.code == 2
    assert "no Chromium here: install it" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

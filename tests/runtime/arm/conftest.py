"""Plans for the arm, and `slide-run` as a person types it, in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime import Friction, Plan
from runtime.cli.run import run_main

SlideRun = Callable[..., tuple[int, str, str]]


@pytest.fixture
def slide_run(program: Callable[..., SlideRun]) -> SlideRun:
    return program(run_main, "slide-run", 80)


@pytest.fixture
def shake_file(tmp_path: Path) -> Path:
    """A plan of 300 samples in which the pan is shaken so that the object slips to and fro."""
    return save_shake(tmp_path / "shake.json", 8.0)


def save_shake(path: Path, peak: float, samples: int = 300) -> Path:
    t = np.arange(samples) * 1e-3
    u = peak * np.sin(2.0 * np.pi * t / 0.15)[:, None] * (1.0, 0.5)
    plan: Plan = Plan.of_accelerations(u, Friction(0.5, 0.5), "shake")
    plan.save(path)
    return path

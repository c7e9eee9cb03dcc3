"""The example controller follows through noise, another friction and a push."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from runtime import Planner, StreamStatus


def test_controller_follows_and_recovers_from_a_push() -> None:
    path = Path(__file__).parents[2] / "examples" / "controller.py"
    spec = importlib.util.spec_from_file_location("controller", path)
    assert spec is not None
    assert spec.loader is not None
    controller = importlib.util.module_from_spec(spec)
    sys.modules["controller"] = controller  # where its dataclass looks its annotations up
    spec.loader.exec_module(controller)
    report = controller.control(Planner(), 3)
    assert len(report.durations) == 42
    assert StreamStatus.BRAKING not in report.statuses
    assert report.error_before < 0.02
    assert report.error_after < 2.0 * report.error_before
    assert any("deadlines" in line for line in report.lines())

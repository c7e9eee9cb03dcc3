"""The example controller follows through noise, another friction and a push."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from runtime import Planner, StreamStatus


def test_controller_follows_and_recovers_from_a_push(example: Callable[[str], ModuleType]) -> None:
    report = example("controller").control(Planner(), 3)
    assert len(report.durations) == len(report.statuses) >= 3 * 14
    assert StreamStatus.BRAKING not in report.statuses
    assert report.error_before < 0.02
    assert report.error_after < 2.0 * report.error_before
    assert any("deadlines" in line for line in report.lines())

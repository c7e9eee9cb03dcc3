"""The section on arms that people own."""

from __future__ import annotations

import pytest

from benchmarks.harness.section import Subject
from benchmarks.sections.joints import JointsSettings, measure_joints
from runtime.errors import InputError


def test_commands_are_planned_for_an_arm_and_followed_by_its_joints() -> None:
    pytest.importorskip("mujoco")
    measured = measure_joints(Subject.load(), JointsSettings(splines=1, arms=("ur5e",), executed=1))
    arm = measured.figures.arms["ur5e"]
    assert (arm.missed, arm.stretch) == (0, 1.0)
    assert 0.0 < arm.tracking < 3e-3
    assert arm.position_error < 1e-7
    assert (arm.lost, arm.touched, arm.passed) == (0, 0, 0)
    assert 0.0 < arm.executed < 5e-3


def test_more_commands_than_there_are_are_refused() -> None:
    with pytest.raises(InputError, match="--splines must be at most 64, got 65"):
        JointsSettings(splines=65)

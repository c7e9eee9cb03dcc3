"""The moving picture of an arm: as many frames as the plan is long, and the pan moves in them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("PIL")

from benchmarks.pictures import arm
from runtime import Planner


def test_the_arm_moves_from_frame_to_frame() -> None:
    planner = Planner()
    frames = arm.film(planner, planner.plan(np.linspace([0.0, 0.0], [0.02, 0.0], 60)), "ur5e")
    assert len(frames) == 5
    assert {frame.size for frame in frames} == {arm.SIZE}
    assert len({frame.tobytes() for frame in frames}) == 5

"""What becomes of a plan under another friction."""

from __future__ import annotations

import numpy as np

from runtime import Friction, Plan
from runtime.assess.sureness import FRICTION_STEP, friction_range
from runtime.physics.motion import Motion
from runtime.quality import FrictionRange


def test_friction_range_is_where_the_replay_holds_the_tolerance(plan: Plan) -> None:
    u = plan.pan_acceleration
    states = plan.replay()
    motion = Motion(u, u, np.zeros((len(u) + 1, 4)), np.concatenate([states, states[-1:]]))
    trained_on = {"static": (0.5, 1.4), "kinetic": (0.3, 0.7)}
    tolerance = 2e-3
    found = friction_range(motion, plan.object_position, plan.friction, tolerance, trained_on)

    def holds(static: float, kinetic: float) -> bool:
        error = plan.replay(Friction(static, kinetic))[:, :2] - plan.object_position
        return bool(np.sqrt(np.mean(np.sum(error * error, axis=1))) <= tolerance)

    assert found.static_low is not None
    assert found.kinetic_high is not None
    assert found.static_low <= plan.friction.static <= (found.static_high or 0.0)
    assert (found.kinetic_low or 9.0) <= plan.friction.kinetic <= found.kinetic_high
    for static in (found.static_low, found.static_high):
        assert holds(static, plan.friction.kinetic)
    for kinetic in (found.kinetic_low, found.kinetic_high):
        assert holds(plan.friction.static, kinetic)
    assert found.static_low < 0.52 or not holds(found.static_low - FRICTION_STEP, plan.friction.kinetic)
    assert found.kinetic_high > 0.68 or not holds(plan.friction.static, found.kinetic_high + FRICTION_STEP)
    nowhere = friction_range(motion, u, plan.friction, tolerance, trained_on)
    assert nowhere == FrictionRange(tolerance, None, None, None, None)

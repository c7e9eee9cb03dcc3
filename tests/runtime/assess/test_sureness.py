"""What becomes of a plan under another friction."""

from __future__ import annotations

import numpy as np
import pytest

from runtime import Friction, Plan, Planner
from runtime.assess.sureness import FRICTION_STEP, friction_off_error, friction_range
from runtime.physics.motion import Motion
from runtime.quality import FrictionRange


@pytest.mark.parametrize("friction", [Friction(1.0, 0.5), Friction(0.5, 0.5), Friction(10.0, 0.0), Friction(0.0, 0.0)])
def test_error_under_friction_that_is_off_is_the_worst_replay_of_four(plan: Plan, friction: Friction) -> None:
    u, start = plan.pan_acceleration, plan.object_position[0]
    states = np.zeros((len(u) + 1, 4))
    states[:, :2] = start
    motion = Motion(u, u, np.zeros((len(u) + 1, 6)), states)
    found = friction_off_error(motion, plan.command_position, friction)
    errors = []
    for static in (0.9 * friction.static, min(1.1 * friction.static, 10.0)):
        for kinetic in (0.9 * friction.kinetic, 1.1 * friction.kinetic):
            replayed = plan.replay(Friction(static, min(kinetic, static)))[:, :2]
            errors.append(np.sqrt(np.mean(np.sum((replayed - plan.command_position) ** 2, axis=1))))
    assert found == pytest.approx(max(errors), abs=1e-12)


def test_every_plan_says_how_sure_it_is(plan: Plan) -> None:
    assert plan.quality.friction_off_rmse is not None
    assert plan.quality.friction_off_rmse > 0.0
    assert Plan.from_dict(plan.to_dict()).quality.friction_off_rmse == plan.quality.friction_off_rmse


def test_friction_range_is_where_the_replay_holds_the_tolerance(plan: Plan) -> None:
    u = plan.pan_acceleration
    states = plan.replay()
    motion = Motion(u, u, np.zeros((len(u) + 1, 6)), np.concatenate([states, states[-1:]]))
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
    nowhere = friction_range(motion, u[:, :2], plan.friction, tolerance, trained_on)
    assert nowhere == FrictionRange(tolerance, None, None, None, None)


def test_batch_is_as_sure_as_each_of_its_plans_to_the_last_bit(planner: Planner) -> None:
    t = np.linspace(0.0, 6.0, 800)
    positions = [0.03 * np.stack([1.0 - np.cos(t[: 780 - n]), np.sin(t[: 780 - n])], axis=1) for n in range(20)]
    plans = planner.plan_batch(positions, [Friction(0.6 + 0.02 * n, 0.4) for n in range(20)])
    for plan in plans:
        states = np.concatenate([plan.replay(), np.zeros((1, 4))])
        motion = Motion(plan.pan_acceleration, plan.pan_acceleration, states, states)
        assert plan.quality.friction_off_rmse == friction_off_error(motion, plan.command_position, plan.friction)

"""Joints along plans that nobody would make on purpose: from rest to rest, and what passes a limit is told."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime import Command, Friction, Limits, Plan, Planner
from runtime.arms.fit import fit
from runtime.arms.load import arm_names, load_arm
from runtime.arms.model import ArmModel
from runtime.arms.motion import ROUNDING, JointMotion, follow_plan
from runtime.arms.place import Place, find_place
from runtime.physics.law import DT

pytest.importorskip("mujoco")

Array = NDArray[np.float64]

REACH = 0.1
"""Within which all of these plans stay (m): every shipped arm reaches that."""

LARGEST_JUMP = 0.04
"""From one sample of a command to the next (m); farther ones are refused."""

FRICTION = Friction(0.15, 0.1)

bounded = settings(
    max_examples=8,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.too_slow],
)


@lru_cache
def held(name: str) -> tuple[ArmModel, Place]:
    model = ArmModel(load_arm(name))
    return model, find_place(model)


@lru_cache
def planner() -> Planner:
    return Planner()


@st.composite
def hostile(draw: st.DrawFn) -> Array:
    """Accelerations (n, 2) that jump, alternate, are silent or end in full speed; made small enough to stay near."""
    pieces = st.tuples(
        st.integers(1, 60),
        st.floats(-1.0, 1.0),
        st.floats(-1.0, 1.0),
        st.sampled_from(("held", "alternating", "ramp", "nothing")),
    )
    rows: list[Array] = []
    for samples, x, y, kind in draw(st.lists(pieces, min_size=1, max_size=6)):
        shape = {
            "held": np.ones(samples),
            "alternating": (-1.0) ** np.arange(samples),
            "ramp": np.linspace(0.0, 1.0, samples),
            "nothing": np.zeros(samples),
        }[kind]
        rows.append(shape[:, None] * (x, y))
    u = draw(st.sampled_from((0.5, 5.0, 30.0))) * np.concatenate(rows)
    plan: Plan = Plan.of_accelerations(u, FRICTION, "hostile")
    farthest = float(np.abs(plan.with_stop().pan[:, :2]).max())
    return u * min(1.0, 0.5 * REACH / farthest) if farthest else u


def check_from_rest_to_rest(joints: JointMotion) -> None:
    """Joints begin and end at rest, each sample leads on to the next, and a step beyond a limit on jerk is told."""
    assert not joints.speed[0].any()
    np.testing.assert_allclose(joints.speed[-1], 0.0, atol=1e-9)
    np.testing.assert_allclose(joints.acceleration[-1], 0.0, atol=1e-6)
    np.testing.assert_array_equal(joints.angle[0], joints.place.home)
    np.testing.assert_allclose((joints.speed + DT * joints.acceleration)[:-1], joints.speed[1:], atol=1e-11)
    steps = np.abs(np.diff(joints.acceleration, axis=0, prepend=0.0)) / DT
    told = {peak.part for peak in joints.exceeded if peak.quantity == "jerk"}
    for joint, most in zip(joints.arm.joints, steps.max(axis=0).tolist(), strict=True):
        assert joint.name in told or joint.jerk is None or most <= joint.jerk * (1.0 + 2.0 * ROUNDING)


@pytest.mark.parametrize("name", arm_names())
@given(u=hostile())
@bounded
def test_a_hostile_plan_is_followed_from_rest_to_rest(name: str, u: Array) -> None:
    plan: Plan = Plan.of_accelerations(u, FRICTION, "hostile")
    joints = follow_plan(*held(name), plan)
    check_from_rest_to_rest(joints)
    assert max(joints.position_error, joints.tilt_error) < 1e-6


@st.composite
def commands(draw: st.DrawFn) -> Array:
    """Positions (n, 2) (m) that jump, stand still and turn about: a finger on a screen that has lost its mind."""
    corners = draw(st.lists(st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12)), min_size=2, max_size=5))
    samples = draw(st.integers(20, 700))
    place = np.sort(draw(st.lists(st.floats(0.0, 1.0), min_size=len(corners), max_size=len(corners))))
    place[0], place[-1] = 0.0, 1.0
    t = np.linspace(0.0, 1.0, samples)
    position = np.stack([np.interp(t, place, axis) for axis in np.array(corners).T], axis=1)
    jump = float(np.hypot(*np.diff(position, axis=0).T).max())
    return position * min(1.0, LARGEST_JUMP / jump) if jump else position


@pytest.mark.parametrize("name", arm_names())
@given(position=commands())
@settings(bounded, max_examples=3)
def test_a_plan_for_an_arm_holds_its_joints_whatever_is_commanded(name: str, position: Array) -> None:
    model, place = held(name)
    fitted = fit(
        lambda command, limits: planner().plan(command, FRICTION, limits=limits),
        Command.from_samples(position),
        model,
        place,
        Limits(),
    )
    check_from_rest_to_rest(fitted.joints)
    steps = np.abs(np.diff(fitted.joints.acceleration, axis=0, prepend=0.0)) / DT
    assert not fitted.holds or (steps <= model.arm.limit("jerk") * (1.0 + 2.0 * ROUNDING)).all()
    assert fitted.holds, [str(peak) for peak in fitted.joints.exceeded]

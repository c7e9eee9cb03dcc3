from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.arm.controller import (
    DAMPING,
    FULL_CONTROL,
    PAPER_CONTROL,
    ArmState,
    JointLimits,
    Memory,
    TaskCommand,
    control,
    rotation_vector,
)
from runtime.documents.checks import FloatArray
from runtime.physics.law import DT


def limits_of(torque: float = 1e6, speed: float = 1e6, reach: float = np.inf, joints: int = 6) -> JointLimits:
    """Limits that are the same for all joints."""
    return JointLimits(*(np.full(joints, value) for value in (torque, speed, -reach, reach)))


WIDE = limits_of()
STILL = TaskCommand(np.zeros(3), np.eye(3), np.zeros(6), np.zeros(6), np.zeros(6))


def at_rest(**changes: FloatArray) -> ArmState:
    """An arm of unit inertia whose joints are the pan's coordinates."""
    state = ArmState(np.zeros(6), np.zeros(6), np.zeros(3), np.eye(3), np.eye(6), np.eye(6), np.zeros(6))
    return state._replace(**changes)


def turned(axis: FloatArray, angle: float) -> FloatArray:
    """The rotation by `angle` (rad) about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: FloatArray = np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k
    return rotation


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(0.0, 3.1))
def test_rotation_vector_undoes_the_rotation(direction: tuple[float, float, float], angle: float) -> None:
    length = math.hypot(*direction)
    axis = np.array(direction) / length if length > 0.1 else np.array([0.0, 0.0, 1.0])
    assert rotation_vector(turned(axis, angle)) == pytest.approx(axis * angle, abs=1e-9)


def test_an_arm_where_it_should_be_gets_the_torque_of_gravity_alone() -> None:
    gravity = np.arange(6.0)
    tick = control(STILL, at_rest(bias=gravity), None, FULL_CONTROL, WIDE)
    assert tick.torque == pytest.approx(gravity)
    assert tick.limits == ()
    assert control(STILL, at_rest(bias=gravity), None, PAPER_CONTROL, WIDE).torque == pytest.approx(np.zeros(6))


def test_gains_are_those_of_section_v_a() -> None:
    off = STILL._replace(position=np.array([0.01, 0.0, 0.0]), rotation=turned(np.array([0.0, 0.0, 1.0]), 0.02))
    off = off._replace(velocity=np.array([0.0, 0.1, 0.0, 0.0, 0.1, 0.0]))
    torque = control(off, at_rest(), None, PAPER_CONTROL, WIDE).torque
    assert torque == pytest.approx([800 * 0.01, 100 * 0.1, 0.0, 0.0, 150 * 0.1, 1000 * 0.02])


def test_feed_forward_adds_the_commanded_acceleration() -> None:
    u = np.array([3.0, -4.0, 0.0, 0.0, 0.0, 0.0])
    command = STILL._replace(acceleration=u)
    assert control(command, at_rest(), None, FULL_CONTROL, WIDE).torque == pytest.approx(u)
    assert control(command, at_rest(), None, PAPER_CONTROL, WIDE).torque == pytest.approx(np.zeros(6))


@pytest.mark.parametrize("settings", [FULL_CONTROL, PAPER_CONTROL])
def test_the_observer_finds_a_constant_disturbance(settings: object) -> None:
    assert settings in (FULL_CONTROL, PAPER_CONTROL)
    control_settings = FULL_CONTROL if settings is FULL_CONTROL else PAPER_CONTROL
    load = np.array([5.0, -2.0, 1.0, 0.0, 0.5, 0.0])
    state, memory = at_rest(), None
    for _ in range(200):
        tick = control(STILL, state, memory, control_settings, WIDE)
        memory = tick.memory
        speed = state.theta_velocity + (tick.torque - load) * DT
        state = state._replace(theta_velocity=speed)
    assert isinstance(memory, Memory)
    assert memory.disturbance == pytest.approx(load, abs=1e-3)


def test_torques_stay_within_their_limits_and_it_is_said() -> None:
    far = STILL._replace(position=np.array([0.0, 0.05, 0.0]))
    limits = limits_of(torque=10.0)
    tick = control(far, at_rest(), None, FULL_CONTROL, limits)
    assert tick.torque.tolist() == [0.0, 10.0, 0.0, 0.0, 0.0, 0.0]
    assert tick.limits == ("torque of joint 2",)


def test_a_joint_at_its_speed_limit_is_not_driven_further() -> None:
    push = STILL._replace(velocity=np.full(6, 5.0))
    fast = at_rest(theta_velocity=np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0]))
    tick = control(push, fast, None, FULL_CONTROL, limits_of(speed=4.0))
    assert tick.torque[2] == 0.0
    assert "speed of joint 3" in tick.limits


def test_a_singular_arm_is_damped_and_it_is_said() -> None:
    jacobian = np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
    up = STILL._replace(position=np.array([0.0, 0.0, 1e9]))
    tick = control(up, at_rest(jacobian=jacobian), None, FULL_CONTROL, WIDE)
    assert np.abs(tick.torque).max() <= 150.0 / (2.0 * DAMPING)
    assert tick.limits == ("reach",)


def test_a_seventh_joint_goes_to_its_posture_and_moves_no_pan() -> None:
    jacobian = np.hstack([np.eye(6), np.eye(6)[:, :1]])
    limits = limits_of(joints=7)
    state = ArmState(np.zeros(7), np.zeros(7), np.zeros(3), np.eye(3), jacobian, np.eye(7), np.zeros(7))
    posture = np.array([-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    tick = control(STILL._replace(posture=posture), state, None, FULL_CONTROL, limits)
    assert jacobian @ tick.torque == pytest.approx(np.zeros(6), abs=1e-12)
    assert tick.torque[[0, 6]] == pytest.approx([-10.0, 10.0])
    up = STILL._replace(acceleration=np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]), posture=np.zeros(7))
    assert jacobian @ control(up, state, None, FULL_CONTROL, limits).torque == pytest.approx(up.acceleration)


def test_a_joint_out_of_its_range_is_said() -> None:
    turned_far = at_rest(theta=np.array([0.0, 0.0, 0.0, -2.1, 0.0, 0.0]))
    assert control(STILL, turned_far, None, FULL_CONTROL, limits_of(reach=2.0)).limits == ("range of joint 4",)

"""The pan's controller: a PD controller in task space with a disturbance observer (Fig. 7), pure numpy.

Symbols: theta joint angles, J Jacobian of the pan's centre, M inertia matrix, h gravity and velocity terms of the
joint torques, tau joint torques. The model of the arm that J, M and h come from is handed in at every tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arms.description import ArmDescription
from runtime.documents.checks import FloatArray
from runtime.physics.law import DT

BoolArray = NDArray[np.bool_]

K_P = np.array([800.0, 800.0, 800.0, 1000.0, 1000.0, 1000.0])
"""Stiffness of position and attitude (1/s^2), Section V-A."""

K_D = np.array([100.0, 100.0, 100.0, 150.0, 150.0, 150.0])
"""Damping of position and attitude (1/s), Section V-A."""

OBSERVER_CUTOFF = 200.0
"""Cut-off of the disturbance observer's low-pass filter (rad/s): ten times the motion's, a thirtieth of the rate's."""

TASK_LIMITS = np.array([150.0, 150.0, 150.0, 600.0, 600.0, 600.0])
"""Largest task acceleration asked for (m/s^2, rad/s^2): several times what plans need, so that only an error that has
left all proportion is cut."""

SINGULAR_FROM = 0.05
"""Singular value of the Jacobian below which it is damped (m or 1, per rad): half of the least value within 0.2 m of
where the pan begins, where damping would only be an error of the model."""

DAMPING = 0.05
"""Damping of a Jacobian that is singular: joint accelerations are at most task accelerations over twice this."""

POSTURE_STIFFNESS = 100.0
"""Stiffness of the joints of a redundant arm towards their posture, where the pan does not move for it (1/s^2)."""

POSTURE_DAMPING = 20.0
"""Damping of the same (1/s), critical."""

SPEED_HORIZON = 0.005
"""Time in which a joint beyond its speed limit is brought back to it (s)."""


@dataclass(frozen=True)
class ControlSettings:
    """Which parts of the controller act.

    Attributes:
        feed_forward: the commanded acceleration is added.
        gravity_terms: h of the model is added to the torque; the observer takes it out of the disturbance.
        observer: the disturbance observer acts.
        model_scale: factor on M and h, to try a wrong model.
    """

    feed_forward: bool = True
    gravity_terms: bool = True
    observer: bool = True
    model_scale: float = 1.0


FULL_CONTROL = ControlSettings()
"""Everything acts."""

PAPER_CONTROL = ControlSettings(feed_forward=False, gravity_terms=False)
"""The controller as Fig. 7 draws it: neither feed-forward nor gravity terms; the observer is left to find gravity."""


@dataclass(frozen=True)
class JointLimits:
    """Largest torques (N m) and speeds (rad/s) of the joints, and the ends of their ranges (rad), each (n,).

    What is not known is infinite. Torques are cut, and joints that are too fast are held back. That a joint is out of
    its range is said.
    """

    torque: FloatArray
    speed: FloatArray
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, arm: ArmDescription) -> JointLimits:
        """Return the limits of an arm."""
        return cls(arm.limit("torque"), arm.limit("speed"), *arm.range)


class ArmState(NamedTuple):
    """The arm at one sample, measured or from its model.

    Attributes:
        theta: (n,) joint angles (rad).
        theta_velocity: (n,) joint speeds (rad/s).
        position: (3,) of the pan's centre in the world (m).
        rotation: (3, 3) attitude of the pan in the world, of determinant 1.
        jacobian: (6, n) from joint speeds to the pan's velocity (m/s) and angular velocity (rad/s) in the world.
        inertia: (n, n) M (kg m^2).
        bias: (n,) h (N m).
    """

    theta: FloatArray
    theta_velocity: FloatArray
    position: FloatArray
    rotation: FloatArray
    jacobian: FloatArray
    inertia: FloatArray
    bias: FloatArray


class TaskCommand(NamedTuple):
    """What the pan is to do: Eq. 29 with its derivatives.

    Attributes:
        position: (3,) of the pan's centre in the world (m).
        rotation: (3, 3) attitude of the pan in the world.
        velocity: (6,) (m/s, rad/s).
        acceleration: (6,) (m/s^2, rad/s^2).
        posture: (n,) joint angles (rad) that an arm of more than six joints tends to.
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    posture: FloatArray


class Memory(NamedTuple):
    """What the controller carries from tick to tick: the tick before, and the disturbance found so far (N m)."""

    state: ArmState
    torque: FloatArray
    disturbance: FloatArray


class ControlTick(NamedTuple):
    """What one tick gives: torques (n,) (N m), what held them back, and what is carried on."""

    torque: FloatArray
    limits: tuple[str, ...]
    memory: Memory


def control(
    command: TaskCommand, measured: ArmState, memory: Memory | None, settings: ControlSettings, limits: JointLimits
) -> ControlTick:
    """Compute the joint torques for one sample (Fig. 7).

    Task acceleration by PD and feed-forward; joint acceleration by the (damped) inverse of the Jacobian, the least
    that does it, and in a redundant arm what draws it to its posture besides; torque by the inertia matrix, the gravity
    terms and the disturbance observed.

    Args:
        command: for this sample.
        measured: the arm now.
        memory: what the tick before carried on; None at the first.
        settings: which parts act.
        limits: of the joints.
    """
    state = _scaled(measured, settings.model_scale)
    disturbance = _observe(state, memory, settings)

    a = K_P * _pose_error(command, state) + K_D * (command.velocity - state.jacobian @ state.theta_velocity)
    if settings.feed_forward:
        a += command.acceleration - _jacobian_rate(state, memory) @ state.theta_velocity
    towards = POSTURE_STIFFNESS * (command.posture - state.theta) - POSTURE_DAMPING * state.theta_velocity
    wanted, singular = _solve(state.jacobian, np.clip(a, -TASK_LIMITS, TASK_LIMITS), towards)
    theta_acceleration, too_fast = _limit_speed(wanted, state.theta_velocity, limits.speed)
    free = state.inertia @ theta_acceleration + disturbance
    if settings.gravity_terms:
        free += state.bias
    torque = np.clip(free, -limits.torque, limits.torque)

    beyond = (state.theta < limits.lower) | (state.theta > limits.upper)
    held_back = _names(singular, too_fast, torque != free, beyond)
    return ControlTick(torque, held_back, Memory(state, torque, disturbance))


def _scaled(state: ArmState, scale: float) -> ArmState:
    return state if scale == 1.0 else state._replace(inertia=scale * state.inertia, bias=scale * state.bias)


def _observe(state: ArmState, memory: Memory | None, settings: ControlSettings) -> FloatArray:
    """Estimate the disturbance torque: what was applied and did not become the model's acceleration, low-passed.

    The inertia matrix and h of the sample before belong to the torque of the sample before. The textbook form, which
    differentiates the momentum M dtheta without the term dM/dt, would find a disturbance where there is none.
    """
    if memory is None or not settings.observer:
        return np.zeros_like(state.theta_velocity)
    before = memory.state
    acceleration = (state.theta_velocity - before.theta_velocity) / DT
    raw = memory.torque - before.inertia @ acceleration
    if settings.gravity_terms:
        raw -= before.bias
    share = -math.expm1(-OBSERVER_CUTOFF * DT)
    disturbance: FloatArray = memory.disturbance + share * (raw - memory.disturbance)
    return disturbance


def _pose_error(command: TaskCommand, state: ArmState) -> FloatArray:
    """Return the position error (m) and the rotation vector (rad) from the attitude measured to the commanded one.

    Differences of roll, pitch and yaw will not do: at the pitch of Eq. 29, pi/2, they are singular.
    """
    error = np.empty(6)
    error[:3] = command.position - state.position
    error[3:] = rotation_vector(command.rotation @ state.rotation.T)
    return error


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return axis times angle (rad), angle at most pi, of a rotation matrix (3, 3)."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = rotation.tolist()
    axis = np.array([zy - yz, xz - zx, yx - xy])  # 2 sin(angle) long
    sine = 0.5 * math.sqrt(float(axis @ axis))
    cosine = 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = math.atan2(sine, cosine)
    # sin(angle)/angle is 1 to double precision below this angle, and turned by exactly pi the axis is lost.
    return 0.5 * axis * (angle / sine if sine > 1e-9 else 1.0)


def _jacobian_rate(state: ArmState, memory: Memory | None) -> FloatArray:
    if memory is None:
        return np.zeros_like(state.jacobian)
    rate: FloatArray = (state.jacobian - memory.state.jacobian) / DT
    return rate


def _solve(jacobian: FloatArray, a: FloatArray, towards: FloatArray) -> tuple[FloatArray, bool]:
    """Solve J x = a, by damped least squares where J is nearly singular (Nakamura and Hanafusa, 1986).

    Args:
        jacobian: J, (6, n).
        a: (6,) task accelerations (m/s^2, rad/s^2).
        towards: (n,) joint accelerations (rad/s^2) of which the part is added that does not move the pan.

    Returns:
        (n,) joint accelerations (rad/s^2), and whether damping acted.
    """
    left, singular_values, right = np.linalg.svd(jacobian)
    kernel, right = right[len(a) :], right[: len(a)]
    smallest = float(singular_values[-1])
    damped = smallest < SINGULAR_FROM
    square = DAMPING**2 * (1.0 - (smallest / SINGULAR_FROM) ** 2) if damped else 0.0
    solution: FloatArray = right.T @ (singular_values / (singular_values**2 + square) * (left.T @ a))
    if len(kernel):
        solution += kernel.T @ (kernel @ towards)
    return solution, damped


def _limit_speed(wanted: FloatArray, speed: FloatArray, limit: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Cut joint accelerations that would drive a joint past its speed limit.

    Returns:
        (n,) joint accelerations (rad/s^2), and for each joint whether it was cut.
    """
    cut = np.clip(wanted, (-limit - speed) / SPEED_HORIZON, (limit - speed) / SPEED_HORIZON)
    return cut, cut != wanted


def _names(singular: bool, too_fast: BoolArray, too_strong: BoolArray, beyond: BoolArray) -> tuple[str, ...]:
    if not (singular or too_fast.any() or too_strong.any() or beyond.any()):
        return ()
    names = ["reach"] if singular else []
    names += [f"speed of joint {joint + 1}" for joint in np.flatnonzero(too_fast)]
    names += [f"torque of joint {joint + 1}" for joint in np.flatnonzero(too_strong)]
    names += [f"range of joint {joint + 1}" for joint in np.flatnonzero(beyond)]
    return tuple(names)

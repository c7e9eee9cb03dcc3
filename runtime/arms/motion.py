"""How the joints move along a plan: inverse kinematics of the pan's path, sample by sample, and the limits it meets.

Time line: row k of joint angles and speeds belongs to t_k; row k of the accelerations acts from t_k to t_(k+1), as a
plan's do, so that the jerk is the step from one row to the next, the first from rest, the last to rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arms.description import HAND_LIMITS, LIMITS, ArmDescription
from runtime.arms.model import ArmModel, pose_error
from runtime.arms.place import Place
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.plan import Plan

CONVERGED = 1e-10
"""Error of the pan's pose with which a sample is left (m, rad)."""

CORRECTIONS = 12
"""Most Newton steps at one sample: two are the rule, and more mean that the arm does not reach the place."""

HOMING = 10.0
"""How fast a redundant arm turns back to its home, over the square of the pan's speed (s/m^2): not at all while the pan
is at rest, where nothing may move."""

NEARLY_SINGULAR = 1e-3
"""Smallest singular value with which the arm follows (m or 1 per rad)."""

ROUNDING = 1e-6
"""Share of a limit by which it may be passed and nothing is said."""

MOST_TOLD = 3
"""Limits that are told in one line."""

DIRECTIONS = ("moving along x", "moving along y", "moving up", "turning about x", "turning about y", "turning about z")
"""What the rows of a Jacobian are of the pan, in the world."""


@dataclass(frozen=True)
class Peak:
    """The most that a joint, or the hand, comes to of one quantity.

    Attributes:
        part: name of the joint; "hand" for the pan itself.
        quantity: angle, or one of LIMITS.
        value: the largest absolute value; of the angle, the one that is nearest to an end of its range.
        limit: what it is held against, None if it is unknown; of the angle, that end.
        time: when (s).
        unit: of both.
        share: the value over the limit, None if that is unknown; of the angle, its distance from the middle of the
            range over half of the range.
    """

    part: str
    quantity: str
    value: float
    limit: float | None
    time: float
    unit: str
    share: float | None

    @property
    def exceeded(self) -> bool:
        """Whether the limit is passed."""
        return self.share is not None and self.share > 1.0 + ROUNDING

    def __str__(self) -> str:
        """Tell it in a line, beside its limit."""
        value = f"{self.value:.4g} {self.unit} at {self.time:.3f} s"
        if self.limit is None:
            return f"{self.quantity} of {self.part} {value}"
        if self.quantity == "angle":
            return f"{self.part} comes to {value}, its range ends at {self.limit:.4g}"
        than = "exceeds" if self.exceeded else "is within"
        return f"{self.quantity} of {self.part} {value} {than} the limit of {self.limit:g} {self.unit}"


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The joints along a path of the pan; n rows each, the last at rest.

    Attributes:
        arm: whose.
        place: where the path begins.
        angle: (n, joints) (rad).
        speed: (n, joints) (rad/s).
        acceleration: (n, joints) (rad/s^2).
        torque: (n, joints) (N m), with the weight of the arm and the pan.
        pan: (n, 3) the pan's centre in the world (m), as the joints hold it.
        pan_velocity: (n, 3) (m/s), as the plan has it.
        singular: (n,) smallest singular value of the Jacobian (m or 1 per rad).
        hardest: what the pan does hardest where that is smallest, one of DIRECTIONS.
        position_error: farthest that the pan leaves its path (m).
        tilt_error: most that its attitude leaves the commanded (rad).
    """

    arm: ArmDescription
    place: Place
    angle: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    pan: FloatArray
    pan_velocity: FloatArray
    singular: FloatArray
    hardest: str
    position_error: float
    tilt_error: float

    def __len__(self) -> int:
        """Return the number of samples, n."""
        return len(self.angle)

    @property
    def time(self) -> FloatArray:
        """(n,) t_k (s)."""
        return np.arange(len(self), dtype=np.float64) * DT

    @property
    def jerk(self) -> FloatArray:
        """(n, joints) (rad/s^3); row k is the step at t_k."""
        steps: FloatArray = np.diff(self.acceleration, axis=0, prepend=0.0) / DT
        return steps

    @property
    def peaks(self) -> tuple[Peak, ...]:
        """The peaks of all joints, then of the hand where it has limits."""
        return (*self._angles(), *self._joints(), *self._hand())

    @property
    def worst(self) -> Peak | None:
        """The peak with the largest share of its limit, None if no limit is known."""
        return max((peak for peak in self.peaks if peak.share is not None), key=_share, default=None)

    @property
    def exceeded(self) -> tuple[Peak, ...]:
        """The peaks that pass their limits, the worst first."""
        return tuple(sorted((peak for peak in self.peaks if peak.exceeded), key=_share, reverse=True))

    def _angles(self) -> Iterator[Peak]:
        for index, joint in enumerate(self.arm.joints):
            unit = "m" if joint.sliding else "rad"
            angle = self.angle[:, index]
            if joint.lower is None or joint.upper is None:
                k = int(np.abs(angle).argmax())
                yield Peak(joint.name, "angle", float(angle[k]), None, k * DT, unit, None)
                continue
            middle, half = 0.5 * (joint.lower + joint.upper), 0.5 * (joint.upper - joint.lower)
            k = int(np.abs(angle - middle).argmax())
            end = joint.upper if angle[k] > middle else joint.lower
            share = abs(float(angle[k]) - middle) / half
            yield Peak(joint.name, "angle", float(angle[k]), end, k * DT, unit, share)

    def _joints(self) -> Iterator[Peak]:
        values = {"speed": self.speed, "acceleration": self.acceleration, "jerk": self.jerk, "torque": self.torque}
        for name in LIMITS:
            size = np.abs(values[name])
            for index, (joint, k) in enumerate(zip(self.arm.joints, size.argmax(axis=0).tolist(), strict=True)):
                yield _peak(joint.name, name, float(size[k, index]), getattr(joint, name), k, joint.units[name])

    def _hand(self) -> Iterator[Peak]:
        acceleration = np.diff(self.pan_velocity, axis=0, append=0.0) / DT
        jerk = np.diff(acceleration, axis=0, prepend=0.0) / DT
        for name, rows in (("speed", self.pan_velocity), ("acceleration", acceleration), ("jerk", jerk)):
            size = np.linalg.norm(rows, axis=1)
            limit = getattr(self.arm.hand, name)
            if limit is not None:
                k = int(size.argmax())
                yield _peak("hand", name, float(size[k]), limit, k, HAND_LIMITS[name])


def passed(peaks: Sequence[Peak]) -> str:
    """Tell limits that are passed in a line: the first three of them, and how many there are besides."""
    more = f"; and {len(peaks) - MOST_TOLD} more" if len(peaks) > MOST_TOLD else ""
    return f"limit exceeded: {'; '.join(map(str, peaks[:MOST_TOLD]))}{more}"


def follow_plan(model: ArmModel, place: Place, plan: Plan) -> JointMotion:
    """Return the joints along a plan and its stop, the pan beginning at a place.

    The plan's x and y axes are those of the pan there.

    Raises:
        InputError: the plan's pan does not begin at rest at the origin, or see `follow`.
    """
    pan = plan.with_stop().pan
    if pan[0].any():
        raise InputError("the plan's pan must begin at rest at the origin, where the arm holds it")
    return follow_pan(model, place, pan)


def follow_pan(model: ArmModel, place: Place, pan: FloatArray) -> JointMotion:
    """Return the joints along states of the pan (n, 6), from rest to rest: relative to the place, along its axes.

    Raises:
        InputError: see `follow`.
    """
    turn = place.rotation.T
    return follow(model, place, place.position + pan[:, :3] @ turn, pan[:, 3:] @ turn)


def follow(model: ArmModel, place: Place, position: FloatArray, velocity: FloatArray) -> JointMotion:
    """Return the joints along a path of the pan, its attitude as it is at the place.

    Newton's method from sample to sample, by the least-norm step in which joints that may accelerate more count less.
    A redundant arm turns back to its home meanwhile; see HOMING.

    Args:
        model: of the arm.
        place: where the path begins.
        position: (n, 3) of the pan's centre in the world (m), the first the place's.
        velocity: (n, 3) (m/s); the first and the last are rest.

    Raises:
        InputError: the arm does not reach a place on the path, or is singular there; the place and the time are told.
    """
    arm, attitude, home = model.arm, place.rotation, place.home
    samples, joints = len(position), len(arm)
    redundant = joints > 6
    weight = model.weight
    angle, speed = np.empty((samples, joints)), np.empty((samples, joints))
    pan, jacobians = np.empty((samples, 3)), np.empty((samples, 6, joints))
    q, rate, step = home.copy(), np.zeros(joints), np.zeros(joints)
    task, farthest, most = np.zeros(6), 0.0, 0.0
    for k in range(samples):
        q = q + step
        for _ in range(CORRECTIONS):
            at, rotation, jacobian = model.pan(q)
            error = pose_error(position[k], attitude, at, rotation)
            weighted = jacobian * weight
            square = weighted @ jacobian.T
            if np.abs(error).max() < CONVERGED:
                break
            q = q + weighted.T @ _solved(square, error, position[k], k, arm)
        else:
            raise InputError(_out_of_reach(arm, position[k], k))
        task[:3] = velocity[k]
        before = rate
        if redundant:
            back = HOMING * float(velocity[k] @ velocity[k]) * (home - q)
            rate = back + weighted.T @ _solved(square, task - jacobian @ back, position[k], k, arm)
        else:
            rate = weighted.T @ _solved(square, task, position[k], k, arm)
        step = DT * (1.5 * rate - 0.5 * before)  # where the next sample is, to third order
        angle[k], speed[k], pan[k], jacobians[k] = q, rate, at, jacobian
        farthest, most = max(farthest, float(np.linalg.norm(error[:3]))), max(most, float(np.linalg.norm(error[3:])))
    left, singular, _ = np.linalg.svd(jacobians, full_matrices=False)
    nearest = int(singular[:, -1].argmin())
    if singular[nearest, -1] < NEARLY_SINGULAR:
        raise InputError(_out_of_reach(arm, position[nearest], nearest))
    acceleration = np.diff(speed, axis=0, append=0.0) / DT
    return JointMotion(
        arm,
        place,
        angle,
        speed,
        acceleration,
        model.torque(angle, speed, acceleration),
        pan,
        velocity,
        singular[:, -1],
        DIRECTIONS[int(np.abs(left[nearest, :, -1]).argmax())],
        farthest,
        most,
    )


def _solved(square: FloatArray, error: FloatArray, position: FloatArray, k: int, arm: ArmDescription) -> FloatArray:
    try:
        solution = np.asarray(np.linalg.solve(square, error), dtype=np.float64)
    except np.linalg.LinAlgError as wrong:
        raise InputError(_out_of_reach(arm, position, k)) from wrong
    return solution


def _out_of_reach(arm: ArmDescription, position: FloatArray, k: int) -> str:
    x, y, z = position
    return (
        f"arm {arm.name} does not reach ({x:.3f}, {y:.3f}, {z:.3f}) m in its world at t = {k * DT:.3f} s with the pan "
        "as it stands: give another place (--at), or a smaller plan"
    )


def _peak(part: str, name: str, value: float, limit: float | None, k: int, unit: str) -> Peak:
    return Peak(part, name, value, limit, k * DT, unit, None if limit is None else value / limit)


def _share(peak: Peak) -> float:
    return -math.inf if peak.share is None else peak.share

"""A real arm that is told joint angles: what the drivers of different makers have in common.

A driver answers three questions in a class of its own: how to go home, how to send joint angles at its own pace, what
the joints measure. `examples/franka.py`, `examples/universal_robots.py` and `examples/ros2.py` are such classes.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from runtime.arm.controller import rotation_vector
from runtime.arm.interface import Arm, Measured, ObjectStatus, PanCommand
from runtime.arm.results import Results
from runtime.arm.run import check_plan, execute, open_loop
from runtime.arms.model import ArmModel, pose_error
from runtime.arms.motion import HOMING, follow_plan
from runtime.arms.options import ArmChoice, choose
from runtime.arms.place import Place
from runtime.documents.checks import FloatArray
from runtime.documents.files import reading
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.plan import Plan

CONVERGED = 1e-9
"""Error of the pan's pose with which a sample is left (m, rad)."""

CORRECTIONS = 12
"""Most Newton steps at one sample: more mean that the arm does not reach the place."""

HOMING_SPEED = 0.3
"""Largest joint speed on the way home (rad/s)."""

See = Callable[[], FloatArray]
"""Gives the object's state (4,) in the pan's frame (m, m/s), as a camera sees it."""


class Joints(NamedTuple):
    """What the joints measure: angles (rad), speeds (rad/s) and torques (N m), (n,) each."""

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray


def check_joints(model: ArmModel, place: Place, plan: Plan) -> None:
    """Check, before a real arm moves, that a plan and its stop keep the limits that are known of its joints and hand.

    Raises:
        InputError: one is passed, or the arm does not reach a place on the pan's path.
    """
    exceeded = follow_plan(model, place, plan).exceeded
    if exceeded:
        worst = exceeded[0]
        raise InputError(
            f"{worst.quantity} of {worst.part} comes to {worst.value:.4g} {worst.unit} at {worst.time:.3f} s, its "
            f"limit is {worst.limit:.4g}; slide-joints shows them all"
        )


def driver(module: str, package: str) -> Any:
    """Import an arm's driver.

    Raises:
        InputError: it is not installed; the line to run is told.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed: pip install {package}") from error


def execute_plan(plan_file: str, arm: str, connect: Callable[[ArmModel, Place], Arm]) -> None:
    """Check a plan against an arm's limits, execute it in open loop, and print how the pan followed.

    Args:
        plan_file: the plan.
        arm: a name, or a file.
        connect: gives the real arm; called once the plan has been found good.

    Raises:
        InputError, FormatError: the plan cannot be executed on this arm.
    """
    model, place = choose(ArmChoice(arm=arm))
    plan = Plan.load(Path(plan_file))
    with reading(plan_file):
        check_plan(plan)
        check_joints(model, place, plan)
    recording = execute(plan, connect(model, place), open_loop(plan))
    rows = Results.of(plan, recording, None).rows[:2] if len(recording) else []
    for name, value in rows:
        print(f"{name}: {value}")
    if recording.interrupted:
        raise KeyboardInterrupt


def way(begin: FloatArray, end: FloatArray) -> Iterator[FloatArray]:
    """Give joint angles (n,) (rad) for each ms of a way from rest to rest, of minimum jerk, at HOMING_SPEED at most."""
    farthest = float(np.abs(end - begin).max())
    samples = max(1, round(1.875 * farthest / HOMING_SPEED / DT))  # the peak speed of this curve is 1.875 the mean
    for x in np.arange(1, samples + 1) / samples:
        yield begin + x**3 * (10.0 - 15.0 * x + 6.0 * x**2) * (end - begin)


class JointArm(ABC):
    """An `Arm` whose driver takes joint angles.

    Args:
        model: of the arm.
        place: where the pan begins; the axes of plans are those of the pan there.
        see: the camera; if None the object counts as lying where it was put, which is enough for open loop.
    """

    period = 1
    """Samples of 1 ms from one command of the driver to the next."""

    def __init__(self, model: ArmModel, place: Place, see: See | None = None) -> None:
        self.model, self.place = model, place
        self._see = see
        self._angle, self._count = place.home, 0
        self._put = np.zeros(4)

    @abstractmethod
    def go_home(self, angle: FloatArray) -> None:
        """Move to joint angles (n,) (rad) slowly, come to rest, and wait until the object is on the pan."""

    @abstractmethod
    def send(self, angle: FloatArray, speed: FloatArray) -> None:
        """Command joint angles and speeds (n,) (rad, rad/s) for one period from now, and wait for that period."""

    @abstractmethod
    def read(self) -> Joints:
        """Return what the joints measure."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the arm; may be called twice."""

    def reset(self, object_position: FloatArray) -> Measured:
        """Bring the pan to where it begins; see `Arm`."""
        self._angle, self._count = self.place.home, 0
        self._put = np.array([*object_position, 0.0, 0.0])
        self.go_home(self.place.home)
        return self._measure()

    def step(self, command: PanCommand) -> Measured:
        """Control the pan for one sample; see `Arm`.

        The driver gets the joint angles for the end of its period, along the acceleration commanded now.
        """
        if self._count % self.period == 0:
            ahead = self.period * DT
            velocity = command.velocity + ahead * command.acceleration
            position = command.position + 0.5 * ahead * (command.velocity + velocity)
            self.send(*self._follow(position, velocity, ahead))
        self._count += 1
        return self._measure()

    def _follow(self, position: FloatArray, velocity: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return joint angles and speeds (n,) for a position and a velocity (3,) of the pan (m, m/s).

        By the same steps as `runtime.arms.motion.follow`, which the joints are checked by.

        Raises:
            InputError: the arm does not reach the place.
        """
        home, attitude = self.place.position, self.place.rotation
        target, speed = home + attitude @ position, np.concatenate([attitude @ velocity, np.zeros(3)])
        angle = self._angle
        for _ in range(CORRECTIONS):
            at, rotation, jacobian = self.model.pan(angle)
            error = pose_error(target, attitude, at, rotation)
            weighted = (jacobian * self.model.weight).T
            inverse = weighted @ np.linalg.pinv(jacobian @ weighted)
            if np.abs(error).max() < CONVERGED:
                break
            angle = angle + inverse @ error
        else:
            raise InputError(f"arm {self.model.arm.name} does not reach {np.round(target, 3).tolist()} m")
        back = HOMING * float(velocity @ velocity) * (self.place.home - angle)
        rate = inverse @ speed + back - inverse @ (jacobian @ back)
        self._angle = angle + ahead * (rate - inverse @ speed)
        return angle, rate

    def _measure(self) -> Measured:
        joints, (home, attitude) = self.read(), (self.place.position, self.place.rotation)
        position, rotation, jacobian = self.model.pan(joints.angle)
        velocity = jacobian[:3] @ joints.speed
        return Measured(
            pan=np.concatenate([attitude.T @ (position - home), attitude.T @ velocity]),
            tilt=float(np.linalg.norm(rotation_vector(attitude @ rotation.T))),
            sliding=self._put if self._see is None else self._see(),
            status=ObjectStatus.ON_PAN,
            torque=joints.torque,
            joint_velocity=joints.speed,
        )

"""The simulated arm: a physics engine, controlled at 1 kHz (Section V-A)."""

from __future__ import annotations

import math

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.bullet.engine import BulletEngine
from runtime.arm.controller import JointLimits, Memory, TaskCommand, control, rotation_vector
from runtime.arm.engine import Camera, Engine, Size
from runtime.arm.interface import Measured, ObjectStatus, PanCommand
from runtime.arm.mujoco.engine import MujocoEngine
from runtime.arm.simulated import Simulated, Simulator
from runtime.arms.description import ArmDescription
from runtime.arms.load import load_arm
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT

SETTLING = 0.4
"""Time for which the arm holds still before t_0 (s): gravity is found by the observer, the object comes to rest."""

TOPPLED_FROM = math.cos(math.radians(45.0))
"""Cosine of the angle between the object's axis and the pan's normal from which it has toppled."""

NORMAL_DROP = 0.5 * g.OBJECT_HEIGHT
"""Depth of the object's centre below its place above the pan (m) at which it is no longer on it."""

FRICTION_ONSET = 0.05
"""Joint speed at which the joints' dry friction is nearly whole (rad/s); tanh of the speed over this."""

NOISE_WINDOW = 0.02
"""Time over which a camera's positions are turned into velocities (s): velocity noise is position noise over this."""


PAPER_ARM = "paper"
"""The arm of Section V."""


def engine_of(settings: Simulated, arm: ArmDescription, home: FloatArray) -> Engine:
    """Return the physics engine that the settings name.

    Args:
        settings: what is varied.
        arm: holds the pan.
        home: (n,) joint angles with the pan level where it begins (rad).

    Raises:
        InputError: the engine refuses the arm.
        MissingExtraError: it is not installed.
    """
    kind = BulletEngine if settings.simulator is Simulator.PYBULLET else MujocoEngine
    return kind(settings, arm, home)


class SimulatedArm:
    """An `Arm` in a physics engine; the engine is started afresh by each `reset`, so that runs repeat bit by bit.

    Args:
        settings: what is varied.
        arm: holds the pan; the paper's if None.
        home: (n,) joint angles with the pan level where it begins (rad); the arm's own if None.

    Raises:
        InputError: the arm has no home and none is given, or the engine refuses it.
        MissingExtraError: the simulator is not installed.
    """

    def __init__(
        self, settings: Simulated = Simulated(), arm: ArmDescription | None = None, home: FloatArray | None = None
    ) -> None:
        self.settings = settings
        self.arm = load_arm(PAPER_ARM) if arm is None else arm
        if home is None:
            if self.arm.home is None:
                raise InputError(f"arm {self.arm.name} has no home: find_place gives one")
            home = np.array(self.arm.home)
        self.engine = engine_of(settings, self.arm, home)
        self._limits = JointLimits.of(self.arm)

    def reset(self, object_position: FloatArray) -> Measured:
        """Start the engine, put the object on the pan and hold still until all is at rest; see `Arm`."""
        self.close()
        self.engine.start(object_position)
        self._state = self.engine.arm()
        self._noise = np.random.default_rng(self.settings.seed)
        self._memory: Memory | None = None
        still = PanCommand(np.zeros(3), np.zeros(3), np.zeros(3))
        for _ in range(round(SETTLING / DT)):
            measured = self.step(still)
        return measured

    def step(self, command: PanCommand) -> Measured:
        """Control the pan for one sample; see `Arm`."""
        engine, settings = self.engine, self.settings
        tick = control(self._task(command), self._state, self._memory, settings.control, self._limits)
        rubbing = settings.joint_friction * np.tanh(self._state.theta_velocity / FRICTION_ONSET)
        engine.advance(tick.torque - rubbing)
        self._memory, self._state = tick.memory, engine.arm()
        return self._measure(tick.torque, tick.limits)

    def close(self) -> None:
        """Stop the engine; see `Arm`."""
        self.engine.stop()

    def camera(self, command: FloatArray | None = None, size: Size | None = None) -> Camera:
        """Return a camera that looks at the arm.

        Args:
            command: (K, 2) where the object should be, relative to the pan (m); None to draw none.
            size: width and height (pixels); None for the engine's own.

        Raises:
            MissingExtraError: nothing here can render.
        """
        return self.engine.camera(command, size)

    def _task(self, command: PanCommand) -> TaskCommand:
        """Return the commanded pose of Eq. 29, its velocity and its acceleration."""
        home, axes = self.engine.home
        velocity, acceleration = np.zeros(6), np.zeros(6)
        velocity[:3], acceleration[:3] = axes @ command.velocity, axes @ command.acceleration
        return TaskCommand(home + axes @ command.position, axes, velocity, acceleration, self.engine.posture)

    def _measure(self, torque: FloatArray, limits: tuple[str, ...]) -> Measured:
        state, (home, axes) = self._state, self.engine.home
        moving = state.jacobian @ state.theta_velocity
        sliding, status = self._see_object(moving)
        return Measured(
            pan=np.concatenate([axes.T @ (state.position - home), axes.T @ moving[:3]]),
            tilt=float(np.linalg.norm(rotation_vector(axes @ state.rotation.T))),
            sliding=sliding,
            status=status,
            torque=torque,
            joint_velocity=state.theta_velocity,
            limits=limits,
        )

    def _see_object(self, moving: FloatArray) -> tuple[FloatArray, ObjectStatus]:
        """Return the object's state in the pan's frame, and its status; `moving` (6,) is the pan's velocity."""
        pan, frame, seen = self._state.position, self._state.rotation, self.engine.object()
        arm = seen.position - pan
        position = frame.T @ arm
        relative = frame.T @ (seen.velocity - moving[:3] - np.cross(moving[3:], arm))
        fallen = position[2] < 0.5 * g.OBJECT_HEIGHT - NORMAL_DROP
        status = ObjectStatus.ON_PAN
        if fallen or math.hypot(position[0], position[1]) > g.PAN_RADIUS:
            status = ObjectStatus.OFF_PAN
        elif float(seen.rotation[:, 2] @ frame[:, 2]) < TOPPLED_FROM:
            status = ObjectStatus.TOPPLED
        state = np.concatenate([position[:2], relative[:2]])
        if self.settings.noise:
            spread = self.settings.noise * np.array([1.0, 1.0, 1.0 / NOISE_WINDOW, 1.0 / NOISE_WINDOW])
            state += spread * self._noise.standard_normal(4)
        return state, status

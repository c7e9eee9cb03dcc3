"""The simulated arm: bodies and kinematics in pybullet, controlled at 1 kHz (Section V-A)."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.controller import (
    FULL_CONTROL,
    ArmState,
    ControlSettings,
    JointLimits,
    Memory,
    TaskCommand,
    control,
    rotation_vector,
)
from runtime.arm.interface import Measured, ObjectStatus, PanCommand
from runtime.arm.urdf import ARM_URDF
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, MissingExtraError, install_line
from runtime.physics.law import DT, GRAVITY

SUBSTEPS = 4
"""Steps of the physics engine in one sample."""

SETTLING = 0.4
"""Time for which the arm holds still before t_0 (s): gravity is found by the observer, the object comes to rest."""

JOINTS = range(6)
PAN_LINK = 5
PAN_CENTRE = [0.0, 0.0, g.HAND]
"""The pan in the frame of its link (m), which is where the Jacobian is asked for; the link state is of the inertia."""

TOPPLED_FROM = math.cos(math.radians(45.0))
"""Cosine of the angle between the object's axis and the pan's normal from which it has toppled."""

NORMAL_DROP = 0.5 * g.OBJECT_HEIGHT
"""Depth of the object's centre below its place above the pan (m) at which it is no longer on it."""

FRICTION_ONSET = 0.05
"""Joint speed at which the joints' dry friction is nearly whole (rad/s); tanh of the speed over this."""

OBJECT_COLOUR = (0.85, 0.25, 0.1, 1.0)
GROUND_COLOUR = (0.62, 0.68, 0.64, 1.0)


@dataclass(frozen=True)
class Simulated:
    """What can be varied about the simulation.

    Attributes:
        control: which parts of the controller act.
        friction: coefficient between pan and object, static and kinetic alike.
        object_mass: (kg).
        noise: standard deviation of the measured object position (m); see `camera_noise`.
        seed: of the noise.
        joint_friction: dry friction of every joint (N m), which the controller does not know of.
        gui: open the simulator's window.
    """

    control: ControlSettings = FULL_CONTROL
    friction: float = 0.5
    object_mass: float = 0.1
    noise: float = 0.0
    seed: int = 0
    joint_friction: float = 0.0
    gui: bool = False

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("friction", 0.0, 10.0, ""),
            ("object_mass", 0.001, 10.0, " kg"),
            ("noise", 0.0, 0.1, " m"),
            ("joint_friction", 0.0, 100.0, " N m"),
        ):
            value = getattr(self, name)
            if not low <= value <= high:  # which a NaN is not either
                words = name.replace("_", " ")
                raise InputError(f"{words} must be between {low:g} and {high:g}{unit}, got {value:g}")
        if self.seed < 0:
            raise InputError(f"seed must be 0 or more, got {self.seed}")


NOISE_WINDOW = 0.02
"""Time over which a camera's positions are turned into velocities (s): velocity noise is position noise over this."""


def import_pybullet() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        with _quiet_stderr():  # it prints when it was built
            import pybullet
    except ImportError as error:
        line = f"the simulated arm needs pybullet: {install_line('pybullet')}"
        if sys.version_info >= (3, 12):
            line += "; in an environment of Python 3.11, since there is no pybullet wheel for newer ones"
        raise MissingExtraError(line) from error
    return pybullet


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Silence what a compiled module prints on standard error."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


class SimulatedArm:
    """An `Arm` in pybullet; the simulator is started afresh by each `reset`, so that runs repeat bit by bit.

    Args:
        settings: what is varied.

    Raises:
        MissingExtraError: pybullet is not installed.
    """

    def __init__(self, settings: Simulated = Simulated()) -> None:
        self.settings = settings
        self.bullet = import_pybullet()
        self.client = -1
        self._limits = JointLimits(np.array(g.TORQUE_LIMITS), np.array(g.SPEED_LIMITS))
        self._home_rotation = _pitch(g.HOME_PITCH)

    def reset(self, object_position: FloatArray) -> Measured:
        """Start the simulator, put the object on the pan and hold still until all is at rest; see `Arm`."""
        self.close()
        self._start()
        self._arm = self._load_arm()
        self._object = self._place_object(object_position)
        self._noise = np.random.default_rng(self.settings.seed)
        self._memory: Memory | None = None
        still = PanCommand(np.zeros(2), np.zeros(2), np.zeros(2))
        for _ in range(round(SETTLING / DT)):
            measured = self.step(still)
        return measured

    def step(self, command: PanCommand) -> Measured:
        """Control the pan for one sample; see `Arm`."""
        tick = control(self._task(command), self._arm_state(), self._memory, self.settings.control, self._limits)
        self._memory = tick.memory
        self._apply(tick.torque)
        self.bullet.stepSimulation(physicsClientId=self.client)
        return self._measure(tick.torque, tick.limits)

    def close(self) -> None:
        """Stop the simulator; see `Arm`."""
        if self.client >= 0:
            self.bullet.disconnect(self.client)
            self.client = -1

    def push(self, force: FloatArray) -> None:
        """Push the object with a horizontal force (2,) (N), in the world, over the next sample."""
        position, _ = self.bullet.getBasePositionAndOrientation(self._object, physicsClientId=self.client)
        self.bullet.applyExternalForce(
            self._object, -1, [*force, 0.0], position, self.bullet.WORLD_FRAME, physicsClientId=self.client
        )

    def set_friction(self, friction: float) -> None:
        """Change the friction coefficient between pan and object."""
        bullet, client = self.bullet, self.client
        bullet.changeDynamics(self._object, -1, lateralFriction=friction / g.PAN_FRICTION, physicsClientId=client)
        # A contact keeps the friction it began with. Setting the collision filter, to what it is, drops the contacts.
        bullet.setCollisionFilterGroupMask(self._object, -1, 1, -1, physicsClientId=client)

    @property
    def object_body(self) -> int:
        """The simulator's number of the object."""
        return self._object

    def pan_pose(self) -> tuple[FloatArray, FloatArray]:
        """Return the pan's centre (3,) in the world (m), and its frame: (3, 3), the columns its axes in the world."""
        link = self.bullet.getLinkState(self._arm, PAN_LINK, computeForwardKinematics=True, physicsClientId=self.client)
        rotation = np.array(self.bullet.getMatrixFromQuaternion(link[1])).reshape(3, 3)
        return np.array(link[0]), rotation @ self._home_rotation.T

    def _start(self) -> None:
        bullet = self.bullet
        self.client = bullet.connect(bullet.GUI if self.settings.gui else bullet.DIRECT)
        if self.client < 0:
            raise InputError("the simulator's window cannot be opened")
        client = self.client
        bullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=client)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=DT, numSubSteps=SUBSTEPS, deterministicOverlappingPairs=1, physicsClientId=client
        )
        ground = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=client)
        # Offscreen, the camera paints the ground, since rendering it would take half of the time; the speck drawn
        # there, inside the arm's base, keeps the engine from drawing a plane of its own.
        extent = 3.0 if self.settings.gui else 0.001
        drawn = bullet.createVisualShape(
            bullet.GEOM_BOX,
            halfExtents=[extent, extent, 0.001],
            visualFramePosition=[0.0, 0.0, -0.001],
            rgbaColor=GROUND_COLOUR,
            physicsClientId=client,
        )
        bullet.createMultiBody(0.0, ground, drawn, physicsClientId=client)

    def _load_arm(self) -> int:
        """Load the arm at home, its motors off and nothing damped, so that torques alone move it."""
        bullet, client = self.bullet, self.client
        flags = bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_USE_IMPLICIT_CYLINDER
        arm: int = bullet.loadURDF(str(ARM_URDF), useFixedBase=True, flags=flags, physicsClientId=client)
        for joint, angle in enumerate(g.home_angles()):
            bullet.resetJointState(arm, joint, angle, physicsClientId=client)
        for link in range(-1, len(JOINTS)):
            bullet.changeDynamics(
                arm, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client
            )
        bullet.changeDynamics(arm, PAN_LINK, lateralFriction=g.PAN_FRICTION, physicsClientId=client)
        bullet.setJointMotorControlArray(
            arm, JOINTS, bullet.VELOCITY_CONTROL, forces=[0.0] * len(JOINTS), physicsClientId=client
        )
        return arm

    def _place_object(self, position: FloatArray) -> int:
        bullet, client = self.bullet, self.client
        size = {"radius": g.OBJECT_RADIUS, "physicsClientId": client}
        x, y, z = g.HOME_POSITION
        placed: int = bullet.createMultiBody(
            self.settings.object_mass,
            bullet.createCollisionShape(bullet.GEOM_CYLINDER, height=g.OBJECT_HEIGHT, **size),
            bullet.createVisualShape(bullet.GEOM_CYLINDER, length=g.OBJECT_HEIGHT, rgbaColor=OBJECT_COLOUR, **size),
            basePosition=[x + float(position[0]), y + float(position[1]), z + 0.5 * g.OBJECT_HEIGHT],
            physicsClientId=client,
        )
        bullet.changeDynamics(
            placed,
            -1,
            lateralFriction=self.settings.friction / g.PAN_FRICTION,
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=client,
        )
        return placed

    def _task(self, command: PanCommand) -> TaskCommand:
        """Return the commanded pose of Eq. 29, its velocity and its acceleration."""
        position = np.array(g.HOME_POSITION)
        position[:2] += command.position
        velocity, acceleration = np.zeros(6), np.zeros(6)
        velocity[:2], acceleration[:2] = command.velocity, command.acceleration
        return TaskCommand(position, self._home_rotation, velocity, acceleration)

    def _arm_state(self) -> ArmState:
        bullet, client, arm = self.bullet, self.client, self._arm
        joints = bullet.getJointStates(arm, JOINTS, physicsClientId=client)
        theta = [joint[0] for joint in joints]
        speed = [joint[1] for joint in joints]
        zero = [0.0] * len(JOINTS)
        link = bullet.getLinkState(arm, PAN_LINK, computeForwardKinematics=True, physicsClientId=client)
        jacobian = bullet.calculateJacobian(arm, PAN_LINK, PAN_CENTRE, theta, speed, zero, physicsClientId=client)
        return ArmState(
            theta_velocity=np.array(speed),
            position=np.array(link[0]),
            rotation=np.array(bullet.getMatrixFromQuaternion(link[1])).reshape(3, 3),
            jacobian=np.array(jacobian).reshape(6, 6),
            inertia=np.array(bullet.calculateMassMatrix(arm, theta, physicsClientId=client)),
            bias=np.array(bullet.calculateInverseDynamics(arm, theta, speed, zero, physicsClientId=client)),
        )

    def _apply(self, torque: FloatArray) -> None:
        bullet, client = self.bullet, self.client
        if self.settings.joint_friction:
            joints = bullet.getJointStates(self._arm, JOINTS, physicsClientId=client)
            speed = np.array([joint[1] for joint in joints])
            torque = torque - self.settings.joint_friction * np.tanh(speed / FRICTION_ONSET)
        bullet.setJointMotorControlArray(
            self._arm, JOINTS, bullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=client
        )

    def _measure(self, torque: FloatArray, limits: tuple[str, ...]) -> Measured:
        bullet, client = self.bullet, self.client
        link = bullet.getLinkState(
            self._arm, PAN_LINK, computeLinkVelocity=True, computeForwardKinematics=True, physicsClientId=client
        )
        joints = bullet.getJointStates(self._arm, JOINTS, physicsClientId=client)
        position, velocity, turning = np.array(link[0]), np.array(link[6]), np.array(link[7])
        rotation = np.array(bullet.getMatrixFromQuaternion(link[1])).reshape(3, 3)
        offset = position - g.HOME_POSITION
        sliding, status = self._see_object(position, rotation @ self._home_rotation.T, velocity, turning)
        return Measured(
            pan=np.concatenate([offset[:2], velocity[:2]]),
            height=float(offset[2]),
            tilt=float(np.linalg.norm(rotation_vector(self._home_rotation @ rotation.T))),
            sliding=sliding,
            status=status,
            torque=torque,
            joint_velocity=np.array([joint[1] for joint in joints]),
            limits=limits,
        )

    def _see_object(
        self, pan: FloatArray, frame: FloatArray, velocity: FloatArray, turning: FloatArray
    ) -> tuple[FloatArray, ObjectStatus]:
        """Return the object's state in the pan's frame, whose axes are the columns of `frame`, and its status."""
        bullet, client = self.bullet, self.client
        place, attitude = bullet.getBasePositionAndOrientation(self._object, physicsClientId=client)
        speed, _ = bullet.getBaseVelocity(self._object, physicsClientId=client)
        arm = np.array(place) - pan
        position = frame.T @ arm
        relative = frame.T @ (np.array(speed) - velocity - np.cross(turning, arm))
        axis = np.array(bullet.getMatrixFromQuaternion(attitude)).reshape(3, 3)[:, 2]
        fallen = position[2] < 0.5 * g.OBJECT_HEIGHT - NORMAL_DROP
        status = ObjectStatus.ON_PAN
        if fallen or math.hypot(position[0], position[1]) > g.PAN_RADIUS:
            status = ObjectStatus.OFF_PAN
        elif float(axis @ frame[:, 2]) < TOPPLED_FROM:
            status = ObjectStatus.TOPPLED
        state = np.concatenate([position[:2], relative[:2]])
        if self.settings.noise:
            spread = self.settings.noise * np.array([1.0, 1.0, 1.0 / NOISE_WINDOW, 1.0 / NOISE_WINDOW])
            state += spread * self._noise.standard_normal(4)
        return state, status


def _pitch(angle: float) -> FloatArray:
    """Return the rotation by `angle` (rad) about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

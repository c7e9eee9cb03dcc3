"""Bodies and kinematics of the arm in pybullet."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.bullet.camera import BulletCamera
from runtime.arm.bullet.urdf import arm_urdf, pan_in_hand
from runtime.arm.controller import ArmState
from runtime.arm.engine import Body, Pose, Size
from runtime.arm.simulated import Simulated
from runtime.arms.description import ArmDescription
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, MissingExtraError, install_line
from runtime.physics.law import DT, GRAVITY

SUBSTEPS = 4
"""Steps of the physics engine in one sample."""

OBJECT_COLOUR = (0.85, 0.25, 0.1, 1.0)
GROUND_COLOUR = (0.62, 0.68, 0.64, 1.0)


def import_pybullet() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        with _quiet_stderr():  # it prints when it was built
            import pybullet
    except ImportError as error:
        line = f"the arm in pybullet needs pybullet: {install_line('pybullet')}"
        if sys.version_info >= (3, 12):
            line += "; pip builds it on this Python, in a quarter of an hour, or use --simulator mujoco"
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


class BulletEngine:
    """An `Engine` in pybullet.

    Args:
        settings: what is varied.
        arm: holds the pan.
        home: (n,) joint angles with the pan level where it begins (rad).

    Raises:
        MissingExtraError: pybullet is not installed.
    """

    def __init__(self, settings: Simulated, arm: ArmDescription, home: FloatArray) -> None:
        self.settings = settings
        self.bullet = import_pybullet()
        self.client = self.body = self.object_body = -1
        self.posture, self.home = home, Pose(np.zeros(3), np.eye(3))
        self._urdf, self._joints, self._hand = arm_urdf(arm), range(len(arm)), len(arm) - 1
        held = pan_in_hand(arm)
        self._held = Pose(np.array(held.position), held.rotation)

    def start(self, object_position: FloatArray) -> None:
        """Start the simulator, with the arm at home; see `Engine`."""
        self._connect()
        self.body = self._load_arm()
        self.home = self.pan()
        self.object_body = self._place_object(object_position)

    def arm(self) -> ArmState:
        """Return the arm as it is now; see `Engine`."""
        bullet, client, arm = self.bullet, self.client, self.body
        joints = bullet.getJointStates(arm, self._joints, physicsClientId=client)
        theta = [joint[0] for joint in joints]
        speed = [joint[1] for joint in joints]
        zero, origin = [0.0] * len(theta), [0.0, 0.0, 0.0]
        of_link = bullet.calculateJacobian(arm, self._hand, origin, theta, speed, zero, physicsClientId=client)
        jacobian, pan = np.array(of_link).reshape(6, -1), self.pan()
        # Asked for another point than the link's origin, it would turn that point with the axes of the link's inertia.
        lever = pan.rotation @ self._held.rotation.T @ self._held.position
        jacobian[:3] += np.cross(jacobian[3:], lever, axis=0, axisb=0)
        return ArmState(
            theta=np.array(theta),
            theta_velocity=np.array(speed),
            position=pan.position,
            rotation=pan.rotation,
            jacobian=jacobian,
            inertia=np.array(bullet.calculateMassMatrix(arm, theta, physicsClientId=client)),
            bias=np.array(bullet.calculateInverseDynamics(arm, theta, speed, zero, physicsClientId=client)),
        )

    def pan(self) -> Pose:
        """Return where the pan is now."""
        link = self.bullet.getLinkState(
            self.body, self._hand, computeForwardKinematics=True, physicsClientId=self.client
        )
        position, attitude = link[4:6]  # of the link's frame; the first two are of its inertia
        rotation = np.array(self.bullet.getMatrixFromQuaternion(attitude)).reshape(3, 3)
        return Pose(np.array(position) + rotation @ self._held.position, rotation @ self._held.rotation)

    def object(self) -> Body:
        """Return the object as it is now; see `Engine`."""
        bullet, client = self.bullet, self.client
        place, attitude = bullet.getBasePositionAndOrientation(self.object_body, physicsClientId=client)
        velocity, turning = bullet.getBaseVelocity(self.object_body, physicsClientId=client)
        rotation = np.array(bullet.getMatrixFromQuaternion(attitude)).reshape(3, 3)
        return Body(np.array(place), rotation, np.array(velocity), np.array(turning))

    def advance(self, torque: FloatArray) -> None:
        """Advance by one sample; see `Engine`."""
        bullet, client = self.bullet, self.client
        bullet.setJointMotorControlArray(
            self.body, self._joints, bullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=client
        )
        bullet.stepSimulation(physicsClientId=client)

    def push(self, force: FloatArray) -> None:
        """Push the object over the next sample; see `Engine`."""
        position, _ = self.bullet.getBasePositionAndOrientation(self.object_body, physicsClientId=self.client)
        self.bullet.applyExternalForce(
            self.object_body, -1, [*force, 0.0], position, self.bullet.WORLD_FRAME, physicsClientId=self.client
        )

    def set_friction(self, friction: float) -> None:
        """Change the friction coefficient between pan and object; see `Engine`."""
        bullet, client, body = self.bullet, self.client, self.object_body
        bullet.changeDynamics(body, -1, lateralFriction=friction / g.PAN_FRICTION, physicsClientId=client)
        # A contact keeps the friction it began with. Setting the collision filter, to what it is, drops the contacts.
        bullet.setCollisionFilterGroupMask(body, -1, 1, -1, physicsClientId=client)

    def camera(self, command: FloatArray | None, size: Size | None) -> BulletCamera:
        """Return a camera that looks at the arm; see `Engine`."""
        return BulletCamera(self, command, size)

    def stop(self) -> None:
        """Stop the simulator; see `Engine`."""
        if self.client >= 0:
            self.bullet.disconnect(self.client)
            self.client = -1

    def _connect(self) -> None:
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
        with TemporaryDirectory() as folder:
            path = Path(folder) / "arm.urdf"
            path.write_text(self._urdf, encoding="utf-8")
            arm: int = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        for joint, angle in enumerate(self.posture.tolist()):
            bullet.resetJointState(arm, joint, angle, physicsClientId=client)
        for link in (-1, *self._joints):
            bullet.changeDynamics(
                arm, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client
            )
        bullet.changeDynamics(arm, self._hand, lateralFriction=g.PAN_FRICTION, physicsClientId=client)
        bullet.setJointMotorControlArray(
            arm, self._joints, bullet.VELOCITY_CONTROL, forces=[0.0] * len(self._joints), physicsClientId=client
        )
        return arm

    def _place_object(self, position: FloatArray) -> int:
        bullet, client = self.bullet, self.client
        size = {"radius": g.OBJECT_RADIUS, "physicsClientId": client}
        home, axes = self.home
        place = home + axes @ [float(position[0]), float(position[1]), 0.5 * g.OBJECT_HEIGHT]
        placed: int = bullet.createMultiBody(
            self.settings.object_mass,
            bullet.createCollisionShape(bullet.GEOM_CYLINDER, height=g.OBJECT_HEIGHT, **size),
            bullet.createVisualShape(bullet.GEOM_CYLINDER, length=g.OBJECT_HEIGHT, rgbaColor=OBJECT_COLOUR, **size),
            basePosition=place.tolist(),
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

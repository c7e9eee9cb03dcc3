"""Bodies and kinematics of the arm in pybullet."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.bullet.camera import BulletCamera
from runtime.arm.controller import ArmState, JointLimits
from runtime.arm.engine import Body, Pose, Size
from runtime.arm.simulated import Simulated
from runtime.arm.urdf import ARM_URDF
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, MissingExtraError, install_line
from runtime.physics.law import DT, GRAVITY

SUBSTEPS = 4
"""Steps of the physics engine in one sample."""

JOINTS = range(6)
PAN_LINK = 5
PAN_CENTRE = [0.0, 0.0, g.HAND]
"""The pan in the frame of its link (m), which is where the Jacobian is asked for; the link state is of the inertia."""

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

    Raises:
        MissingExtraError: pybullet is not installed.
    """

    def __init__(self, settings: Simulated) -> None:
        self.settings = settings
        self.bullet = import_pybullet()
        self.client = self.body = self.object_body = -1
        self.home = Pose(np.array(g.HOME_POSITION), np.eye(3))
        self.posture = np.array(g.home_angles())
        self.limits = JointLimits(np.array(g.TORQUE_LIMITS), np.array(g.SPEED_LIMITS))
        self._hand_to_pan = np.array(g.PAN_IN_HAND)

    def start(self, object_position: FloatArray) -> None:
        """Start the simulator, with the arm at home; see `Engine`."""
        self._connect()
        self.body = self._load_arm()
        self.object_body = self._place_object(object_position)

    def arm(self) -> ArmState:
        """Return the arm as it is now; see `Engine`."""
        bullet, client, arm = self.bullet, self.client, self.body
        joints = bullet.getJointStates(arm, JOINTS, physicsClientId=client)
        theta = [joint[0] for joint in joints]
        speed = [joint[1] for joint in joints]
        zero = [0.0] * len(JOINTS)
        jacobian = bullet.calculateJacobian(arm, PAN_LINK, PAN_CENTRE, theta, speed, zero, physicsClientId=client)
        pan = self.pan()
        return ArmState(
            theta=np.array(theta),
            theta_velocity=np.array(speed),
            position=pan.position,
            rotation=pan.rotation,
            jacobian=np.array(jacobian).reshape(6, 6),
            inertia=np.array(bullet.calculateMassMatrix(arm, theta, physicsClientId=client)),
            bias=np.array(bullet.calculateInverseDynamics(arm, theta, speed, zero, physicsClientId=client)),
        )

    def pan(self) -> Pose:
        """Return where the pan is now."""
        link = self.bullet.getLinkState(self.body, PAN_LINK, computeForwardKinematics=True, physicsClientId=self.client)
        rotation = np.array(self.bullet.getMatrixFromQuaternion(link[1])).reshape(3, 3)
        return Pose(np.array(link[0]), rotation @ self._hand_to_pan)

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
            self.body, JOINTS, bullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=client
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
        arm: int = bullet.loadURDF(str(ARM_URDF), useFixedBase=True, flags=flags, physicsClientId=client)
        for joint, angle in enumerate(self.posture.tolist()):
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

"""Bodies and kinematics of the arm in MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.controller import ArmState
from runtime.arm.engine import Body, Pose, Size
from runtime.arm.mujoco.camera import MujocoCamera
from runtime.arm.mujoco.contact import SUBSTEPS
from runtime.arm.mujoco.library import import_mujoco
from runtime.arm.mujoco.scene import build, stand_on_ground
from runtime.arm.simulated import Simulated
from runtime.arms.description import ArmDescription
from runtime.arms.model import PAN_SITE
from runtime.documents.checks import FloatArray

SHOWN_EVERY = 16
"""Samples between two pictures in the window: 60 a second."""


class MujocoEngine:
    """An `Engine` in MuJoCo.

    Args:
        settings: what is varied.
        arm: holds the pan.
        home: (n,) joint angles with the pan level where it begins (rad).

    Raises:
        InputError: mujoco refuses the arm.
        MissingExtraError: mujoco is not installed.
    """

    def __init__(self, settings: Simulated, arm: ArmDescription, home: FloatArray) -> None:
        self.settings = settings
        self.mujoco = import_mujoco()
        self.posture, self.home = home, Pose(np.zeros(3), np.eye(3))
        self.model = build(self.mujoco, arm, settings.friction, settings.object_mass)
        self.data = self.mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in arm.joint_names]
        self._angles = np.array([joint.qposadr[0] for joint in joints])
        self._speeds = np.array([joint.dofadr[0] for joint in joints])
        self._site = self.model.site(PAN_SITE).id
        self._object = self.model.body("object").id
        placed = self.model.joint(self.model.body_jntadr[self._object])
        self._placed, self._moving = int(placed.qposadr[0]), int(placed.dofadr[0])
        self._window: Any = None
        self._count = 0
        self.data.qpos[self._angles] = home  # so that a camera that is made now finds the arm
        self.mujoco.mj_kinematics(self.model, self.data)
        stand_on_ground(self.model, self.data)

    def start(self, object_position: FloatArray) -> None:
        """Put the arm at home and the object on the pan; see `Engine`."""
        mujoco, model = self.mujoco, self.model
        self.set_friction(self.settings.friction)
        self.data = data = mujoco.MjData(model)
        self._count = 0
        data.qpos[self._angles] = self.posture
        mujoco.mj_kinematics(model, data)
        place, attitude = data.site_xpos[self._site], data.site_xmat[self._site]
        home, axes = self.home = Pose(place.copy(), attitude.reshape(3, 3).copy())
        offset = axes @ [float(object_position[0]), float(object_position[1]), 0.5 * g.OBJECT_HEIGHT]
        data.qpos[self._placed : self._placed + 3] = home + offset
        mujoco.mj_step1(model, data)
        if self.settings.gui:
            from mujoco import viewer

            self._window = viewer.launch_passive(model, data)

    def arm(self) -> ArmState:
        """Return the arm as it is now; see `Engine`."""
        mujoco, model, data, speeds = self.mujoco, self.model, self.data, self._speeds
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
        return ArmState(
            theta=data.qpos[self._angles],
            theta_velocity=data.qvel[speeds],
            position=data.site_xpos[self._site].copy(),
            rotation=data.site_xmat[self._site].reshape(3, 3).copy(),
            jacobian=jacobian[:, speeds],
            inertia=self._inertia(),
            bias=(data.qfrc_bias - data.qfrc_passive)[speeds],
        )

    def object(self) -> Body:
        """Return the object as it is now; see `Engine`."""
        data, at = self.data, self._moving
        rotation = data.xmat[self._object].reshape(3, 3).copy()
        velocity, turning = data.qvel[at : at + 3].copy(), rotation @ data.qvel[at + 3 : at + 6]
        return Body(data.xpos[self._object].copy(), rotation, velocity, turning)

    def advance(self, torque: FloatArray) -> None:
        """Advance by one sample; see `Engine`.

        What depends on the state is computed at the end, for whoever looks, and the next sample begins after it.
        """
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qfrc_applied[self._speeds] = torque
        mujoco.mj_step2(model, data)
        mujoco.mj_step(model, data, SUBSTEPS - 1)
        data.xfrc_applied[self._object] = 0.0
        mujoco.mj_step1(model, data)
        self._count += 1
        if self._window is not None and self._count % SHOWN_EVERY == 0:
            self._window.sync()

    def push(self, force: FloatArray) -> None:
        """Push the object over the next sample; see `Engine`."""
        self.data.xfrc_applied[self._object, :2] = force

    def set_friction(self, friction: float) -> None:
        """Change the friction coefficient between pan and object; see `Engine`."""
        self.model.geom_friction[self.model.geom_bodyid == self._object, 0] = friction

    def camera(self, command: FloatArray | None, size: Size | None) -> MujocoCamera:
        """Return a camera that looks at the arm; see `Engine`."""
        return MujocoCamera(self, command, size)

    def stop(self) -> None:
        """Close the window; see `Engine`."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _inertia(self) -> FloatArray:
        """Return the joints' inertia matrix, column by column: the function for the whole changed with version 4."""
        joints = len(self._speeds)
        inertia, column = np.empty((joints, joints)), np.empty(self.model.nv)
        for index, dof in enumerate(self._speeds):
            unit = np.zeros(self.model.nv)
            unit[dof] = 1.0
            self.mujoco.mj_mulM(self.model, self.data, column, unit)
            inertia[:, index] = column[self._speeds]
        return inertia

"""An arm in mujoco: the model that kinematics, dynamics and simulation share."""

from __future__ import annotations

from typing import Any

import numpy as np

from runtime.arms.description import ArmDescription
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, extra
from runtime.physics.law import DT, GRAVITY
from runtime.sizes import Sizes

PAN_BODY = "pan"
PAN_SITE = "pan_centre"
PAN_SPACE = 0.1
"""Height of the space above the pan that belongs to it and the object (m)."""

SINGULAR = 1e-6
"""Smallest singular value of a Jacobian that is taken for invertible (m or 1 per rad)."""

SHORTEST_SHAPE = 1e-3
"""Length below which a link is drawn without a capsule (m)."""


def arm_spec(arm: ArmDescription) -> Any:
    """Return the arm as a `mujoco.MjSpec`, to which a pan, an object and a floor can be added.

    The bodies are the links, named as their joints; the links are drawn as capsules, which touch nothing. The body
    PAN_BODY is fixed to the last link, with the mass of the mounted pan and the site PAN_SITE in its centre, z up from
    the pan. Motors of the joints' names drive them, within the torque limits that are known.

    Raises:
        MissingExtraError: mujoco is not installed.
    """
    with extra("mujoco"):
        import mujoco
    spec = mujoco.MjSpec()
    spec.modelname = arm.name
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True  # inertias of robots' files are often not quite those of a body
    spec.option.timestep = DT
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    body = spec.worldbody
    for index, joint in enumerate(arm.joints):
        body = body.add_body(name=joint.name, pos=joint.frame.position, quat=joint.frame.quaternion)
        body.explicitinertial = True
        body.mass = joint.body.mass
        body.ipos = joint.body.centre
        body.fullinertia = joint.body.inertia
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.sliding else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        ahead = arm.joints[index + 1].frame.position if index + 1 < len(arm) else arm.tip.position
        body.add_geom(
            name=f"{joint.name} joint",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[1.15 * joint.radius, 0.0, 0.0],
            contype=0,
            conaffinity=0,
            mass=0.0,
        )
        if float(np.linalg.norm(ahead)) > SHORTEST_SHAPE:
            body.add_geom(
                name=f"{joint.name} link",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.0, 0.0, 0.0, *ahead],
                size=[joint.radius, 0.0, 0.0],
                contype=0,
                conaffinity=0,
                mass=0.0,
            )
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if joint.torque is not None:
            motor.forcelimited = True
            motor.forcerange = [-joint.torque, joint.torque]
    tip = body.add_body(name="tip", pos=arm.tip.position, quat=arm.tip.quaternion)
    pan = tip.add_body(name=PAN_BODY, pos=arm.mount.position, quat=arm.mount.quaternion)
    if arm.pan.mass:
        pan.explicitinertial = True
        pan.mass = arm.pan.mass
        pan.ipos = arm.pan.centre
        pan.fullinertia = arm.pan.inertia
    pan.add_site(name=PAN_SITE)
    return spec


def _add_clearance(spec: Any, mujoco: Any) -> None:
    """Add the space that the pan and the object on it take, as a shape that touches nothing."""
    half = 0.5 * PAN_SPACE
    spec.body(PAN_BODY).add_geom(
        name=PAN_BODY,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[Sizes().pan_radius, half, 0.0],
        pos=[0.0, 0.0, half],
        contype=0,
        conaffinity=0,
        mass=0.0,
    )


def pose_error(target: FloatArray, attitude: FloatArray, position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return (6,) what leads from a pose to a target near it: a way (m) and a rotation vector (rad), in the world.

    Args:
        target: (3,) where it is to be.
        attitude: (3, 3) how it is to stand.
        position, rotation: where and how it is.
    """
    error = np.empty(6)
    error[:3] = target - position
    turn = attitude @ rotation.T
    error[3:] = (
        0.5 * turn[2, 1] - 0.5 * turn[1, 2],
        0.5 * turn[0, 2] - 0.5 * turn[2, 0],
        0.5 * turn[1, 0] - 0.5 * turn[0, 1],
    )
    return error


def _weight(arm: ArmDescription) -> FloatArray:
    """Return (n,) how much each joint is to take of a motion: the square of the acceleration that it may make."""
    limit = arm.limit("acceleration")
    known = np.isfinite(limit)
    if not known.any():
        return np.ones(len(arm))
    most = limit[known].max()
    weight: FloatArray = (np.where(known, limit, most) / most) ** 2
    return weight


class ArmModel:
    """Kinematics and dynamics of an arm that holds a pan; joint angles in rad, in the order of its joints.

    Not for several threads at once.

    Attributes:
        arm: its description.
        model: mujoco's.
        data: mujoco's, scratch space of every call.
        weight: (n,) how much each joint takes of a motion, where there is a choice.

    Args:
        arm: its description.

    Raises:
        InputError: mujoco refuses it.
        MissingExtraError: mujoco is not installed.
    """

    def __init__(self, arm: ArmDescription) -> None:
        with extra("mujoco"):
            import mujoco
        self.arm = arm
        self._mujoco = mujoco
        spec = arm_spec(arm)
        _add_clearance(spec, mujoco)
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise InputError(f"arm {arm.name}: {' '.join(str(error).split())}") from error
        self.data = mujoco.MjData(self.model)
        self._site = self.model.site(PAN_SITE).id
        before = {self.model.body(joint.name).id for joint in arm.joints[:-3]}
        self._links = [geom for geom in range(self.model.ngeom) if self.model.geom_bodyid[geom] in before]
        self.weight = _weight(arm)
        self._jacobian = np.zeros((6, self.model.nv))

    def pan(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where the pan is and how it moves with the joints.

        Args:
            q: (n,) joint angles.

        Returns:
            Position (3,) of the pan's centre (m), attitude (3, 3) of the pan, and Jacobian (6, n) to its velocity
            (m/s) and angular velocity (rad/s) in the world; views that the next call overwrites.
        """
        mujoco, data = self._mujoco, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_jacSite(self.model, data, self._jacobian[:3], self._jacobian[3:], self._site)
        return data.site_xpos[self._site], data.site_xmat[self._site].reshape(3, 3), self._jacobian

    def inverse(self, q: FloatArray) -> tuple[FloatArray, float]:
        """Return how the joints move the pan, at angles q (n,).

        Returns:
            (n, 6) from the pan's velocity (m/s) and angular velocity (rad/s) to joint speeds, those of the least norm
            in which joints count by their `weight`; and the smallest singular value of the Jacobian (m or 1 per rad),
            0 if there is no such inverse.
        """
        jacobian = self.pan(q)[2]
        smallest = float(np.linalg.svd(jacobian, compute_uv=False)[-1])
        if smallest < SINGULAR:
            return np.full((len(q), 6), np.inf), 0.0
        weighted = jacobian * self.weight
        return np.asarray(np.linalg.solve(weighted @ jacobian.T, weighted).T, dtype=np.float64), smallest

    def clear(self, q: FloatArray, distance: float) -> bool:
        """Tell whether the pan is farther than a distance (m) from all links but the last three, at angles q (n,)."""
        mujoco, data = self._mujoco, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(self.model, data)
        pan, far = self.model.geom(PAN_BODY).id, 2.0 * distance
        return all(mujoco.mj_geomDistance(self.model, data, geom, pan, far, None) > distance for geom in self._links)

    def torque(self, q: FloatArray, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torques (k, n) (N m) of a motion: joint angles, speeds and accelerations, each (k, n)."""
        mujoco, data = self._mujoco, self.data
        torque = np.empty_like(q)
        for k in range(len(q)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[k], speed[k], acceleration[k]
            mujoco.mj_inverse(self.model, data)
            torque[k] = data.qfrc_inverse
        return torque

    def inertia(self, q: FloatArray) -> FloatArray:
        """Return the inertia matrix (n, n) (kg m^2) at joint angles q (n,)."""
        mujoco, data = self._mujoco, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_makeM(self.model, data)
        matrix = np.empty((self.model.nv, self.model.nv))
        for row, unit in zip(
            matrix, np.eye(self.model.nv), strict=True
        ):  # mj_fullM is another one in mujoco 4 than in 3
            mujoco.mj_mulM(self.model, data, row, unit)
        return matrix

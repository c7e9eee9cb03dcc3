"""Reads an MJCF file with mujoco: its bodies, joints, inertias and limits. Meshes are left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from runtime.arms.description import NOTHING, Body, Frame, Joint
from runtime.arms.tree import Link
from runtime.arms.urdf import Robot
from runtime.documents.checks import FloatArray
from runtime.errors import InputError, extra


def read_mjcf(path: Path) -> Robot:
    """Read an MJCF file, with what it includes.

    Each body is a link, and so is each site, fixed to its body: a tip may be either. Speed, acceleration and jerk have
    no place in the format; torque is the actuators' force range where they drive one joint each.

    Raises:
        InputError: mujoco refuses the file, or a number in it is NaN. A joint that neither turns nor slides is refused
            where it is part of the arm, not where it carries an object beside it.
        MissingExtraError: mujoco is not installed.
    """
    with extra("mujoco"):
        import mujoco
    warnings: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)  # else they go to the terminal, and to a file MUJOCO_LOG.TXT
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _drop_meshes(spec, mujoco)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"not a model that mujoco reads: {' '.join(str(error).split())}") from error
    finally:
        mujoco.set_mju_user_warning(before)
    if any("NaN" in warning for warning in warnings):
        raise InputError("a number in it is NaN")
    names = ["world", *(model.body(index).name or f"body{index}" for index in range(1, model.nbody))]
    torque = _torques(model, mujoco)
    links: dict[str, Link] = {}
    for index, name in enumerate(names):
        body = _body(model, index, mujoco)
        frame = Frame.of(model.body_pos[index], _rotation(model.body_quat[index], mujoco))
        parent = None if index == 0 else names[int(model.body_parentid[index])]
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        for joint in range(first, first + count):  # a link without mass that turns about the joint's anchor
            anchor = model.jnt_pos[joint]
            at_anchor = Frame.of(np.array(frame.position) + frame.rotation @ anchor, frame.rotation)
            name_of_joint = f"{name} (joint)" if joint == first else f"{name} (joint {joint - first + 1})"
            links[name_of_joint] = _joint_link(parent, at_anchor, model, joint, torque, mujoco)
            parent, frame = name_of_joint, Frame.of(-anchor, np.eye(3))
        links[name] = Link(parent, frame, body, None)
    for index in range(model.nsite):
        site = model.site(index).name
        if site and site not in links:
            frame = Frame.of(model.site_pos[index], _rotation(model.site_quat[index], mujoco))
            links[site] = Link(names[int(model.site_bodyid[index])], frame, NOTHING, None)
    return Robot(spec.modelname or path.stem, links)


def _drop_meshes(spec: Any, mujoco: Any) -> None:
    """Take out shapes made of files, what is made of them, and what needs none: contacts, sensors, key frames."""
    from_files = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
    for geom in list(spec.geoms):
        if geom.type in from_files or geom.meshname:
            spec.delete(geom)
    for group in (spec.sensors, spec.keys, spec.excludes, spec.pairs, spec.skins, spec.meshes, spec.hfields):
        for element in list(group):
            spec.delete(element)
    for geom in spec.geoms:
        geom.material = ""
    for site in spec.sites:
        site.material = ""
    for element in [*spec.materials, *spec.textures]:
        spec.delete(element)
    spec.compiler.balanceinertia = True


def _body(model: Any, index: int, mujoco: Any) -> Body:
    mass = float(model.body_mass[index])
    if mass == 0.0:
        return NOTHING
    rotation = _rotation(model.body_iquat[index], mujoco)
    return Body.of(mass, model.body_ipos[index], rotation @ np.diag(model.body_inertia[index]) @ rotation.T)


def _rotation(quaternion: FloatArray, mujoco: Any) -> FloatArray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _torques(model: Any, mujoco: Any) -> dict[int, float]:
    """Return the largest torque that the joints' limits and actuators allow, by the joint's index, where it is told."""
    found: dict[int, float] = {}
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            found[joint] = float(np.abs(model.jnt_actfrcrange[joint]).max())
    for actuator in range(model.nu):
        driven = int(model.actuator_trnid[actuator, 0])
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_forcelimited[actuator]:
            gear = abs(float(model.actuator_gear[actuator, 0]))
            found.setdefault(driven, gear * float(np.abs(model.actuator_forcerange[actuator]).max()))
    return found


def _joint_link(
    parent: str | None, frame: Frame, model: Any, index: int, torque: dict[int, float], mujoco: Any
) -> Link:
    """Return the link that a joint moves, without the body on it."""
    name = model.joint(index).name or f"joint{index + 1}"
    kind, at_zero = int(model.jnt_type[index]), float(model.qpos0[model.jnt_qposadr[index]])
    if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        return Link(parent, frame, NOTHING, None, refused=f"joint {name} neither turns nor slides")
    refused = f"joint {name} has the reference {at_zero:g}; only 0 is read" if at_zero else None
    ranged = bool(model.jnt_limited[index])
    lower, upper = (float(value) for value in model.jnt_range[index])
    x, y, z = (float(value) for value in model.jnt_axis[index])
    joint = Joint(
        name,
        Frame(),
        NOTHING,
        (x, y, z),
        kind == mujoco.mjtJoint.mjJNT_SLIDE,
        lower=lower if ranged else None,
        upper=upper if ranged else None,
        torque=torque.get(index),
    )
    return Link(parent, frame, NOTHING, joint, refused=refused)

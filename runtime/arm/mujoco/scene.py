"""The scene: an arm with the pan in its hand, the object on the pan, and what is only there to be seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.mujoco import contact
from runtime.arms.description import ArmDescription, Frame
from runtime.arms.model import PAN_BODY, arm_spec
from runtime.documents.checks import FloatArray
from runtime.errors import InputError

BOTTOM, RIM, GROUND = 1, 2, 4
"""What the object touches: the pan's bottom with its balls, the rim and the ground with its side."""

PAN_COLOUR = (0.16, 0.17, 0.19, 1.0)
HANDLE_COLOUR = (0.10, 0.10, 0.11, 1.0)
LINK_COLOUR = (0.86, 0.87, 0.89, 1.0)
JOINT_COLOUR = (0.20, 0.36, 0.58, 1.0)
POST_COLOUR = (0.45, 0.47, 0.49)
OBJECT_COLOUR = (0.93, 0.42, 0.10, 1.0)
CAP_COLOUR = (0.98, 0.78, 0.35, 1.0)

GROUND_GEOM, POST_GEOM = "ground", "post"
GROUND_HALF = 30.0
"""Half of the ground's width (m)."""

GROUND_MARGIN = 0.1
"""Height of the lowest link above the ground, where that is not at the base (m)."""

POST_RADIUS = 0.11
"""Radius of the post that an arm stands on then (m)."""

LINK_GROUP = 2
"""MuJoCo's group of the links' shapes."""

WALL = 0.004
"""Thickness of the pan that is drawn (m)."""

FLARE = 0.006
"""By which the drawn rim opens towards its top (m)."""

SEGMENTS = 72
"""Corners of the circles the pan is drawn with."""

HANDLE_RADIUS = 0.012
"""Radius of the pan's handle (m)."""


def build(mujoco: Any, arm: ArmDescription, friction: float, object_mass: float) -> Any:
    """Return the model of the whole scene.

    Args:
        mujoco: the module.
        arm: holds the pan.
        friction: coefficient between pan and object.
        object_mass: (kg).

    Raises:
        InputError: mujoco refuses the arm.
    """
    spec = arm_spec(arm)
    contact.set_options(mujoco, spec.option)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION  # torques are applied to the joints as they are
    _dress_arm(mujoco, spec, arm)
    _add_looks(mujoco, spec)
    _add_pan(mujoco, spec, arm)
    _add_object(mujoco, spec.worldbody, friction, object_mass)
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(f"arm {arm.name}: {' '.join(str(error).split())}") from error


def _add_looks(mujoco: Any, spec: Any) -> None:
    """Add light, ground, sky and materials."""
    texture, builtin = mujoco.mjtTexture, mujoco.mjtBuiltin
    spec.add_texture(
        name="sky", type=texture.mjTEXTURE_SKYBOX, builtin=builtin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.85, 0.90], rgb2=[0.45, 0.52, 0.60], width=256, height=1536,
    )  # fmt: skip
    spec.add_texture(
        name="tiles", type=texture.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER, mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.63, 0.67, 0.66], rgb2=[0.60, 0.64, 0.63], markrgb=[0.52, 0.56, 0.55], width=512, height=512,
    )  # fmt: skip
    ground = spec.add_material(name="ground", texrepeat=[4.0, 4.0], texuniform=True)
    ground.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    for name, rgba, specular, shininess in (
        ("pan", PAN_COLOUR, 0.7, 0.6),
        ("handle", HANDLE_COLOUR, 0.3, 0.3),
        ("link", LINK_COLOUR, 0.5, 0.6),
        ("joint", JOINT_COLOUR, 0.4, 0.5),
        ("object", OBJECT_COLOUR, 0.3, 0.4),
        ("cap", CAP_COLOUR, 0.3, 0.4),
    ):
        spec.add_material(name=name, rgba=rgba, specular=specular, shininess=shininess)
    world = spec.worldbody
    world.add_light(
        pos=[1.2, -1.4, 2.6], dir=[-0.26, 0.50, -0.83], diffuse=[0.65] * 3, specular=[0.35] * 3, castshadow=True
    )
    world.add_light(
        pos=[1.5, 1.8, 1.8], dir=[-0.4, -0.7, -0.6], diffuse=[0.22] * 3, specular=[0.0] * 3, castshadow=False
    )
    world.add_geom(
        name=GROUND_GEOM,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[GROUND_HALF, GROUND_HALF, 0.1],
        material="ground",
        contype=GROUND,
        conaffinity=0,
    )
    visual = spec.visual
    visual.headlight.ambient = [0.32] * 3
    visual.headlight.diffuse = [0.22] * 3
    visual.headlight.specular = [0.0] * 3
    visual.quality.shadowsize = 2048
    visual.map.znear = 0.02
    visual.map.shadowclip = 1.5
    spec.stat.center = [0.4, 0.0, 0.35]
    spec.stat.extent = 1.5


def stand_on_ground(model: Any, data: Any) -> None:
    """Lower the ground below an arm that reaches under its own base, and put the base on a post.

    Args:
        model: of the scene.
        data: with the arm at home.
    """
    lowest = float((data.geom_xpos[:, 2] - model.geom_rbound)[model.geom_group == LINK_GROUP].min())
    if lowest < 0.0:
        height = GROUND_MARGIN - lowest
        ground, post = model.geom(GROUND_GEOM), model.geom(POST_GEOM)
        model.geom_sameframe[[ground.id, post.id]] = 0  # their places are no longer their body's
        ground.pos[2] = -height
        post.pos[2], post.size[1], post.rgba[3] = -0.5 * height, 0.5 * height, 1.0


def _dress_arm(mujoco: Any, spec: Any, arm: ArmDescription) -> None:
    """Colour the links, draw the base, and let the joints end where their ranges do."""
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE:
            geom.material = "joint"
        elif geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom.material = "link"
        geom.group = LINK_GROUP
    post = spec.worldbody.add_geom(name=POST_GEOM, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[POST_RADIUS, 0.001, 0.0])
    post.contype = post.conaffinity = post.mass = 0
    post.rgba = [*POST_COLOUR, 0.0]  # not seen, unless `stand_on_ground` needs it
    base = arm.joints[0]
    if math.hypot(*base.frame.position) > base.radius:
        rod = {"fromto": [0.0, 0.0, 0.0, *base.frame.position], "size": [1.25 * base.radius, 0.0, 0.0]}
        _show(spec.worldbody, mujoco.mjtGeom.mjGEOM_CYLINDER, "link", **rod)
    for joint in arm.joints:
        if joint.lower is not None and joint.upper is not None:
            moved = spec.joint(joint.name)
            moved.limited, moved.range = mujoco.mjtLimited.mjLIMITED_TRUE, [joint.lower, joint.upper]


def _add_pan(mujoco: Any, spec: Any, arm: ArmDescription) -> None:
    """Add the shapes of the pan to its body, which has its mass."""
    kind = mujoco.mjtGeom
    pan = spec.body(PAN_BODY)
    touching = {"condim": 3, "conaffinity": 0, "mass": 0.0, "group": 3}
    half = 0.5 * g.PAN_THICKNESS
    pan.add_geom(
        type=kind.mjGEOM_CYLINDER, size=[g.PAN_RADIUS, half, 0.0], pos=[0, 0, -half], contype=BOTTOM, **touching
    )
    half = 0.5 * (g.RIM_HEIGHT + g.PAN_THICKNESS)
    middle = g.PAN_RADIUS + 0.5 * g.RIM_THICKNESS
    width = (g.PAN_RADIUS + g.RIM_THICKNESS) * math.tan(math.pi / g.RIM_BOXES)
    for angle in np.arange(g.RIM_BOXES) * (2.0 * math.pi / g.RIM_BOXES):
        pan.add_geom(
            type=kind.mjGEOM_BOX,
            size=[0.5 * g.RIM_THICKNESS, width, half],
            pos=[middle * math.cos(angle), middle * math.sin(angle), half - g.PAN_THICKNESS],
            quat=[math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)],
            contype=RIM,
            **touching,
        )
    _draw_pan(mujoco, spec, pan, arm.mount)


def _draw_pan(mujoco: Any, spec: Any, pan: Any, mount: Frame) -> None:
    """Draw the pan as a body of revolution, and its handle from the hand to the rim."""
    radius, height, below = g.PAN_RADIUS, g.RIM_HEIGHT, -g.PAN_THICKNESS
    inside = [(radius - 0.002, 0.0), (radius + 0.001, 0.003), (radius + FLARE, height)]
    outside = [(radius + FLARE + WALL, height), (radius + 0.004, below + 0.004), (radius - 0.006, below)]
    vertices, faces = _revolve(inside + outside)
    mesh = spec.add_mesh(name="pan", uservert=vertices.ravel(), userface=faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    _show(pan, mujoco.mjtGeom.mjGEOM_MESH, "pan", meshname="pan")
    hand = -mount.rotation.T @ np.array(mount.position)
    across = math.hypot(hand[0], hand[1])
    if across > radius:
        rim = np.array([*(hand[:2] * (radius + FLARE + WALL) / across), 0.5 * height])
        _show(pan, mujoco.mjtGeom.mjGEOM_CAPSULE, "handle", fromto=[*hand, *rim], size=[HANDLE_RADIUS, 0, 0])


def _revolve(profile: list[tuple[float, float]]) -> tuple[FloatArray, Any]:
    """Return vertices (n, 3) and triangles (m, 3) of a profile of radii and heights (m), from axis to axis, turned."""
    angles = np.arange(SEGMENTS) * (2.0 * math.pi / SEGMENTS)
    rings = [np.stack([r * np.cos(angles), r * np.sin(angles), np.full(SEGMENTS, z)], axis=1) for r, z in profile]
    first, last = [[0.0, 0.0, profile[0][1]]], [[0.0, 0.0, profile[-1][1]]]
    vertices = np.concatenate([*rings, first, last])
    return vertices, np.array(list(_triangles(len(profile))), dtype=np.int32)


def _triangles(rings: int) -> Iterator[tuple[int, int, int]]:
    """Give the triangles of `_revolve`, anticlockwise from outside; the last two vertices lie on the axis."""
    first, last = rings * SEGMENTS, rings * SEGMENTS + 1
    for here in range(SEGMENTS):
        there = (here + 1) % SEGMENTS
        yield first, here, there
        yield last, (rings - 1) * SEGMENTS + there, (rings - 1) * SEGMENTS + here
        for ring in range(rings - 1):
            a, b = ring * SEGMENTS + here, ring * SEGMENTS + there
            yield a, a + SEGMENTS, b
            yield b, a + SEGMENTS, b + SEGMENTS


def _add_object(mujoco: Any, world: Any, friction: float, mass: float) -> None:
    """Add the object, a cylinder that stands on balls; its contacts have its own settings."""
    kind = mujoco.mjtGeom
    radius, half = g.OBJECT_RADIUS, 0.5 * g.OBJECT_HEIGHT
    body = world.add_body(name="object")
    body.add_freejoint()
    touching = {
        "condim": 3, "priority": 1, "contype": 0, "solref": contact.SOLREF, "friction": [friction, 0.0, 0.0],
        "group": 3,
    }  # fmt: skip
    body.add_geom(type=kind.mjGEOM_CYLINDER, size=[radius, half, 0.0], mass=mass, conaffinity=RIM | GROUND, **touching)
    foot = contact.FOOT_RADIUS
    for angle in np.arange(contact.FEET) * (2.0 * math.pi / contact.FEET):
        for z in (foot - half, half - foot):
            place = [(radius - foot) * math.cos(angle), (radius - foot) * math.sin(angle), z]
            body.add_geom(
                type=kind.mjGEOM_SPHERE, size=[foot, 0, 0], pos=place, mass=0.0, conaffinity=BOTTOM, **touching
            )
    _show(body, kind.mjGEOM_CYLINDER, "object", size=[radius, half, 0])
    _show(body, kind.mjGEOM_CYLINDER, "cap", size=[0.72 * radius, 0.001, 0], pos=[0, 0, half])


def _show(body: Any, kind: Any, material: str, **shape: Any) -> None:
    """Add a shape that is only seen."""
    body.add_geom(type=kind, material=material, contype=0, conaffinity=0, mass=0.0, group=1, **shape)

"""An arm with the pan in its hand as a URDF for pybullet.

One tag a line: the simulator's parser does not read long lines to their end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from runtime.arm import geometry as g
from runtime.arms.description import ArmDescription, Body, Frame, Joint
from runtime.documents.checks import FloatArray

COLOURS = {"metal": "0.75 0.77 0.8 1", "joint": "0.2 0.35 0.55 1", "pan": "0.93 0.92 0.88 1", "rim": "0.55 0.55 0.55 1"}

BASE_RADIUS = 0.08
"""Radius of the base where it is drawn (m)."""

HANDLE_RADIUS = 0.015
"""Radius of the pan's handle where it is drawn (m)."""

SHORTEST = 1e-3
"""Length below which a link is drawn as a ball alone (m)."""

UNLIMITED = 1e6
"""Torque and speed of a joint whose limits are not known: the format wants numbers."""


def pan_in_hand(arm: ArmDescription) -> Frame:
    """Return the pan's frame in that of the last link."""
    return _after(arm.tip, arm.mount)


def arm_urdf(arm: ArmDescription) -> str:
    """Return the URDF document; only the pan collides: the links are drawn, and have mass."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{arm.name}">']
    for name, colour in COLOURS.items():
        lines += [f'<material name="{name}">', f'<color rgba="{colour}"/>', "</material>"]
    lines += ['<link name="base">']
    lines += _inertial(Body(1.0, (0.0, 0.0, 0.0), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)))
    lines += [*_rod(np.array(arm.joints[0].frame.position), BASE_RADIUS, "metal"), "</link>"]
    held = pan_in_hand(arm)
    for index, joint in enumerate(arm.joints):
        last = index + 1 == len(arm)
        body = joint.body + arm.pan.moved(held) if last else joint.body
        lines += [f'<link name="link{index + 1}">', *_inertial(body)]
        lines += _shape("visual", ["<sphere", f'radius="{1.15 * joint.radius:g}"/>'], Frame(), "joint")
        ahead = arm.tip.position if last else arm.joints[index + 1].frame.position
        lines += [*_rod(np.array(ahead), joint.radius, "metal"), *(_pan(arm.mount, held) if last else []), "</link>"]
        lines += _joint(index, joint)
    return "\n".join([*lines, "</robot>", ""])


def _pan(mount: Frame, held: Frame) -> Iterator[str]:
    """The pan: its handle, its bottom with its upper face through the centre, and its rim."""
    hand = -mount.rotation.T @ np.array(mount.position)
    across = math.hypot(hand[0], hand[1])
    if across > g.PAN_RADIUS:
        rim = np.array([*(hand[:2] * g.PAN_RADIUS / across), -0.5 * g.PAN_THICKNESS])
        handle = _along(rim, hand - rim)
        geometry = _cylinder(HANDLE_RADIUS, float(np.linalg.norm(hand - rim)))
        yield from _shape("visual", geometry, _after(held, handle), "joint")
    centre = Frame((0.0, 0.0, -0.5 * g.PAN_THICKNESS))
    yield from _shape("collision", _cylinder(g.PAN_RADIUS, g.PAN_THICKNESS), _after(held, centre))
    turns = np.arange(g.RIM_BOXES) * (2.0 * math.pi / g.RIM_BOXES)
    half = math.pi / g.RIM_BOXES
    length, width = 2.0 * g.PAN_RADIUS * math.cos(half), 2.0 * g.PAN_RADIUS * math.sin(half)
    for turn in turns[: g.RIM_BOXES // 2]:
        # The bottom is drawn as strips: the renderer rounds off a disc's edge, which looks like a hill.
        strip = Frame(centre.position, (0.0, 0.0, float(turn)))
        yield from _shape("visual", _box(length, width, g.PAN_THICKNESS), _after(held, strip), "pan")
    middle, height = g.PAN_RADIUS + 0.5 * g.RIM_THICKNESS, g.RIM_HEIGHT + g.PAN_THICKNESS
    box = _box(g.RIM_THICKNESS, 2.0 * (g.PAN_RADIUS + g.RIM_THICKNESS) * math.tan(half), height)
    for turn in turns.tolist():
        place = (middle * math.cos(turn), middle * math.sin(turn), 0.5 * height - g.PAN_THICKNESS)
        frame = _after(held, Frame(place, (0.0, 0.0, turn)))
        yield from _shape("visual", box, frame, "rim")
        yield from _shape("collision", box, frame)


def _joint(index: int, joint: Joint) -> list[str]:
    ranged = joint.lower is not None and joint.upper is not None
    kind = "prismatic" if joint.sliding else "revolute" if ranged else "continuous"
    limit = []
    if kind != "continuous":
        lower, upper = (joint.lower, joint.upper) if ranged else (-UNLIMITED, UNLIMITED)
        limit = [
            f'<limit lower="{lower:.9g}" upper="{upper:.9g}"',
            f'effort="{UNLIMITED:g}" velocity="{UNLIMITED:g}"/>',
        ]
    return [
        f'<joint name="joint{index + 1}" type="{kind}">',
        f'<parent link="{f"link{index}" if index else "base"}"/>',
        f'<child link="link{index + 1}"/>',
        *_origin(joint.frame),
        f'<axis xyz="{_numbers(joint.axis)}"/>',
        *limit,
        "</joint>",
    ]


def _inertial(body: Body) -> list[str]:
    xx, yy, zz, xy, xz, yz = (f"{value:.9g}" for value in body.inertia)
    return [
        "<inertial>",
        f'<origin xyz="{_numbers(body.centre)}"/>',
        f'<mass value="{body.mass:.9g}"/>',
        f'<inertia ixx="{xx}" ixy="{xy}" ixz="{xz}"',
        f'iyy="{yy}" iyz="{yz}" izz="{zz}"/>',
        "</inertial>",
    ]


def _rod(end: FloatArray, radius: float, material: str) -> list[str]:
    """A cylinder from the link's origin to `end` (3,) (m), if that is somewhere else."""
    length = float(np.linalg.norm(end))
    return [] if length < SHORTEST else _shape("visual", _cylinder(radius, length), _along(np.zeros(3), end), material)


def _along(begin: FloatArray, way: FloatArray) -> Frame:
    """Return the frame of a cylinder that begins at `begin` and goes `way`, (3,) each (m)."""
    z = way / np.linalg.norm(way)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    return Frame.of(begin + 0.5 * way, np.stack([x, np.cross(z, x), z], axis=1))


def _shape(kind: str, geometry: list[str], frame: Frame, material: str = "") -> list[str]:
    lines = [f"<{kind}>", *_origin(frame), "<geometry>", *geometry, "</geometry>"]
    if material:
        lines.append(f'<material name="{material}"/>')
    return [*lines, f"</{kind}>"]


def _origin(frame: Frame) -> list[str]:
    return [f'<origin xyz="{_numbers(frame.position)}"', f'rpy="{_numbers(frame.rpy)}"/>']


def _cylinder(radius: float, length: float) -> list[str]:
    return ["<cylinder", f'radius="{radius:.9g}" length="{length:.9g}"/>']


def _box(x: float, y: float, z: float) -> list[str]:
    return ["<box", f'size="{_numbers((x, y, z))}"/>']


def _numbers(values: tuple[float, float, float]) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _after(first: Frame, second: Frame) -> Frame:
    """Return a frame told in another, in the frame that the other is told in."""
    rotation = first.rotation
    return Frame.of(np.array(first.position) + rotation @ np.array(second.position), rotation @ second.rotation)

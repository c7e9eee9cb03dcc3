"""Writes the arm's URDF from its geometry: `python -m runtime.arm.urdf` renews the file in assets/.

One tag a line: the simulator's parser does not read long lines to their end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from runtime.arm import geometry as g

ARM_URDF = Path(__file__).parent / "assets" / "arm.urdf"

LINK_RADII = (0.07, 0.06, 0.05, 0.045, 0.045, 0.02)
"""Radii of the links as they are drawn and as their inertia is computed (m)."""

COLOURS = {"metal": "0.75 0.77 0.8 1", "joint": "0.2 0.35 0.55 1", "pan": "0.93 0.92 0.88 1", "rim": "0.55 0.55 0.55 1"}


def arm_urdf() -> str:
    """Return the URDF document.

    Only the pan collides: the links are drawn, and have mass. The origin of the last link's inertia is the pan's
    centre, so that the link state and the Jacobian the simulator gives refer to it.
    """
    lines = ['<?xml version="1.0"?>', '<robot name="arm">']
    for name, colour in COLOURS.items():
        lines += [f'<material name="{name}">', f'<color rgba="{colour}"/>', "</material>"]
    lines += _base()
    lengths = (0.0, g.UPPER_ARM, 0.5 * g.FOREARM, 0.5 * g.FOREARM, g.FLANGE)
    for index, length in enumerate(lengths):
        lines += _link(index, length)
    lines += _pan_link()
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    heights = (g.SHOULDER_HEIGHT, 0.0, g.UPPER_ARM, 0.5 * g.FOREARM, 0.5 * g.FOREARM, 0.0)
    for index, (axis, height) in enumerate(zip(axes, heights, strict=True)):
        lines += _joint(index, axis, height)
    return "\n".join([*lines, "</robot>", ""])


def _base() -> list[str]:
    height = g.SHOULDER_HEIGHT
    visual = _shape("visual", _cylinder(0.08, height), f"0 0 {height / 2:g}", material="metal")
    return ['<link name="base">', *_inertial(1.0, (0.0, 0.0, height / 2), (0.01, 0.01, 0.01)), *visual, "</link>"]


def _link(index: int, length: float) -> list[str]:
    """A link along its z axis, a homogeneous cylinder; one without length is a ball at its joint."""
    mass, radius = g.LINK_MASSES[index], LINK_RADII[index]
    across = mass * (3.0 * radius**2 + max(length, radius) ** 2) / 12.0
    inertia = (across, across, 0.5 * mass * radius**2)
    lines = [f'<link name="link{index + 1}">', *_inertial(mass, (0.0, 0.0, length / 2), inertia)]
    lines += _shape("visual", ["<sphere", f'radius="{1.15 * radius:g}"/>'], "0 0 0", material="joint")
    if length:
        lines += _shape("visual", _cylinder(radius, length), f"0 0 {length / 2:g}", material="metal")
    return [*lines, "</link>"]


def _pan_link() -> list[str]:
    """The last link: the handle, the pan's bottom with its upper face through the centre, and its rim."""
    mass, radius = g.LINK_MASSES[-1], g.PAN_RADIUS
    inertia = (0.5 * mass * radius**2, 0.25 * mass * radius**2, 0.25 * mass * radius**2)
    lines = ['<link name="pan">', *_inertial(mass, (0.0, 0.0, g.HAND), inertia)]
    handle = g.HAND - radius - g.FLANGE
    below = 0.5 * g.PAN_THICKNESS
    lines += _shape("visual", _cylinder(0.015, handle), f"{below:g} 0 {g.FLANGE + handle / 2:g}", material="joint")
    centre = f"{below:g} 0 {g.HAND:g}"
    lines += _shape("collision", _cylinder(radius, g.PAN_THICKNESS), centre, f"0 {math.pi / 2:.9f} 0")
    for index in range(g.RIM_BOXES // 2):
        lines += _bottom_strip(centre, 2.0 * math.pi * index / g.RIM_BOXES)
    for index in range(g.RIM_BOXES):
        lines += _rim_box(2.0 * math.pi * index / g.RIM_BOXES)
    return [*lines, "</link>"]


def _bottom_strip(centre: str, angle: float) -> list[str]:
    """One of the strips the bottom is drawn with: the renderer rounds off a disc's edge, which looks like a hill."""
    half = math.pi / g.RIM_BOXES
    length, width = 2.0 * g.PAN_RADIUS * math.cos(half), 2.0 * g.PAN_RADIUS * math.sin(half)
    box = ["<box", f'size="{g.PAN_THICKNESS:g} {length:.6f} {width:.6f}"/>']
    return _shape("visual", box, centre, f"{angle:.9f} 0 0", "pan")


def _rim_box(angle: float) -> list[str]:
    """One box of the rim, its inner face at the pan's radius, in the direction of `angle` about the normal."""
    height = g.RIM_HEIGHT + g.PAN_THICKNESS
    middle = g.PAN_RADIUS + 0.5 * g.RIM_THICKNESS
    width = 2.0 * (g.PAN_RADIUS + g.RIM_THICKNESS) * math.tan(math.pi / g.RIM_BOXES)
    box = ["<box", f'size="{height:g} {width:.6f} {g.RIM_THICKNESS:g}"/>']
    x = 0.5 * (g.PAN_THICKNESS - g.RIM_HEIGHT)
    place = f"{x:g} {-middle * math.sin(angle):.6f} {g.HAND + middle * math.cos(angle):.6f}"
    turn = f"{angle:.9f} 0 0"
    return [*_shape("visual", box, place, turn, "rim"), *_shape("collision", box, place, turn)]


def _joint(index: int, axis: str, height: float) -> list[str]:
    parent = f"link{index}" if index else "base"
    child = f"link{index + 1}" if index < 5 else "pan"
    return [
        f'<joint name="joint{index + 1}" type="continuous">',
        f'<parent link="{parent}"/>',
        f'<child link="{child}"/>',
        f'<origin xyz="0 0 {height:g}"/>',
        f'<axis xyz="{axis}"/>',
        "</joint>",
    ]


def _inertial(mass: float, place: Iterable[float], inertia: tuple[float, float, float]) -> list[str]:
    xx, yy, zz = (f"{value:.6g}" for value in inertia)
    return [
        "<inertial>",
        f'<origin xyz="{" ".join(f"{value:g}" for value in place)}"/>',
        f'<mass value="{mass:g}"/>',
        f'<inertia ixx="{xx}" ixy="0" ixz="0"',
        f'iyy="{yy}" iyz="0" izz="{zz}"/>',
        "</inertial>",
    ]


def _shape(kind: str, geometry: list[str], place: str, turn: str = "0 0 0", material: str = "") -> list[str]:
    lines = [f"<{kind}>", f'<origin xyz="{place}"', f'rpy="{turn}"/>', "<geometry>", *geometry, "</geometry>"]
    if material and kind == "visual":
        lines.append(f'<material name="{material}"/>')
    return [*lines, f"</{kind}>"]


def _cylinder(radius: float, length: float) -> list[str]:
    return ["<cylinder", f'radius="{radius:g}" length="{length:g}"/>']


if __name__ == "__main__":
    ARM_URDF.write_text(arm_urdf(), encoding="utf-8")

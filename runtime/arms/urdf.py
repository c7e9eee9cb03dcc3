"""Reads a URDF: its links, joints, inertias and limits. Shapes are left out, so that no mesh is looked for."""

from __future__ import annotations

import math
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from runtime.arms.description import NOTHING, Body, Frame, Joint, Vector
from runtime.arms.tree import Link
from runtime.errors import InputError

TURNING, SLIDING, FIXED = ("revolute", "continuous"), ("prismatic",), ("fixed",)
"""The types of joint that are known."""


class Robot(NamedTuple):
    """What a robot's file tells.

    Attributes:
        name: as the file has it.
        links: by name.
    """

    name: str
    links: dict[str, Link]


def read_urdf(text: str) -> Robot:
    """Read a URDF document.

    Raises:
        InputError: not XML, no robot, a joint of another type, to a link that is not there, or a value that is no
            number.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"not XML: {error}") from error
    if root.tag != "robot":
        raise InputError(f"a URDF's document is <robot>, got <{root.tag}>")
    bodies = {_text(link, "name"): _body(link) for link in root.findall("link")}
    links = {name: Link(None, Frame(), body, None) for name, body in bodies.items()}
    for element in root.findall("joint"):
        name = _text(element, "name")
        parent, child = (_end(element, end, name, bodies) for end in ("parent", "child"))
        if links[child].parent is not None:
            raise InputError(f"joint {name}: link {child} hangs on two joints: the links form a circle, or no tree")
        links[child] = Link(parent, _frame(element.find("origin")), bodies[child], _joint(element, name))
    if not links:
        raise InputError("the robot has no links")
    return Robot(root.get("name") or "robot", links)


def _joint(element: ElementTree.Element, name: str) -> Joint | None:
    """Return the joint; None if it is fixed, or follows another (a gripper's second finger) and so stands still."""
    kind = _text(element, "type")
    if kind not in (*TURNING, *SLIDING, *FIXED):
        known = ", ".join((*TURNING, *SLIDING, *FIXED))
        raise InputError(f"joint {name} is of the type {kind!r}; known are {known}")
    if kind in FIXED or element.find("mimic") is not None:
        return None
    axis = element.find("axis")
    direction = np.array((1.0, 0.0, 0.0) if axis is None else _vector(axis, "xyz"))
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise InputError(f"joint {name}: its axis has no direction")
    x, y, z = (float(value) for value in direction / length)
    limit = element.find("limit")
    ranged = limit is not None and kind != "continuous"
    return Joint(
        name,
        Frame(),
        NOTHING,
        (x, y, z),
        kind in SLIDING,
        lower=_number(limit, "lower", 0.0) if ranged else None,
        upper=_number(limit, "upper", 0.0) if ranged else None,
        speed=_number(limit, "velocity"),
        acceleration=_number(limit, "acceleration"),
        jerk=_number(limit, "jerk"),
        torque=_number(limit, "effort"),
    )


def _body(link: ElementTree.Element) -> Body:
    inertial = link.find("inertial")
    mass = None if inertial is None else _number(inertial.find("mass"), "value")
    inertia = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or inertia is None:
        return NOTHING
    xx, yy, zz, xy, xz, yz = (_number(inertia, f"i{axes}", 0.0) or 0.0 for axes in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return Body(mass, (0.0, 0.0, 0.0), (xx, yy, zz, xy, xz, yz)).moved(_frame(inertial.find("origin")))


def _frame(origin: ElementTree.Element | None) -> Frame:
    if origin is None:
        return Frame()
    return Frame(_vector(origin, "xyz"), _vector(origin, "rpy"))


def _vector(element: ElementTree.Element, key: str) -> Vector:
    text = element.get(key, "0 0 0")
    values = [_float(part, f"<{element.tag}> {key}") for part in text.split()]
    if len(values) != 3:
        raise InputError(f"<{element.tag}> {key} must be three numbers, got {text!r}")
    return values[0], values[1], values[2]


def _number(element: ElementTree.Element | None, key: str, default: float | None = None) -> float | None:
    text = None if element is None else element.get(key)
    return default if element is None or text is None else _float(text, f"<{element.tag}> {key}")


def _float(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}: {text!r} is no finite number (a xacro file must be expanded first)")
    return value


def _text(element: ElementTree.Element, key: str) -> str:
    value = element.get(key)
    if not value:
        raise InputError(f"a <{element.tag}> has no {key}")
    return value


def _end(element: ElementTree.Element, end: str, name: str, bodies: dict[str, Body]) -> str:
    found = element.find(end)
    link = None if found is None else found.get("link")
    if not link or link not in bodies:
        raise InputError(f"joint {name}: its {end} link {link!r} is not there")
    return link

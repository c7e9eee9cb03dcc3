"""Reads a URDF: its links, joints, inertias and limits. Shapes are left out, so that no mesh is looked for."""

from __future__ import annotations

import math
import reprlib
from typing import NamedTuple, NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from runtime.arms.description import NOTHING, Body, Frame, Joint, Vector
from runtime.arms.tree import Link
from runtime.errors import InputError

TURNING, SLIDING, FIXED = ("revolute", "continuous"), ("prismatic",), ("fixed",)
"""The types of joint that are known."""

LONGEST_NAME = 200
"""Letters in a name, at most."""

LARGEST = 1e30
"""Largest number that is read; ranges of 1e16 mean none."""

XACRO = ("${", "$(")
"""With what a value begins that xacro has not expanded yet."""


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
        InputError: not XML, entities, no robot, a joint of another type, to a link that is not there, a link of a name
            that another has, or a value that is no number.
    """
    root = _parsed(text)
    if root.tag != "robot":
        raise InputError(f"a URDF's document is <robot>, got <{root.tag}>")
    bodies: dict[str, Body] = {}
    for element in root.findall("link"):
        name = _text(element, "name")
        if name in bodies:
            raise InputError(f"two links are named {name}")
        bodies[name] = _body(element)
    leaders = {mimic.get("joint") for mimic in root.iterfind("joint/mimic")}
    links = {name: Link(None, Frame(), body, None) for name, body in bodies.items()}
    for element in root.findall("joint"):
        name = _text(element, "name")
        parent, child = (_end(element, end, name, bodies) for end in ("parent", "child"))
        if links[child].parent is not None:
            raise InputError(f"joint {name}: link {child} hangs on two joints: the links form a circle, or no tree")
        frame, joint = _frame(element.find("origin")), _joint(element, name)
        links[child] = Link(parent, frame, bodies[child], joint, followed=name in leaders)
    if not links:
        raise InputError("the robot has no links")
    return Robot(root.get("name") or "robot", links)


def _parsed(text: str) -> ElementTree.Element:
    """Return the document's root.

    Read without namespaces: robots' files have prefixes that nothing declares, as in <sensor:camera>. Entities, which
    can grow without end, are refused.
    """
    tree = ElementTree.TreeBuilder()
    parser = expat.ParserCreate("utf-8")  # what the text was decoded as, whatever it declares
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = tree.start, tree.end
    parser.EntityDeclHandler = _refuse_entity
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise InputError(f"not XML: {error}") from error
    root: ElementTree.Element = tree.close()
    return root


def _refuse_entity(name: str, *declared: object) -> NoReturn:
    raise InputError(f"the document declares the entity {reprlib.repr(name)}: expand it first")


def _joint(element: ElementTree.Element, name: str) -> Joint | None:
    """Return the joint; None if it is fixed, or follows another (a gripper's second finger) and so stands still."""
    kind = _text(element, "type")
    if kind not in (*TURNING, *SLIDING, *FIXED):
        known = ", ".join((*TURNING, *SLIDING, *FIXED))
        raise InputError(f"joint {name} is of the type {reprlib.repr(kind)}; known are {known}")
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
        raise InputError(f"<{element.tag}> {key} must be three numbers, got {reprlib.repr(text)}")
    return values[0], values[1], values[2]


def _number(element: ElementTree.Element | None, key: str, default: float | None = None) -> float | None:
    text = None if element is None else element.get(key)
    return default if element is None or text is None else _float(text, f"<{element.tag}> {key}")


def _float(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        hint = ": expand the xacro file first" if text.startswith(XACRO) else ""
        why = f"larger than {LARGEST:g}" if math.isfinite(value) else "no finite number"
        raise InputError(f"{place}: {reprlib.repr(text)} is {why}{hint}")
    return value


def _text(element: ElementTree.Element, key: str) -> str:
    value = element.get(key)
    if not value:
        raise InputError(f"a <{element.tag}> has no {key}")
    if len(value) > LONGEST_NAME:
        raise InputError(f"a <{element.tag}> has a {key} of {len(value)} letters, at most {LONGEST_NAME} are read")
    return value


def _end(element: ElementTree.Element, end: str, name: str, bodies: dict[str, Body]) -> str:
    found = element.find(end)
    link = None if found is None else found.get("link")
    if not link or link not in bodies:
        raise InputError(f"joint {name}: its {end} link {reprlib.repr(link)} is not there")
    return link

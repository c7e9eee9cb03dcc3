"""A tree of links, as a robot's file tells it, and the chain of joints in it that holds the pan."""

from __future__ import annotations

import reprlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from runtime.arms.description import FEWEST_JOINTS, NOTHING, Body, Frame, Joint
from runtime.errors import InputError


@dataclass(frozen=True)
class Link:
    """A link of a tree.

    Attributes:
        parent: name of the link before it; None for the base.
        frame: of its joint at angle zero in that of its parent.
        body: its own mass and inertia.
        joint: what moves it, its `frame` and `body` not yet told; None if it is fixed to its parent.
        followed: whether other joints follow that one, as a gripper's second finger follows the first.
        refused: why the link cannot be part of an arm; None if it can.
    """

    parent: str | None
    frame: Frame
    body: Body
    joint: Joint | None
    followed: bool = False
    refused: str | None = None


MOST_NAMED = 40
"""Links that are named in a line."""

MOST_LINKS = 2000
"""Links that are read; a humanoid has a hundred."""


def chain(links: Mapping[str, Link], tip: str | None) -> tuple[tuple[Joint, ...], Frame, str]:
    """Return the joints from the base to a tip, the tip's frame in that of the last link, and its name.

    What hangs on the chain beside it, a gripper's fingers say, stays where it is at angle zero, and its mass counts.

    Args:
        links: by name.
        tip: name of a link; None takes the end of the longest chain, before its fork where it has several ends, and
            without a finger: a joint that slides there, or that others follow.

    Raises:
        InputError: there is no link of that name, the links form a circle, two links have no parent, there are more
            than MOST_LINKS, or a link on the chain cannot be part of an arm.
    """
    if len(links) > MOST_LINKS:
        raise InputError(f"the robot has {len(links)} links, at most {MOST_LINKS} are read")
    _check_tree(links)
    if tip is None:
        tip = _longest(links)
    elif tip not in links:
        raise InputError(f"there is no link named {reprlib.repr(tip)} to be the tip; the links are {_some(links)}")
    path = _path(links, tip)
    for refused in (links[name].refused for name in path):
        if refused is not None:
            raise InputError(refused)
    on_chain = [name for name in path if links[name].joint is not None]
    joints: list[Joint] = []
    frame = Frame()
    for name in path:
        link = links[name]
        frame = _after(frame, link.frame)
        if link.joint is not None:
            joints.append(replace(link.joint, frame=frame, body=_carried(links, name, set(on_chain))))
            frame = Frame()
    return tuple(joints), frame, tip


def _check_tree(links: Mapping[str, Link]) -> None:
    roots = [name for name, link in links.items() if link.parent is None]
    rooted = set(roots)
    for name in links:
        seen = {name: None}  # in order
        last: str | None = name
        while last not in rooted and (last := links[str(last)].parent) is not None:
            if last in seen:
                names = list(seen)
                raise InputError(f"the links form a circle: {' -> '.join([*names[names.index(last) :], last])}")
            seen[last] = None
        rooted.update(seen)
    if len(roots) != 1:
        raise InputError(f"one link must be the base, but {len(roots)} have no parent: {_some(roots) or 'none'}")


def _path(links: Mapping[str, Link], tip: str) -> list[str]:
    path = [tip]
    while (parent := links[path[-1]].parent) is not None:
        path.append(parent)
    return path[::-1]


def _longest(links: Mapping[str, Link]) -> str:
    """Return the end of the longest chain: before its fork if it has several, without a finger that slides there."""
    paths = [_path(links, name) for name in links]
    moving = [_joints_on(links, path) for path in paths]
    ends = [path for path, count in zip(paths, moving, strict=True) if count == max(moving)]
    last = max(ends, key=len)
    if not all(path == last[: len(path)] for path in ends):
        last = [names[0] for names in zip(*ends, strict=False) if len(set(names)) == 1]
    final = next((index for index in range(len(last))[::-1] if links[last[index]].joint is not None), 0)
    finger = links[last[final]].joint
    grips = finger is not None and (finger.sliding or links[last[final]].followed)
    if grips and _joints_on(links, last) > FEWEST_JOINTS:
        last = last[:final]
    return last[-1]


def _joints_on(links: Mapping[str, Link], path: list[str]) -> int:
    return sum(links[name].joint is not None for name in path)


def _after(first: Frame, second: Frame) -> Frame:
    """Return a frame told in another, in the frame that the other is told in."""
    if first == Frame():
        return second
    rotation = first.rotation
    return Frame.of(np.array(first.position) + rotation @ np.array(second.position), rotation @ second.rotation)


def _carried(links: Mapping[str, Link], name: str, on_chain: set[str]) -> Body:
    """Return a link's body with all that is fixed to it or hangs on it beside the chain."""
    order = [name]
    for each in order:  # which grows meanwhile: parents before what hangs on them
        order += [child for child, link in links.items() if link.parent == each and child not in on_chain]
    whole = {each: NOTHING + links[each].body for each in order}
    for each in order[:0:-1]:
        link = links[each]
        if link.parent is not None:
            whole[link.parent] = whole[link.parent] + whole[each].moved(link.frame)
    return whole[name]


def _some(names: Collection[str]) -> str:
    """Return the names, the first MOST_NAMED of them if there are more."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(islice(names, MOST_NAMED)) + more

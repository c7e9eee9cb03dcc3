"""A tree of links, as a robot's file tells it, and the chain of joints in it that holds the pan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

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
    """

    parent: str | None
    frame: Frame
    body: Body
    joint: Joint | None


def chain(links: Mapping[str, Link], tip: str | None) -> tuple[tuple[Joint, ...], Frame, str]:
    """Return the joints from the base to a tip, the tip's frame in that of the last link, and its name.

    What hangs on the chain beside it, a gripper's fingers say, stays where it is at angle zero, and its mass counts.

    Args:
        links: by name.
        tip: name of a link; None takes the end of the longest chain, before its fork where it has several ends, and
            without a finger that slides there.

    Raises:
        InputError: there is no link of that name, the links form a circle, or two links have no parent.
    """
    _check_tree(links)
    if tip is None:
        tip = _longest(links)
    elif tip not in links:
        raise InputError(f"there is no link named {tip!r} to be the tip; the links are {', '.join(links)}")
    path = _path(links, tip)
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
    for name in links:
        seen = [name]
        while (parent := links[seen[-1]].parent) is not None:
            if parent in seen:
                circle = " -> ".join([*seen[seen.index(parent) :], parent])
                raise InputError(f"the links form a circle: {circle}")
            seen.append(parent)
    if len(roots) != 1:
        raise InputError(f"one link must be the base, but {len(roots)} have no parent: {', '.join(roots) or 'none'}")


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
    if finger is not None and finger.sliding and _joints_on(links, last) > FEWEST_JOINTS:
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
    whole = NOTHING + links[name].body
    for child, link in links.items():
        if link.parent == name and child not in on_chain:
            whole = whole + _carried(links, child, on_chain).moved(link.frame)
    return whole

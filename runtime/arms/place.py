"""Where the arm holds the pan: the place, heading and posture in which it moves the pan most easily.

A posture is joint angles that hold the pan level. How hard the joints work there is told by their share: of their
limits on speed, acceleration, jerk and torque, what they need for the pan's reference motion in the direction that is
worst for them. The worst joint's share decides.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arms.description import ArmDescription
from runtime.arms.model import ArmModel, pose_error
from runtime.documents.checks import FloatArray, column
from runtime.documents.files import parse_json
from runtime.documents.writing import write_whole
from runtime.errors import InputError, OutputError

REFERENCE = {"speed": 0.6, "acceleration": 6.0, "jerk": 3_000.0}
"""The pan's motion that shares are told for (m/s, m/s^2, m/s^3): what a plan for an arm comes to."""

AROUND = 0.12 * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""How far from its place the pan goes in most plans (m): the arm must be strong there too."""

REACHES = (0.2, 0.15, 0.12)
"""How far it goes at most (m): the arm must reach that within its joints' ranges, and not be nearly singular there. A
small arm that cannot is held to the next."""

ROUND = np.array([[math.cos(angle), math.sin(angle), 0.0] for angle in np.arange(8) * (math.pi / 4)])
"""The directions in which that is looked at."""

RANGE_MARGIN = 0.15
"""Distance that joints keep from the ends of their ranges where the pan begins and AROUND (rad)."""

LEAST_MARGIN = 0.1
"""The same where the pan is farthest (rad): a path comes there in another posture than the shortest way does, the more
so in closed loop."""

SLIDING_MARGIN = 0.1
"""Distance that a sliding joint keeps (m) over what a turning one keeps (rad)."""

LEAST_SINGULAR = 0.05
"""Smallest singular value of the Jacobian at which a posture is taken (m or 1 per rad)."""

CLEARANCE = 0.03
"""Least distance between the pan, with the object on it, and the links before the wrist (m)."""

LOWEST = 0.05
"""Least height of the pan above the arm's base (m)."""

NEAREST = 0.35
"""Least distance of the pan's centre from the vertical through the arm's base (m): it is held in front of the arm."""

SAMPLES, KEPT, STEPS = 1500, 8, 120
"""Random postures tried, the best of them that are made better, and in how many steps each."""

ITERATIONS = 60
"""Most Newton steps to a posture."""

CONVERGED = 1e-9
"""Error of a posture that is none (m or 1)."""

SMALL = 1e-9
"""Least part of a joint in a motion (rad/m): of one that has none, no limit counts."""

DAMPING = 1e-8
"""Added to the square of the Jacobian, so that a singular one gives a step all the same (m^2 or 1 per rad^2)."""

LONGEST_STEP = 0.3
"""Longest Newton step (rad)."""

CACHE_VERSION = 6
"""Changes when the search does: what was found before it is looked for again."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where the pan begins.

    Attributes:
        home: (n,) joint angles (rad).
        position: (3,) of the pan's centre in the world, the arm's base (m).
        rotation: (3, 3) attitude of the pan there, level: its x and y axes are a plan's, its z axis is up.
        share: of the worst joint there; see `share`.
    """

    home: FloatArray
    position: FloatArray
    rotation: FloatArray
    share: float

    @property
    def heading(self) -> float:
        """Direction of the pan's x axis, from the world's x axis (rad)."""
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])


def find_place(model: ArmModel, at: tuple[float, float, float] | None = None, cached: bool = True) -> Place:
    """Return where the pan begins: the arm's home if it has one, else what a search finds.

    Args:
        model: of the arm.
        at: where the pan's centre is to be in the world (m); chosen if None.
        cached: whether a search's result is kept in the user's cache folder and taken from there.

    Raises:
        InputError: no posture holds the pan level there.
    """
    arm = model.arm
    if at is None and arm.home is not None:
        return _place(model, level(model, np.array(arm.home)), at)
    file = _cache_file(arm, at) if cached else None
    home = None if file is None else _cached(file, len(arm))
    if home is None:
        home = _search(model, at)
        if file is not None:
            with suppress(OSError, OutputError):  # a cache that cannot be written costs time alone
                file.parent.mkdir(parents=True, exist_ok=True)
                write_whole(file, json.dumps({"home": home.tolist()}).encode())
    return _place(model, home, at)


def level(model: ArmModel, q: FloatArray, at: FloatArray | None = None) -> FloatArray | None:
    """Return joint angles near q that hold the pan level, its centre at `at` (3,) (m) if given; None if there are none.

    Newton's method with the least-norm step.
    """

    def errors(position: FloatArray, rotation: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y, z = rotation[:, 2]  # the normal, which turns by omega x normal: x and y are to be 0
        tilt = np.array([-x, -y]) if z > 0.0 else np.sign([-x, -y])
        rows = np.stack([z * jacobian[4] - y * jacobian[5], x * jacobian[5] - z * jacobian[3]])
        if at is None:
            return tilt, rows
        return np.concatenate([tilt, at - position]), np.concatenate([rows, jacobian[:3]])

    return _solve(model, q, errors)


def _moved(model: ArmModel, q: FloatArray, by: FloatArray) -> FloatArray | None:
    """Return joint angles near q that hold the pan moved `by` (3,) (m) in the same attitude; None if there are none."""
    position, rotation, _ = model.pan(q)
    target, attitude = position + by, rotation.copy()

    def errors(position: FloatArray, rotation: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
        return pose_error(target, attitude, position, rotation), jacobian

    return _solve(model, q, errors)


def _solve(model: ArmModel, q: FloatArray, errors: Callable[..., tuple[FloatArray, FloatArray]]) -> FloatArray | None:
    q = q.copy()
    for _ in range(ITERATIONS):
        residual, rows = errors(*model.pan(q))
        if np.abs(residual).max() < CONVERGED:
            return q
        square = rows @ rows.T + DAMPING * np.eye(len(rows))
        step = rows.T @ np.linalg.solve(square, residual)
        q += step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), LONGEST_STEP))
    return None


def around(model: ArmModel, q: FloatArray) -> list[FloatArray]:
    """Return a posture and those around it, AROUND away, that the arm reaches in the same attitude."""
    return [q, *(moved for by in AROUND if (moved := _moved(model, q, by)) is not None)]


def share(model: ArmModel, q: FloatArray) -> float:
    """Return the worst joint's share of its limits for the reference motion at joint angles q (n,).

    Args:
        model: of the arm.
        q: joint angles that hold the pan level.

    Returns:
        The share; infinite where the arm is nearly singular or cannot hold the pan, and 0 if no limit is known.
    """
    if model.inverse(q)[1] < LEAST_SINGULAR:
        return math.inf
    most = strength(model, q)
    return max(REFERENCE[name] / most[name] if most[name] else math.inf for name in REFERENCE)


def strength(model: ArmModel, q: FloatArray, axes: int = 2) -> dict[str, float]:
    """Return how fast, with which acceleration and which jerk the joints can move the pan from rest, in any direction.

    Args:
        model: of the arm.
        q: (n,) joint angles.
        axes: 2 for directions in the plane, 3 for all.

    Returns:
        Speed (m/s), acceleration (m/s^2) and jerk (m/s^3), infinite where no limit is known; 0 where the arm is
        singular or too weak to hold the pan still.
    """
    arm, still = model.arm, np.zeros((1, len(q)))
    inverse = model.inverse(q)[0][:, :axes]
    if not np.isfinite(inverse).all():
        return dict.fromkeys(REFERENCE, 0.0)
    needed = np.maximum(np.linalg.norm(inverse, axis=1), SMALL)
    most = {name: float((arm.limit(name) / needed).min()) for name in REFERENCE}
    left = arm.limit("torque") - np.abs(model.torque(q[None], still, still)[0])
    push = np.maximum(np.linalg.norm(model.inertia(q) @ inverse, axis=1), SMALL)
    most["acceleration"] = max(0.0, min(most["acceleration"], float((left / push).min())))
    return most


def _search(model: ArmModel, at: tuple[float, float, float] | None) -> FloatArray:
    """Return the best posture of random ones, the best of them made better step by step; the same each time."""
    arm, rng = model.arm, np.random.default_rng(0)
    lower, upper = arm.range
    spare = np.array([SLIDING_MARGIN if joint.sliding else 1.0 for joint in arm.joints])
    margin = RANGE_MARGIN * spare
    for joint, width, needed in zip(arm.joints, (upper - lower).tolist(), (2.0 * margin).tolist(), strict=True):
        if width < needed:
            unit = "m" if joint.sliding else "rad"
            raise InputError(
                f"arm {arm.name}: the range of joint {joint.name} is {width:.3g} {unit} wide, and at least "
                f"{needed:.2g} {unit} are needed: make it a fixed joint, or give a wider range"
            )
    low = np.maximum(lower + margin, np.minimum(-math.pi, upper - margin - math.tau))
    high = np.minimum(upper - margin, np.maximum(math.pi, low + math.tau))
    target = None if at is None else np.array(at)
    if target is not None and np.linalg.norm(target) > _longest(arm):
        raise InputError(_nowhere(arm, at) + f", which is {_longest(arm):.2f} m long")
    free = np.ones(len(arm))
    base = arm.joints[0]
    if at is None and not base.sliding and np.allclose(base.frame.rotation @ np.array(base.axis), [0.0, 0.0, 1.0]):
        low[0] = high[0] = free[0] = 0.0  # turning the whole arm makes nothing easier

    def inside(q: FloatArray, margin: float) -> bool:
        return bool(((lower + margin * spare <= q) & (q <= upper - margin * spare)).all())

    def cost(q: FloatArray | None) -> float:
        if q is None or not inside(q, RANGE_MARGIN) or not model.clear(q, CLEARANCE):
            return math.inf
        if at is None:
            x, y, z = model.pan(q)[0]
            if z < LOWEST or math.hypot(x, y) < NEAREST:
                return math.inf
        return share(model, q)

    def cost_around(q: FloatArray | None, reach: float, bound: float) -> float:
        value = cost(q)
        for by in AROUND:
            if q is None or not value < bound:
                break
            value = max(value, cost(_moved(model, q, by)))
        for by in reach * ROUND:
            if q is None or not value < bound:
                break
            there = _moved(model, q, by)
            if there is None or not inside(there, LEAST_MARGIN) or model.inverse(there)[1] < LEAST_SINGULAR:
                return math.inf
        return value

    def climbed(q: FloatArray, reach: float) -> tuple[float, FloatArray]:
        value, size = cost_around(q, reach, math.inf), 0.3
        for _ in range(STEPS):
            tried = level(model, q + free * rng.normal(0.0, size, len(arm)), target)
            tried_value = cost_around(tried, reach, value)
            if tried is not None and tried_value < value:
                q, value = tried, tried_value
            else:
                size = max(0.97 * size, 0.01)
        return value, q

    found = [level(model, rng.uniform(low, high), target) for _ in range(SAMPLES)]
    ranked = sorted(((cost(q), index) for index, q in enumerate(found)), key=lambda each: each[0])
    first = [q for value, index in ranked[:KEPT] if (q := found[index]) is not None and math.isfinite(value)]
    if not first:
        raise InputError(f"{_nowhere(arm, at)} (of {SAMPLES} postures tried)")
    for reach in REACHES:
        least, best = min((climbed(q, reach) for q in first), key=lambda each: each[0])
        if math.isfinite(least):
            break
    else:
        raise InputError(f"{_nowhere(arm, at)} and move it {reach:g} m in any direction within its joints' ranges")
    if free[0] == 0.0:
        x, y, _ = model.pan(best)[0]
        best[0] = np.clip(best[0] - math.atan2(y, x), lower[0] + margin[0], upper[0] - margin[0])
    return best


def _longest(arm: ArmDescription) -> float:
    """Return a distance from its base that the pan's centre cannot pass (m); endless if a joint slides."""
    frames = (*(joint.frame for joint in arm.joints), arm.tip, arm.mount)
    return (
        math.inf if any(joint.sliding for joint in arm.joints) else sum(math.hypot(*each.position) for each in frames)
    )


def _nowhere(arm: ArmDescription, at: tuple[float, float, float] | None) -> str:
    where = "anywhere" if at is None else f"at {', '.join(f'{value:g}' for value in at)} m"
    return f"arm {arm.name} cannot hold the pan level {where}"


def _place(model: ArmModel, home: FloatArray | None, at: tuple[float, float, float] | None) -> Place:
    if home is None:
        raise InputError(f"arm {model.arm.name}: its home does not hold the pan level, nor does any posture near it")
    position, rotation, _ = model.pan(home)
    return Place(home, position.copy(), rotation.copy(), share(model, home))


def _cache_file(arm: ArmDescription, at: tuple[float, float, float] | None) -> Path:
    folder = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    where = "" if at is None else "-" + "_".join(f"{value:g}" for value in at)
    return Path(folder) / "slide-planner" / "places" / f"{arm.digest}-{CACHE_VERSION}{where}.json"


def _cached(file: Path, joints: int) -> FloatArray | None:
    with suppress(OSError, InputError, KeyError, TypeError):
        home = column(parse_json(file.read_text(encoding="utf-8"))["home"], "home")
        return home if len(home) == joints else None
    return None

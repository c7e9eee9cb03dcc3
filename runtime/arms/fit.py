"""Plans that an arm can execute: limits for the pan from those of the joints, tightened until every joint holds.

The joints' limits give the pan's at its place; a plan within them is followed joint by joint; where a joint still
passes a limit, the pan's are tightened and it is planned again. If that is not enough, the command may be slowed down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runtime.arms.description import HAND_LIMITS
from runtime.arms.model import ArmModel
from runtime.arms.motion import ROUNDING, JointMotion, follow_plan
from runtime.arms.place import Place, around, strength
from runtime.command import Command
from runtime.errors import InputError
from runtime.limits import Limits
from runtime.physics.law import DT, GRAVITY
from runtime.plan import Plan

HOPE = 1.4
"""The pan's first limits are so many times those that hold in every direction: few plans go fastest where the joints
are weakest."""

CANDIDATES = 8
"""Turned and mirrored ways in which a command is planned for an arm where nothing else is said: under limits that are
tight they differ much."""

ROUNDS = 8
"""Most plans made for one speed of the command."""

SPARE = 0.97
"""Share of a limit that is aimed at."""

TORQUE_SHARE = 0.85
"""Share of a joint's torque that a plan may take: a controller needs the rest to hold the pan on its path."""

STRETCHES = tuple(2.0 ** (step / 4.0) for step in range(1, 13))
"""How many times a command is slowed down, in turn: 1.19, 1.41, ... 8."""

HOPELESS = 2.0
"""How many times the tolerance a plan's tracking RMSE may be and tighter limits are tried all the same."""

NARROWER = 0.85
"""Share to which the pan's reach is brought where the arm does not reach all of a plan."""

NEAR = 0.03
"""Share by which limits that hold and limits that do not are as good as one."""

TOLERANCE = 2e-3
"""Tracking RMSE that a stretched command must come to where no tolerance is given (m)."""

MakePlan = Callable[[Command, Limits], Plan]
"""Plans a command within limits."""


@dataclass(frozen=True)
class Fitted:
    """A plan for an arm.

    Attributes:
        plan: the plan.
        command: what it is a plan of, slowed down maybe.
        joints: of the arm along it.
        limits: of the pan.
        stretch: how many times as long as it was given the command lasts.
        plans: how many were made.
        notes: what else is to be said, a line each.
    """

    plan: Plan
    command: Command
    joints: JointMotion
    limits: Limits
    stretch: float
    plans: int
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object: arm, place, stretch, the pan's limits, and the joint that is nearest to its own."""
        worst, place = self.joints.worst, self.joints.place
        return {
            "name": self.joints.arm.name,
            "holds": self.holds,
            "stretch": self.stretch,
            "plans": self.plans,
            "limits": self.limits.to_dict(),
            "place": {"position": place.position.tolist(), "heading": place.heading},
            "worst": None if worst is None else vars(worst),
            "notes": list(self.notes),
        }

    @property
    def holds(self) -> bool:
        """Whether no joint passes a limit."""
        return not self.joints.exceeded


def pan_limits(model: ArmModel, place: Place, base: Limits) -> Limits:
    """Return the pan's limits at a place: what joints and hand allow in every direction, and no more than `base`.

    Raises:
        InputError: the arm cannot move the pan there, for its joints are too weak or it is singular.
    """
    axes = 3 if base.height > 0.0 else 2
    most = dict.fromkeys(HAND_LIMITS, math.inf)
    for q in around(model, place.home):
        for name, value in strength(model, q, axes).items():
            most[name] = min(most[name], value)
    for name in HAND_LIMITS:
        limit = getattr(model.arm.hand, name)
        most[name] = min(most[name], getattr(base, name), math.inf if limit is None else limit)
        if not most[name] > 0.0:
            x, y, z = place.position
            raise InputError(f"arm {model.arm.name} cannot move a pan at ({x:.2f}, {y:.2f}, {z:.2f}) m: too weak there")
    return _limits(base.pan_reach, base.height, most)


def fit(
    make: MakePlan,
    command: Command,
    model: ArmModel,
    place: Place,
    base: Limits,
    stretch: bool = False,
    tolerance: float | None = None,
) -> Fitted:
    """Plan a command so that the joints hold, slowed down by the least factor if it may be.

    Args:
        make: plans within limits.
        command: what to plan.
        model: of the arm.
        place: where the pan begins.
        base: limits of the pan beside the arm's.
        stretch: whether the command may be slowed down, by the last of STRETCHES at most.
        tolerance: tracking RMSE (m) that a stretched command must come to; TOLERANCE if None.

    Returns:
        The plan with the least stretch that holds and tracks; if none does, the one that comes closest.

    Raises:
        InputError: see `pan_limits` and `follow_plan`.
    """
    limits, made = pan_limits(model, place, base), 0
    within = TOLERANCE if tolerance is None else tolerance

    def tried(factor: float) -> Fitted:
        nonlocal made
        hopeless = HOPELESS * within if stretch else math.inf
        fitted = _tighten(make, slowed(command, factor), model, place, limits, base, within, hopeless)
        made += fitted.plans
        return replace(fitted, stretch=factor)

    def good(fitted: Fitted) -> bool:
        return not _beyond(fitted) and fitted.plan.quality.tracking_rmse <= within

    best = tried(1.0)
    if stretch and not good(best):
        before = 1.0
        for factor in STRETCHES:
            best = min(best, tried(factor), key=lambda each: _badness(each, within))
            if good(best):
                middle = tried(math.sqrt(before * factor))
                best = middle if good(middle) else best
                break
            before = factor
    return replace(best, plans=made, notes=_notes(best, limits, model, stretch and not good(best)))


def slowed(command: Command, factor: float) -> Command:
    """Return a command that takes `factor` times as long."""
    if factor == 1.0:
        return command
    slow = Command.from_samples(command.position, DT * factor)
    return replace(slow, deviation=command.deviation, notes=(*command.notes, f"slowed down {factor:.3g} times"))


def _tighten(
    make: MakePlan,
    command: Command,
    model: ArmModel,
    place: Place,
    everywhere: Limits,
    base: Limits,
    within: float,
    hopeless: float,
) -> Fitted:
    """Plan, follow, and tighten what is passed, until all holds.

    Limits that hold but track worse than `within` (m) are loosened again, halfway to those that did not hold. Given up
    where limits that do not hold track worse than `hopeless` (m) already: tighter ones do not track better.
    """
    hand = {name: math.inf if (limit := getattr(model.arm.hand, name)) is None else limit for name in HAND_LIMITS}
    most = {name: min(HOPE * getattr(everywhere, name), getattr(base, name), hand[name]) for name in HAND_LIMITS}
    limits, loose = _limits(everywhere.pan_reach, everywhere.height, most), None
    tries: list[Fitted] = []
    beyond: InputError | None = None
    for _ in range(ROUNDS):
        plan = make(command, limits)
        try:
            joints = follow_plan(model, place, plan)
        except InputError as wrong:  # the pan is to stay nearer to its place
            beyond, limits = wrong, replace(limits, pan_reach=NARROWER * limits.pan_reach)
            continue
        fitted = Fitted(plan, command, joints, limits, 1.0, 1)
        tries.append(fitted)
        error = plan.quality.tracking_rmse
        if not _beyond(fitted):
            if error <= within or loose is None or loose.acceleration < (1.0 + NEAR) * limits.acceleration:
                break
            means = {name: math.sqrt(getattr(limits, name) * getattr(loose, name)) for name in HAND_LIMITS}
            limits = _limits(limits.pan_reach, limits.height, means)
        elif error > hopeless:
            break
        else:
            loose, tighter = limits, _tightened(limits, fitted)
            if tighter.acceleration <= plan.friction.static * GRAVITY < limits.acceleration:
                break  # the object would rest on the pan
            limits = tighter
    if not tries and beyond is not None:
        raise beyond
    return replace(min(tries, key=lambda each: _badness(each, within)), plans=len(tries))


def _tightened(limits: Limits, fitted: Fitted) -> Limits:
    """Return limits smaller by what is passed: of the pan's acceleration for torques, else of the same quantity."""
    share = dict.fromkeys(HAND_LIMITS, 1.0)
    reach = 1.0
    for quantity, beyond in _beyond(fitted):
        if quantity == "angle":
            reach = max(reach, beyond)
        else:
            limited = "acceleration" if quantity == "torque" else quantity
            share[limited] = max(share[limited], beyond)
    came_to = {"speed": _speed(fitted.plan), "acceleration": _acceleration(fitted.plan), "jerk": _jerk(fitted.plan)}
    new = {
        name: min(getattr(limits, name), came_to[name]) * SPARE / share[name]
        if share[name] > 1.0
        else getattr(limits, name)
        for name in HAND_LIMITS
    }
    return _limits(limits.pan_reach / reach, limits.height, new)


def _limits(pan_reach: float, height: float, most: Mapping[str, float]) -> Limits:
    speed, acceleration, jerk = (most[name] for name in HAND_LIMITS)
    return Limits(pan_reach, height=height, speed=speed, acceleration=acceleration, jerk=jerk)


def _speed(plan: Plan) -> float:
    return float(np.linalg.norm(plan.pan_velocity, axis=1).max())


def _acceleration(plan: Plan) -> float:
    return float(np.linalg.norm(np.concatenate([plan.pan_acceleration, plan.stop_acceleration]), axis=1).max())


def _jerk(plan: Plan) -> float:
    u = np.concatenate([plan.pan_acceleration, plan.stop_acceleration])
    return float(np.linalg.norm(np.diff(u, axis=0, prepend=0.0, append=0.0), axis=1).max()) / DT


def _beyond(fitted: Fitted) -> list[tuple[str, float]]:
    """Return what takes more than it may: the quantity, and how many times as much."""
    found = []
    for peak in fitted.joints.peaks:
        most = TORQUE_SHARE if peak.quantity == "torque" else 1.0
        if peak.share is not None and peak.share > most * (1.0 + ROUNDING):
            found.append((peak.quantity, peak.share / most))
    return found


def _badness(fitted: Fitted, within: float) -> tuple[float, float]:
    """Order plans: by the worst joint's share of what it may take, if it is more, then by what misses the tolerance."""
    passed = max((beyond for _, beyond in _beyond(fitted)), default=0.0)
    return passed, max(0.0, fitted.plan.quality.tracking_rmse - within)


def _notes(fitted: Fitted, everywhere: Limits, model: ArmModel, in_vain: bool) -> tuple[str, ...]:
    static, most = fitted.plan.friction.static, everywhere.acceleration / GRAVITY
    if static * GRAVITY >= fitted.limits.acceleration or (static >= most and not fitted.holds):
        return (f"{model.arm.name} could slide it there at a static friction below {most:.2f}, not at {static:g}",)
    if in_vain:
        return (f"slowing the command down up to {STRETCHES[-1]:g} times was not enough",)
    return ()

"""Commands on pans of several kinds: within the limits of arms that people own, level and lifting, and disturbed.

Errors are of the object that is moved here, by the law of friction and the accelerations that were planned; nothing
that a planner predicts of its own plans is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.suite.families import FRICTION_GRID, Family
from benchmarks.suite.suite import suite
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.compiled import compiler
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner

WAYS = ("level", "lifting")
"""Ways in which a pan moves."""

HEIGHT = 0.1
"""Height of pans that lift (m)."""

FRICTION_OFF = 0.1
"""Share by which both coefficients are off where plans are replayed under another friction."""

ASKED_EVERY = 50
"""Samples after which a decoder is asked again in a loop."""

REFINED = 50
"""Steps of refinement: as many as fit into some 50 ms, and the same whatever else the machine does."""

PUSHED_AT, PUSH = 500, 0.02
"""Sample in which an object is pushed, just before a question, and how far (m)."""


@dataclass(frozen=True)
class Task:
    """Commands, and the pan and the friction with which they are followed.

    Attributes:
        pan: name of the pan.
        family: of the suite, or the name of commands of its own.
        limits: of a level pan of this kind.
        friction: of the object.
        size: what the commands are multiplied by.
        slowness: how many times as long they take.
        targets: mean tracking RMSE (m) that should be reached by a level pan and by one that lifts; None for none.
        own: the commands, if they are in no suite.
    """

    pan: str
    family: str
    limits: Limits
    friction: Friction
    size: float = 1.0
    slowness: int = 1
    targets: tuple[float | None, float | None] = (None, None)
    own: Family | None = None

    @property
    def name(self) -> str:
        """What it is called in the figures."""
        mu = f"{100 * self.friction.static:.0f}_{100 * self.friction.kinetic:.0f}"
        return f"{self.pan}_{mu}_{self.family}"

    @property
    def title(self) -> str:
        """What it is called for a person."""
        return f"{self.pan} {self.friction.static:g}/{self.friction.kinetic:g} {self.family}"

    def positions(self, commands: int | None) -> list[FloatArray]:
        """Return its commands, (K, 2) in metres at 1 kHz; if a number is given, so many, spread over all of them."""
        family = suite([self.family])[self.family] if self.own is None else self.own
        count = len(family) if commands is None else min(commands, len(family))
        chosen = np.linspace(0.0, len(family) - 1.0, count).round().astype(int)
        return [_slower(self.size * family.positions[index], self.slowness) for index in chosen]

    def lifting(self) -> Task:
        """Return the same with a pan that lifts."""
        return replace(self, limits=replace(self.limits, height=HEIGHT))


NOMINAL = Friction(1.0, 0.5)
DEFAULT = Limits()
PANDA, FR3 = (replace(Limits.named(name), height=0.0) for name in ("panda", "fr3"))
WEAK = Limits(acceleration=4.0, jerk=1_000.0)
SMALL = Limits(0.1)

TASKS = (
    Task("default", "spline", DEFAULT, NOMINAL, targets=(1.05e-3, 0.5e-3)),
    Task("default", "shapes", DEFAULT, NOMINAL, targets=(1.4e-3, 0.85e-3)),
    Task("default", "stops", DEFAULT, NOMINAL, targets=(1.4e-3, 0.7e-3)),
    Task("panda", "spline", PANDA, NOMINAL, targets=(2.2e-3, 0.95e-3)),
    Task("panda", "shapes", PANDA, NOMINAL, targets=(None, 1.8e-3)),
    Task("panda", "stops", PANDA, NOMINAL, targets=(None, 1.2e-3)),
    Task("panda", "spline", PANDA, Friction(0.5, 0.3), targets=(1.3e-3, 0.65e-3)),
    Task("fr3", "spline", FR3, NOMINAL, targets=(None, 2.8e-3)),
    Task("fr3", "spline", FR3, Friction(0.5, 0.3), targets=(2.8e-3, 1.0e-3)),
    Task("fr3", "spline", FR3, Friction(0.3, 0.2), targets=(2.8e-3, 0.8e-3)),
    Task("weak", "spline", WEAK, Friction(0.2, 0.15), slowness=4, targets=(1.8e-3, 1.0e-3)),
    Task("small", "spline", SMALL, NOMINAL, size=0.5, targets=(0.8e-3, 0.5e-3)),
    Task("small", "shapes", SMALL, NOMINAL, size=0.5, targets=(0.8e-3, 0.5e-3)),
    Task("slow", "spline", DEFAULT, NOMINAL, size=0.15, targets=(0.22e-3, 0.15e-3)),
)
"""Every task: `weak` is a pan of 4 m/s^2 and 1,000 m/s^3 whose commands take four times as long, `small` one with a
reach of 0.1 m and commands of half the size, `slow` the default one with commands of 0.15 times the size."""

PANS = tuple(dict.fromkeys(task.pan for task in TASKS))

DRAWINGS = Task("default", "drawings", DEFAULT, NOMINAL, targets=(2.1e-3, 0.95e-3))
"""Drawings of people, once they are read: see `benchmarks.suite.drawings`."""


def tasks(pans: Sequence[str], families: Sequence[str]) -> list[Task]:
    """Return the tasks of these pans and families; `all` is every pan.

    Raises:
        InputError: there is no pan of that name.
    """
    for name in pans:
        if name not in (*PANS, "all"):
            raise InputError(f"--limits: there is no pan {name!r}: known are {', '.join(PANS)}, or all")
    return [task for task in TASKS if ("all" in pans or task.pan in pans) and task.family in families]


@dataclass(frozen=True)
class Followed:
    """What became of a task's commands.

    Attributes:
        commands: number of commands.
        tracking_mean, tracking_max: of the tracking RMSE of a command (m).
        pan_reach, height, speed, acceleration, jerk: largest of the pans (m, m, m/s, m/s^2, m/s^3).
        governed: share of the samples that the governor changed.
    """

    commands: int
    tracking_mean: float
    tracking_max: float
    pan_reach: float
    height: float
    speed: float
    acceleration: float
    jerk: float
    governed: float


def follow(planner: Planner, task: Task, commands: int | None, candidates: int | None = None) -> Followed | None:
    """Plan a task's commands, told the friction, and see what they lead to; None if the object cannot slide.

    Each is planned by itself, by so many candidates: several where one plan is bad if None, as users do.
    """
    if cannot_slide(task):
        return None
    positions, friction, limits = task.positions(commands), task.friction, task.limits
    plans = [planner.plan(position, friction, limits=limits, candidates=candidates) for position in positions]
    planned = [plan.pan_acceleration for plan in plans]
    changed = sum(plan.quality.governed.samples for plan in plans if plan.quality.governed is not None)
    return summary(positions, planned, friction, changed / sum(map(len, planned)))


def cannot_slide(task: Task) -> bool:
    """Whether a level pan is too weak to break the object away."""
    return task.limits.level and task.friction.static * GRAVITY >= task.limits.acceleration


def summary(
    positions: Sequence[FloatArray], planned: Sequence[FloatArray], friction: Friction, governed: float = 0.0
) -> Followed:
    """Return what accelerations, (K, 3) or (K, 2) for each (K, 2) command, lead to, from rest."""
    errors, largest = tracking(positions, planned, friction), np.zeros(5)
    for u in planned:
        states = integrate_pan(np.zeros(2 * u.shape[1]), u)
        axes = u.shape[1]
        height = np.abs(states[:, 2]).max() if axes == 3 else 0.0
        step = np.diff(u, axis=0, prepend=np.zeros((1, axes)))
        of_pan = (states[:, :2], states[:, axes:], u, step / DT)
        farthest, *others = (np.linalg.norm(each, axis=1).max() for each in of_pan)
        largest = np.maximum(largest, [farthest, height, *others])
    reach, height, speed, acceleration, jerk = largest.tolist()
    mean, worst = float(errors.mean()), float(errors.max())
    return Followed(len(errors), mean, worst, reach, height, speed, acceleration, jerk, governed)


def tracking(positions: Sequence[FloatArray], planned: Sequence[FloatArray], friction: Friction) -> FloatArray:
    """Return the tracking RMSE (m) of each command under a friction, from rest, open loop."""
    errors = []
    for position, u in zip(positions, planned, strict=True):
        start = np.array([*position[0], 0.0, 0.0])
        after = slide_one(start, u[:-1], friction)
        errors.append(np.sqrt(((np.concatenate([start[None], after])[:, :2] - position) ** 2).sum(axis=1).mean()))
    return np.array(errors)


@dataclass(frozen=True)
class Disturbed:
    """The task `default_100_50_spline`, disturbed.

    Attributes:
        friction_off: mean tracking RMSE (m) if both coefficients are FRICTION_OFF off, open loop: of the four ways.
        best_of_24: mean tracking RMSE (m) of the best of 24 candidates.
        robust: as `friction_off`, of the best of 24 candidates, chosen by their mean under such frictions.
        refined: as `robust`, refined for such frictions in REFINED steps; None without numba.
        friction_worst: mean tracking RMSE (m) under the friction of the family `friction` where this is largest.
        asked: mean tracking RMSE (m) in closed loop if the decoder is asked every ASKED_EVERY samples.
        back: time (s) after a push of PUSH until the mean distance of object and command, in that loop, is less than
            twice what it is on the whole without a push.
    """

    friction_off: float
    best_of_24: float
    robust: float
    refined: float | None
    friction_worst: float
    asked: float
    back: float


def disturb(planner: Planner, task: Task, commands: int | None) -> Disturbed:
    """Plan a task's commands, and disturb what they lead to."""
    positions, friction, limits = task.positions(commands), task.friction, task.limits
    nominal = [planner.plan(each, friction, limits=limits).pan_acceleration for each in positions]
    compiled = compiler() is not None
    best, robust, refined = (
        [
            planner.plan(
                each, friction, limits=limits, candidates=24, robust=share, refine_iterations=steps
            ).pan_acceleration
            for each in positions
        ]
        for share, steps in ((0.0, None), (FRICTION_OFF, None), (FRICTION_OFF, REFINED if compiled else None))
    )
    asked = [_loop(planner, position, task) - position for position in positions]
    rng, off = np.random.default_rng(20), []
    for position in positions:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        off.append(_loop(planner, position, task, PUSH * np.array([np.cos(angle), np.sin(angle)])) - position)
    usual = np.mean([np.linalg.norm(error, axis=1).mean() for error in asked])
    pushed = np.mean([np.linalg.norm(error[PUSHED_AT:], axis=1) for error in off], axis=0)
    return Disturbed(
        _off(positions, nominal, friction),
        float(tracking(positions, best, friction).mean()),
        _off(positions, robust, friction),
        _off(positions, refined, friction) if compiled else None,
        max(_under(planner, positions, each, limits) for each in FRICTION_GRID),
        float(np.mean([np.sqrt((error**2).sum(axis=1).mean()) for error in asked])),
        DT * float(np.argmax(pushed < 2.0 * usual)),
    )


def _loop(planner: Planner, position: FloatArray, task: Task, push: FloatArray | None = None) -> FloatArray:
    """Follow a command in closed loop with the law, asked every ASKED_EVERY samples; where the object is, (K, 2)."""
    stream = planner.stream(position, task.friction, limits=task.limits)
    every = min(ASKED_EVERY, stream.chunk)
    pan, sliding = np.zeros((1, 6)), np.array([[*position[0], 0.0, 0.0]])
    states: tuple[FloatArray | None, FloatArray | None] = (None, None)
    executed = None
    while len(sliding) < len(position):
        u = stream.step(*states, executed=executed)[:every]
        executed = every
        pan = np.concatenate([pan, integrate_pan(pan[-1], u)])
        at = PUSHED_AT - len(sliding)
        if push is None or not 0 <= at < every:
            new = slide_one(sliding[-1], u, task.friction)
        else:
            before = np.concatenate([sliding[-1:], slide_one(sliding[-1], u[:at], task.friction)])
            before[-1, :2] += push
            new = np.concatenate([before[1:], slide_one(before[-1], u[at:], task.friction)])
        sliding = np.concatenate([sliding, new])
        states = pan[-1], sliding[-1]
    return sliding[: len(position), :2]


def _off(positions: Sequence[FloatArray], planned: Sequence[FloatArray], friction: Friction) -> float:
    return float(np.mean([tracking(positions, planned, each).mean() for each in friction.corners(FRICTION_OFF)]))


def _under(planner: Planner, positions: Sequence[FloatArray], friction: Friction, limits: Limits) -> float:
    """Return the mean tracking RMSE (m) of plans for a friction under it."""
    planned = [planner.plan(each, friction, limits=limits).pan_acceleration for each in positions]
    return float(tracking(positions, planned, friction).mean())


def _slower(position: FloatArray, times: int) -> FloatArray:
    """Return a command that takes so many times as long, by straight lines."""
    if times == 1:
        return position
    old, t = np.arange(len(position)), np.arange((len(position) - 1) * times + 1) / times
    return np.stack([np.interp(t, old, axis) for axis in position.T], axis=1)

"""What the sampling planners share: the compiled law of friction, the price of a motion, the bounds, the effort.

A plan is a sequence of knots, in each of which the acceleration is constant, or goes to that no faster than the jerk
limit allows. A state is WIDTH numbers: pan x, y, z, vx, vy, vz in the world, object x, y, vx, vy relative to the pan
(m, m/s), and the pan's acceleration in x, y, z (m/s^2).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numba
import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import LARGEST_SINK, Limits
from runtime.physics.law import DT, GRAVITY, slide_step
from runtime.physics.pan import pan_step

KNOT = 10
"""Samples for which an acceleration is constant where no limits are given, and under the default ones."""

HORIZON = 40
"""Knots that are planned at a time: 400 ms. In 250 ms a planner does not see that the pan will have to come back."""

REPLAN = 5
"""Knots executed before the next planning: 50 ms."""

ACCELERATION = 30.0
"""Bound on |u| (m/s^2) where no limits are given, the same as the network's."""

PAN_LIMIT = 0.2
"""Limit of the pan's motion (m) where no limits are given, softly enforced."""

LIMIT_PRICE = 3e3
"""Price of a sample beyond the pan limit, per metre squared, against 1 per metre squared of tracking error."""

SPEED_PRICE = 1.0
"""Price of a sample beyond the speed limit, per (m/s)^2, against 1 per metre squared of tracking error."""

WIDTH = 13
"""Numbers in a state."""

CHANGE_PRICE = 2e-8
"""Price of a change of acceleration between knots, per (m/s^2)^2, against 1 per metre squared of tracking error.

It holds for ACCELERATION and PAN_LIMIT. Under other limits it is the same share of these."""

_slide_step, _pan_step = numba.njit(slide_step), numba.njit(pan_step)


@dataclass(frozen=True)
class SamplingPlanner(ABC):
    """A planner that draws candidates; calling it is a `benchmarks.suite.outcome.PlanFunction`.

    Attributes:
        candidates: number of candidates drawn in an iteration.
        iterations: number of times the plan is improved by them in a planning.
        seed: of the candidates.
        limits: acceleration, jerk and LARGEST_SINK are kept, reach, height and speed softly. If None, a level pan with
            ACCELERATION and PAN_LIMIT alone.
    """

    KIND: ClassVar[str]

    candidates: int = 512
    iterations: int = 20
    seed: int = 0
    limits: Limits | None = None

    @property
    def axes(self) -> int:
        """Along how many axes the pan moves."""
        return 2 if self.limits is None or self.limits.level else 3

    @property
    def span(self) -> int:
        """Samples in a knot: in proportion to the time that a pan takes across its reach, as the network's are.

        In 400 ms a weaker pan would not see that it will have to come back.
        """
        if self.limits is None:
            return KNOT
        time = math.sqrt(self.limits.pan_reach / self.limits.acceleration)
        return round(KNOT * time / math.sqrt(PAN_LIMIT / ACCELERATION))

    @property
    def strength(self) -> float:
        """What spreads of accelerations are multiplied by: the limit over ACCELERATION."""
        return 1.0 if self.limits is None else self.limits.acceleration / ACCELERATION

    @property
    def bounds(self) -> FloatArray:
        """What the compiled functions are told of the limits: acceleration, its change, reach, height, speed."""
        if self.limits is None:
            return np.array([ACCELERATION, np.inf, PAN_LIMIT, 0.0, np.inf])
        limits = self.limits
        return np.array([limits.acceleration, limits.jerk * DT, limits.pan_reach, limits.height, limits.speed])

    @property
    def name(self) -> str:
        """How tables call it."""
        return f"{self.KIND} {self.candidates} x {self.iterations}"

    def __call__(self, positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        """Plan the commands one after the other: (K, 2) positions (m) to (K, axes) pan accelerations (m/s^2)."""
        return [self.plan(position, friction) for position, friction in zip(positions, frictions, strict=True)]

    @abstractmethod
    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""


def held_command(position: FloatArray, span: int) -> FloatArray:
    """Return a (K, 2) command from the origin, held at its end as far as a planner with such knots looks."""
    held: FloatArray = np.concatenate([position, position[-1:].repeat(span * (HORIZON + REPLAN), axis=0)])
    held -= position[0]
    return held


@numba.njit  # type: ignore[untyped-decorator]
def sample(state: Any, u: Any, command: Any, k: int, static: float, kinetic: float, bounds: Any) -> float:
    """Go towards the acceleration `u` (3,) (m/s^2) for sample `k`.

    Args:
        state: WIDTH numbers, changed in place.
        u: the acceleration (m/s^2).
        command: (n, 2) where the object should be (m).
        k: the sample.
        static, kinetic: coefficients.
        bounds: see `SamplingPlanner.bounds`.

    Returns:
        The price of the sample.
    """
    ax, ay, az = state[10], state[11], state[12]
    dx, dy, dz = u[0] - ax, u[1] - ay, u[2] - az
    size = np.sqrt(dx * dx + dy * dy + dz * dz)
    if size > bounds[1]:
        share = bounds[1] / size
        ax, ay, az = ax + dx * share, ay + dy * share, az + dz * share
    else:
        ax, ay, az = u[0], u[1], u[2]
    state[10], state[11], state[12] = ax, ay, az
    normal = GRAVITY + az
    px, py, wx, wy = _slide_step(state[6], state[7], state[8], state[9], ax, ay, static * normal, kinetic * normal, DT)
    state[6], state[7], state[8], state[9] = px, py, wx, wy
    x, vx = _pan_step(state[0], state[3], ax, DT)
    y, vy = _pan_step(state[1], state[4], ay, DT)
    z, vz = _pan_step(state[2], state[5], az, DT)
    state[0], state[1], state[2], state[3], state[4], state[5] = x, y, z, vx, vy, vz
    price = (px - command[k + 1, 0]) ** 2 + (py - command[k + 1, 1]) ** 2
    if x * x + y * y > bounds[2] ** 2:
        price += LIMIT_PRICE * (np.sqrt(x * x + y * y) - bounds[2]) ** 2
    if abs(z) > bounds[3]:
        price += LIMIT_PRICE * (abs(z) - bounds[3]) ** 2
    speed = vx * vx + vy * vy + vz * vz
    if speed > bounds[4] ** 2:
        price += SPEED_PRICE * (np.sqrt(speed) - bounds[4]) ** 2
    return float(price)


@numba.njit  # type: ignore[untyped-decorator]
def move(state: Any, u: Any, command: Any, k: int, span: int, static: float, kinetic: float, bounds: Any) -> float:
    """Go towards `u` for one knot of `span` samples from `k` on, and return its price; see `sample`."""
    price = 0.0
    for each in range(k, k + span):
        price += sample(state, u, command, each, static, kinetic, bounds)
    return price


@numba.njit  # type: ignore[untyped-decorator]
def execute(
    state: Any, u: Any, command: Any, k: int, span: int, static: float, kinetic: float, bounds: Any, out: Any
) -> None:
    """Go towards `u` for one knot of `span` samples from `k` on, and write the accelerations into rows of `out`."""
    for each in range(k, k + span):
        sample(state, u, command, each, static, kinetic, bounds)
        out[each] = state[10 : 10 + out.shape[1]]


@numba.njit  # type: ignore[untyped-decorator]
def price_of_change(u: Any, before: Any, span: int, bounds: Any) -> float:
    """Return the price of going from one knot's acceleration to the next one's, (3,) each (m/s^2)."""
    unit = bounds[2] / PAN_LIMIT * ACCELERATION / bounds[0]
    return float(CHANGE_PRICE * unit * unit * span * np.sum((u - before) ** 2))


@numba.njit  # type: ignore[untyped-decorator]
def bound(u: Any, bounds: Any) -> None:
    """Shorten an acceleration (3,) to the limit, and to LARGEST_SINK downwards, in place (m/s^2)."""
    u[2] = max(u[2], -LARGEST_SINK)
    size = np.sqrt(np.sum(u * u))
    if size > bounds[0]:
        u *= bounds[0] / size

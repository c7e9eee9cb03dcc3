"""What the sampling planners share: the compiled law of friction, the price of a motion, the bounds, the effort.

A plan is a sequence of knots, in each of which the acceleration is constant. A state is eight numbers: pan x, y, vx, vy
in the world, object x, y, vx, vy relative to the pan (m, m/s).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numba
import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, slide_step
from runtime.physics.pan import pan_step

KNOT = 10
"""Samples for which an acceleration is constant."""

HORIZON = 40
"""Knots that are planned at a time: 400 ms. In 250 ms a planner does not see that the pan will have to come back."""

REPLAN = 5
"""Knots executed before the next planning: 50 ms."""

ACCELERATION = 30.0
"""Bound on |u| (m/s^2), the same as the network's."""

PAN_LIMIT = 0.2
"""Limit of the pan's motion (m), softly enforced."""

LIMIT_PRICE = 3e3
"""Price of a sample beyond the pan limit, per metre squared, against 1 per metre squared of tracking error."""

CHANGE_PRICE = 2e-8
"""Price of a change of acceleration between knots, per (m/s^2)^2, against 1 per metre squared of tracking error."""

_slide_step, _pan_step = numba.njit(slide_step), numba.njit(pan_step)


@dataclass(frozen=True)
class SamplingPlanner(ABC):
    """A planner that draws candidates; calling it is a `benchmarks.suite.outcome.PlanFunction`.

    Attributes:
        candidates: number of candidates drawn in an iteration.
        iterations: number of times the plan is improved by them in a planning.
        seed: of the candidates.
    """

    KIND: ClassVar[str]

    candidates: int = 512
    iterations: int = 20
    seed: int = 0

    @property
    def name(self) -> str:
        """How tables call it."""
        return f"{self.KIND} {self.candidates} x {self.iterations}"

    def __call__(self, positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        """Plan the commands one after the other: (K, 2) positions (m) to (K, 2) pan accelerations (m/s^2)."""
        return [self.plan(position, friction) for position, friction in zip(positions, frictions, strict=True)]

    @abstractmethod
    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""


def held_command(position: FloatArray) -> FloatArray:
    """Return a (K, 2) command from the origin, held at its end as far as a planner looks."""
    held: FloatArray = np.concatenate([position, position[-1:].repeat(KNOT * (HORIZON + REPLAN), axis=0)])
    held -= position[0]
    return held


@numba.njit  # type: ignore[untyped-decorator]
def move(state: Any, ux: float, uy: float, command: Any, k: int, static_limit: float, kinetic_limit: float) -> float:
    """Hold (ux, uy) (m/s^2) for one knot from sample `k` on.

    Args:
        state: eight numbers, changed in place.
        ux, uy: the acceleration (m/s^2).
        command: (n, 2) where the object should be (m).
        k: the sample at which the knot begins.
        static_limit, kinetic_limit: mu g and mu' g (m/s^2).

    Returns:
        The price of the samples that follow.
    """
    x, y, vx, vy = state[0], state[1], state[2], state[3]
    px, py, wx, wy = state[4], state[5], state[6], state[7]
    price = 0.0
    for _ in range(KNOT):
        px, py, wx, wy = _slide_step(px, py, wx, wy, ux, uy, static_limit, kinetic_limit, DT)
        x, vx = _pan_step(x, vx, ux, DT)
        y, vy = _pan_step(y, vy, uy, DT)
        k += 1
        price += (px - command[k, 0]) ** 2 + (py - command[k, 1]) ** 2
        if x * x + y * y > PAN_LIMIT**2:
            price += LIMIT_PRICE * (np.sqrt(x * x + y * y) - PAN_LIMIT) ** 2
    state[0], state[1], state[2], state[3] = x, y, vx, vy
    state[4], state[5], state[6], state[7] = px, py, wx, wy
    return price


@numba.njit  # type: ignore[untyped-decorator]
def price_of_change(ux: float, uy: float, before_x: float, before_y: float) -> float:
    """Return the price of going from one knot's acceleration to the next one's (m/s^2)."""
    return CHANGE_PRICE * KNOT * ((ux - before_x) ** 2 + (uy - before_y) ** 2)


@numba.njit  # type: ignore[untyped-decorator]
def bounded(ux: float, uy: float) -> tuple[float, float]:
    """Return the acceleration, shortened to the bound (m/s^2)."""
    size = np.sqrt(ux * ux + uy * uy)
    factor = ACCELERATION / size if size > ACCELERATION else 1.0
    return ux * factor, uy * factor

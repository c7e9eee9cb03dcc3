"""Refinement: a plan made better by descending its tracking error through the adjoint of the law.

The network plans in a single pass; what is left of the error is brought down by Adam on the pan's accelerations, with
one second moment for all of them, so that the step is a number of m/s^2. After each step the accelerations are
made to keep the limits on acceleration and jerk again, and a soft penalty keeps the pan in reach; at the end the
governor goes over the best accelerations found, so that a refined plan keeps its limits by the same proof as any other.

`track` and `descend` are plain Python over sequences of floats: lists as they are, arrays where numba compiles them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from runtime.adjoint import slide_step_adjoint
from runtime.documents import FloatArray
from runtime.friction import DT, GRAVITY, Friction, rollout, slide_step
from runtime.governor import Motion, govern
from runtime.limits import Limits

STEP = 0.05
"""Length of a step (m/s^2), root mean square over the samples, once the gradient is steady."""

MOMENTUM = 0.9
SECOND_MOMENT = 0.99
"""Adam's memories of the gradient and of its square; the latter shorter than usual, for a few hundred steps."""

SOFT_REACH = 0.97
"""Share of the reach from which the penalty begins."""

REACH_WEIGHT = 10.0
"""Of the squared excess beyond it, against the squared tracking error."""

TINY = 1e-30
"""Added to the second moment (m^2 s^4): a plan that cannot be better has no gradient to divide by."""

Column = Any
"""A sequence of floats that can be written to: a list, or an array where the functions are compiled."""

Point = tuple[float, float, float, float, float, float, float, float]
"""Pan x, y, vx, vy and object x, y, vx, vy (m, m/s)."""


class Kernels(NamedTuple):
    """The two loops over the samples, and how a column is made for them."""

    track: Callable[..., tuple[float, float]]
    descend: Callable[..., float]
    column: Callable[[FloatArray], Column]


@cache
def kernels() -> Kernels:
    """Return the loops, compiled if numba is installed: some forty times faster, after seconds to compile them."""
    try:
        import numba
    except ImportError:
        make = _make(lambda function: function)
        return Kernels(*make, lambda values: values.tolist())
    found = Kernels(*_make(numba.njit(nogil=True)), lambda values: np.ascontiguousarray(values, dtype=np.float64))
    columns = [np.zeros(1) for _ in range(14)]
    found.track(*columns[:4], (0.0,) * 8, 1.0, 1.0, 1.0, *columns[4:10])  # compiles, so that no plan waits for it
    found.descend(*columns[:4], 1.0, 1.0, 1.0, *columns[4:], 0.0, 1, (0.0, 0.0), 1.0, 1.0)
    return found


def _make(compiler: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Compile law, adjoint and the two loops with `compiler`."""
    step, step_adjoint = compiler(slide_step), compiler(slide_step_adjoint)

    @compiler
    def track(  # type: ignore[no-untyped-def]
        ux, uy, cx, cy, point, static_limit, kinetic_limit, reach, px, py, vx, vy, wx, wy
    ):
        """Move pan and object along u; fill pan positions p, object velocities v and positions w before each sample.

        Returns the mean squared distance to the command c (m^2), and the same with the penalty on the reach.
        """
        half = 0.5 * DT * DT
        x, y, pvx, pvy, ox, oy, ovx, ovy = point
        squared = 0.0
        penalty = 0.0
        for k in range(len(ux)):
            px[k], py[k], vx[k], vy[k], wx[k], wy[k] = x, y, ovx, ovy, ox, oy
            squared += (ox - cx[k]) ** 2 + (oy - cy[k]) ** 2
            excess = math.sqrt(x * x + y * y) - reach
            if excess > 0.0:
                penalty += REACH_WEIGHT * excess * excess
            ox, oy, ovx, ovy = step(ox, oy, ovx, ovy, ux[k], uy[k], static_limit, kinetic_limit, DT)
            x += pvx * DT + ux[k] * half
            y += pvy * DT + uy[k] * half
            pvx += ux[k] * DT
            pvy += uy[k] * DT
        return squared / len(ux), (squared + penalty) / len(ux)

    @compiler
    def descend(  # type: ignore[no-untyped-def]
        ux, uy, cx, cy, static_limit, kinetic_limit, reach, px, py, vx, vy, wx, wy, mx, my, gx, gy,
        second, count, start, bound, change,
    ):  # fmt: skip
        """Take one step down: fill the gradient g, carry the momentum m, change u within `bound` and `change`.

        Returns the second moment; `count` is the number of this step, from 1.
        """
        half = 0.5 * DT * DT
        samples = len(ux)
        gpx = gpy = gvx = gvy = gox = goy = gwx = gwy = 0.0
        total = 0.0
        for k in range(samples - 1, -1, -1):
            # The gradient with respect to the state after sample k becomes that with respect to the state before.
            gwx, gwy, sx, sy = step_adjoint(
                vx[k], vy[k], ux[k], uy[k], static_limit, kinetic_limit, DT, gox, goy, gwx, gwy
            )
            gx[k] = sx + gvx * DT + gpx * half
            gy[k] = sy + gvy * DT + gpy * half
            total += gx[k] * gx[k] + gy[k] * gy[k]
            gvx += gpx * DT
            gvy += gpy * DT
            gox += 2.0 * (wx[k] - cx[k]) / samples
            goy += 2.0 * (wy[k] - cy[k]) / samples
            distance = math.sqrt(px[k] * px[k] + py[k] * py[k])
            if distance > reach:
                pull = 2.0 * REACH_WEIGHT * (distance - reach) / distance / samples
                gpx += pull * px[k]
                gpy += pull * py[k]
        second = SECOND_MOMENT * second + (1.0 - SECOND_MOMENT) * total / samples
        rate = STEP / math.sqrt(second / (1.0 - SECOND_MOMENT**count) + TINY) / (1.0 - MOMENTUM**count)
        lastx, lasty = start
        for k in range(samples):
            mx[k] = MOMENTUM * mx[k] + (1.0 - MOMENTUM) * gx[k]
            my[k] = MOMENTUM * my[k] + (1.0 - MOMENTUM) * gy[k]
            x = ux[k] - rate * mx[k]
            y = uy[k] - rate * my[k]
            size = math.sqrt(x * x + y * y)
            if size > bound:
                x *= bound / size
                y *= bound / size
            dx = x - lastx
            dy = y - lasty
            size = math.sqrt(dx * dx + dy * dy)
            if size > change:
                dx *= change / size
                dy *= change / size
            lastx += dx
            lasty += dy
            ux[k] = lastx
            uy[k] = lasty
        return second

    return track, descend


class Effort(NamedTuple):
    """How long to refine: a time (s), or a number of steps, with which the result is the same each time."""

    seconds: float
    iterations: int | None = None


class Refined(NamedTuple):
    """A refined motion.

    Attributes:
        acceleration: (n, 2) (m/s^2), within the limits.
        asked: (n, 2) before the governor went over it (m/s^2).
        pan, sliding: (n + 1, 4) states of pan and object before and after each sample.
    """

    acceleration: FloatArray
    asked: FloatArray
    pan: FloatArray
    sliding: FloatArray


def refine(
    u: FloatArray,
    motion: Motion,
    sliding: FloatArray,
    command: FloatArray,
    friction: Friction,
    chunk: int,
    effort: Effort,
) -> Refined | None:
    """Descend the tracking error of planned accelerations.

    Args:
        u: (n, 2) planned (m/s^2), within the limits; the last may lead out of the command.
        motion: the pan at the start, with its limits, which are finite.
        sliding: (4,) object position (m) and velocity (m/s) at the start.
        command: (n, 2) where the object should be before each sample (m).
        friction: what to plan for.
        chunk: samples that the governor looks at together.
        effort: how long to try.

    Returns:
        The best motion found, None if it tracks no better than `u`.
    """
    found = _descend(u, motion, sliding, command, friction, effort)
    kept = _governed(found, motion, sliding, friction, chunk)
    better = _error(kept.acceleration, sliding, command, friction) < _error(u, sliding, command, friction)
    return kept if better else None


def _descend(
    u: FloatArray,
    motion: Motion,
    sliding: FloatArray,
    command: FloatArray,
    friction: Friction,
    effort: Effort,
) -> FloatArray:
    """Return the best accelerations found until the time is up or the steps are taken."""
    track, descend, column = kernels()
    until = time.perf_counter() + effort.seconds
    limits: Limits = motion.limits
    law = friction.static * GRAVITY, friction.kinetic * GRAVITY, SOFT_REACH * limits.pan_reach
    cx, cy, ux, uy = (column(values) for values in (*command.T, *u.T))
    states = [column(np.zeros(len(u))) for _ in range(6)]
    moments = [column(np.zeros(len(u))) for _ in range(4)]
    point: Point = (*motion.state[:4], *sliding.tolist())
    best, least, second, count = u, math.inf, 0.0, 0
    while True:
        _, cost = track(ux, uy, cx, cy, point, *law, *states)
        if cost < least:
            least, best = cost, np.array([ux, uy]).T
        if time.perf_counter() >= until if effort.iterations is None else count >= effort.iterations:
            return best
        count += 1
        within = limits.acceleration, limits.jerk * DT
        second = descend(ux, uy, cx, cy, *law, *states, *moments, second, count, motion.state[4:], *within)


def _governed(u: FloatArray, motion: Motion, sliding: FloatArray, friction: Friction, chunk: int) -> Refined:
    """Let the governor go over accelerations, chunk by chunk."""
    pans, accelerations = [np.array([motion.state[:4]])], []
    for first in range(0, len(u), chunk):
        governed = govern([motion], u[None, first : first + chunk])
        motion = governed.motions[0]
        accelerations.append(governed.acceleration[0])
        pans.append(governed.pan[0])
    kept = np.concatenate(accelerations)
    return Refined(kept, u, np.concatenate(pans), np.concatenate([sliding[None], rollout(sliding, kept, friction)]))


def _error(u: FloatArray, sliding: FloatArray, command: FloatArray, friction: Friction) -> float:
    """Return the mean squared distance between object and command (m^2)."""
    states = np.concatenate([sliding[None], rollout(sliding, u[:-1], friction)])
    return float(np.mean(np.sum((states[:, :2] - command) ** 2, axis=1)))

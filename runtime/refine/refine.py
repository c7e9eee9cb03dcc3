"""Refinement: a plan made better by descending its tracking error through the law.

The network plans in a single pass; what is left of the error is brought down by Gauss-Newton steps on the pan's
accelerations (`runtime.refine.gauss_newton`), damped until they pay. A step sees only what the strokes it has would
gain from being a little different; where none pays, single strokes are kicked, at random but the same each time, while
all that follows answers as the last step found best, and what tracks better is kept.

A pan that lifts is refined in its plane: its height stays as planned, and what presses the object on it changes from
sample to sample.

Each try keeps the limits on acceleration and jerk, and a penalty keeps the pan in reach; of what is found, the best
that also keeps its reach, and from whose end a stop in reach leads on, is what counts. The governor goes over it in the
end, so that a refined plan keeps its limits by the same proof as any other.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.compiled import compile_together, compiler
from runtime.physics.law import DT, GRAVITY, compiled_law, slide, slide_one
from runtime.physics.motion import Motion, lengths
from runtime.physics.pan import IN_PLANE, integrate_pan
from runtime.refine.gauss_newton import BLOCK, FUNCTIONS, Column, move, row_size, state_size, sweep
from runtime.safety.governor import govern
from runtime.safety.pan import Pan, state_after
from runtime.safety.stop import PanState, find_brake, gentle_strength, stop_extent, strongest

SOFT_REACH = 0.97
"""Share of the reach from which the penalty begins."""

RAMPS = 1.5
"""Times that the acceleration takes from zero to its limit, by which a stop takes longer than at the limit alone."""

BRAKED_FROM = 1.0
"""Speed of a pan (m/s) that is stopped before it brakes as hard as a loose limit allows."""

DAMPING = 1e-6
"""Damping of the first step (m^2 per (m/s^2)^2)."""

EASE, STIFFEN = 0.4, 6.0
"""What the damping is multiplied by after a whole step that paid, and after one of which no share did."""

LEAST_DAMPING, MOST_DAMPING = 1e-12, 1e-4

ROUNDING = 1e-12
"""Share of what is left to the plane that is not used: a length that is put together again may be larger by its last
bit, and the governor would look at each chunk."""

SHARES = (1.0, 0.4, 0.16)
"""Of a step, tried one after the other until one pays."""

KICKS = 12
"""Kicks that are tried in a row before a step is."""

KICK_BLOCKS = (2, 13)
"""Blocks that a kick lasts, at least and at most."""

KICK_SIZE = (1.0, 12.0)
"""Range of a kick's size (m/s^2), even on a logarithmic scale."""


ROBUST = 0.1
"""Share by which the friction may be off unless something else is said: what two pans of one make differ by."""

PLANNED_FOR = 12.0
"""Weight of the friction that is planned for, beside 1 for each other one: with less the others gain nothing more, and
the plan is worse where all is as was said."""


class Kernels(NamedTuple):
    """`runtime.refine.gauss_newton`'s two loops over the samples, and how a column is made for them."""

    move: Callable[..., tuple[float, float, float]]
    sweep: Callable[..., None]
    column: Callable[[FloatArray], Column]


PLAIN = Kernels(move, sweep, lambda values: values.ravel().tolist())
"""For where numba is not installed."""


@cache
def kernels() -> Kernels:
    """Return the loops, compiled if numba is installed: 200 times faster, after seconds to compile them."""
    compile_one = compiler()
    if compile_one is None:
        return PLAIN
    functions = compile_together(FUNCTIONS, compile_one)
    found = Kernels(functions["move"], functions["sweep"], lambda values: np.array(values, dtype=np.float64).ravel())
    nothing = np.zeros((1, 2))
    descent = Descent(
        found, nothing, nothing, np.zeros(4), np.zeros(4), [Friction()], (1.0, 1.0, 0.0), np.ones((1, 3)), (0.0, 0.0)
    )
    descent.go_on()  # compiles, so that no plan waits for it
    return found


class Effort(NamedTuple):
    """How long to refine: a time (s), or a number of steps, with which the result is the same each time.

    Attributes:
        seconds: time to spend.
        iterations: steps to take instead.
        robust: share by which the friction may be off, each coefficient by itself: a step is taken if it pays on the
            mean over the friction planned for and these four. 0 for the one planned for only, which gives plans that
            are better under it and worse under any other.
    """

    seconds: float
    iterations: int | None = None
    robust: float = ROBUST


class Descent:
    """Accelerations on their way down.

    Args:
        loops: the kernels.
        u: (n, 2) accelerations to begin with (m/s^2).
        command: (n, 2) where the object should be before each sample (m).
        pan, sliding: (4,) pan and object at the start.
        frictions: under each of which the object is to follow; the first is the one planned for.
        law, room, before: as `runtime.refine.gauss_newton.move` takes them, `room` (n, 3).

    Attributes:
        squared: sum of the squared distances to the command (m^2), on the weighted mean over the frictions.
        farthest: largest distance of the pan from the centre (m).
    """

    def __init__(
        self,
        loops: Kernels,
        u: FloatArray,
        command: FloatArray,
        pan: FloatArray,
        sliding: FloatArray,
        frictions: Sequence[Friction],
        law: tuple[float, ...],
        room: FloatArray,
        before: tuple[float, ...],
    ) -> None:
        column = loops.column
        self._start = np.concatenate([pan, np.tile(sliding, len(frictions))])
        self._loops, self._law, self._room, self._before = loops, law, column(room), before
        self._friction = column(GRAVITY * np.array([(each.static, each.kinetic) for each in frictions]))
        state = state_size(len(frictions))
        self._weights = column(weights(len(frictions)))
        self._row = row_size(state)
        self._command, self._u, self._other = column(command), column(u), column(u)
        self._states, self._other_states = (column(np.zeros((len(u), state))) for _ in range(2))
        self._blocks = -(-len(u) // BLOCK)
        self._gains = column(np.zeros((self._blocks, self._row)))
        self._model = column(np.zeros((state + 2, state + 2))), column(np.zeros(state + 2))
        self._damping, self._kicks = DAMPING, 0
        self._random = np.random.default_rng(0)
        self.squared = self._cost = self.farthest = math.inf
        self._try(0.0)

    def acceleration(self) -> FloatArray:
        """Return (n, 2) (m/s^2)."""
        return np.array(self._u).reshape(-1, 2)

    def end(self) -> PanState:
        """Return the pan after the last sample."""
        return _in_plane([float(value) for value in self._end[:4]], [float(value) for value in self._u[-2:]])

    def velocity(self) -> FloatArray:
        """Return the pan's velocity in the plane before each sample, (n, 2) (m/s)."""
        return np.array(self._states).reshape(len(self._u) // 2, -1)[:, 2:4]

    def go_on(self) -> bool:
        """Take a step, or try a kick where none paid; returns whether the cost is less than before."""
        if self._kicks:
            self._kick()
            better = self._try(1.0)
            self._kicks = 0 if better else self._kicks - 1
            return better
        self._sweep(self._damping)
        for share in SHARES:
            if self._try(share):
                if share == 1.0:
                    self._damping = max(self._damping * EASE, LEAST_DAMPING)
                return True
        self._damping = min(self._damping * STIFFEN, MOST_DAMPING)
        self._kicks = KICKS
        self._sweep(DAMPING)  # for its answers
        return False

    def _sweep(self, damping: float) -> None:
        self._loops.sweep(
            self._u, self._command, self._end, self._friction, self._weights, self._law, self._room,
            self._states, damping, self._gains, *self._model,
        )  # fmt: skip

    def _kick(self) -> None:
        """Let the blocks do nothing by themselves but for a few, there and back; their answers stay."""
        gains, draw = self._gains, self._random
        for row in range(0, self._row * self._blocks, self._row):
            gains[row] = gains[row + 1] = 0.0
        count = int(draw.integers(KICK_BLOCKS[0], KICK_BLOCKS[1], endpoint=True))
        first = int(draw.integers(1 - count, self._blocks))
        size = math.exp(draw.uniform(math.log(KICK_SIZE[0]), math.log(KICK_SIZE[1])))
        angle = draw.uniform(0.0, 2.0 * math.pi)
        for block in range(max(first, 0), min(first + count, self._blocks)):
            phase = math.pi * (block - first + 0.5) / count
            amount = size * math.sin(phase) * math.sin(2.0 * phase)
            gains[self._row * block] = amount * math.cos(angle)
            gains[self._row * block + 1] = amount * math.sin(angle)

    def _try(self, share: float) -> bool:
        """Move along a share of the gains, and stay there if that is better."""
        end = self._loops.column(self._start)
        squared, cost, farthest = self._loops.move(
            self._u, self._command, end, self._friction, self._weights, self._law, self._room, self._before,
            self._gains, self._states, share, self._other_states, self._other,
        )  # fmt: skip
        if not cost < self._cost:
            return False
        self.squared, self._cost, self.farthest, self._end = squared, cost, farthest, end
        self._u, self._other = self._other, self._u
        self._states, self._other_states = self._other_states, self._states
        return True


def refine(
    u: FloatArray,
    pan: Pan,
    sliding: FloatArray,
    command: FloatArray,
    friction: Friction,
    chunk: int,
    effort: Effort,
    loops: Kernels | None = None,
) -> tuple[Motion, Pan] | None:
    """Descend the tracking error of planned accelerations.

    Args:
        u: (n, 3) planned (m/s^2), within the limits; the last may lead out of the command. What goes up is kept.
        pan: at the start, with its limits, which are finite.
        sliding: (4,) object position (m) and velocity (m/s) at the start.
        command: (n, 2) where the object should be before each sample (m).
        friction: what to plan for.
        chunk: samples that the governor looks at together, should it have to change anything.
        effort: how long to try, and what for.
        loops: what to run; `kernels()` if None.

    Returns:
        The best motion found and the pan at its end, None if it tracks no better than `u`.
    """
    frictions = expected(friction, effort.robust)
    found = _descend(u, pan, sliding, command, frictions, effort, loops or kernels())
    kept, ahead = _governed(found, pan, sliding, friction, len(found))  # a stop from its end alone was seen to
    if not np.array_equal(kept.acceleration, found):
        kept, ahead = _governed(found, pan, sliding, friction, chunk)
    before, after = (robust_error(each, sliding, command, frictions) for each in (u, kept.acceleration))
    return (kept, ahead) if after < before else None


def _descend(
    u: FloatArray,
    pan: Pan,
    sliding: FloatArray,
    command: FloatArray,
    frictions: Sequence[Friction],
    effort: Effort,
    loops: Kernels,
) -> FloatArray:
    """Return the best accelerations found until the time is up or the steps are taken."""
    until = time.perf_counter() + effort.seconds
    limits = pan.limits
    ramps = RAMPS * min(limits.acceleration / limits.jerk, math.sqrt(BRAKED_FROM / limits.jerk))
    start, states = np.array(pan.state), integrate_pan(np.array(pan.state[:6]), u)
    braking = _braking(state_after(states, u), limits, frictions[0])
    law = SOFT_REACH * limits.pan_reach, braking, ramps
    room = _room(u[:, 2], pan)
    descent = Descent(loops, u[:, :2], command, start[IN_PLANE], sliding, frictions, law, room, pan.state[6:8])
    best, least, count = u, descent.squared, 0
    upwards = np.concatenate([start[5:6], states[:-1, 5]])

    def kept() -> bool:
        """Whether the speed is, and a stop leads on; the height is as planned."""
        if math.isfinite(limits.speed) and np.hypot(lengths(descent.velocity()), upwards).max() > limits.speed:
            return False
        z, vz, uz = states[-1, 2], states[-1, 5], u[-1, 2]
        return _can_stop(descent.end()._replace(z=float(z), vz=float(vz), uz=float(uz)), limits, braking)

    while time.perf_counter() < until if effort.iterations is None else count < effort.iterations:
        count += 1
        better = descent.go_on() and descent.squared < least and descent.farthest <= limits.pan_reach
        if better and kept():
            best, least = np.concatenate([descent.acceleration(), u[:, 2:]], axis=1), descent.squared
    return best


def _room(lift: FloatArray, pan: Pan) -> FloatArray:
    """Return what accelerations upwards (n,) (m/s^2) leave to those in the plane; see `gauss_newton.move`."""
    limits = pan.limits
    bound, change = limits.acceleration, limits.jerk * DT
    if limits.level:
        return np.tile([1.0, bound, change], (len(lift), 1))
    rise = np.diff(lift, prepend=pan.state.uz)
    left = [np.sqrt(np.maximum(whole * whole - part * part, 0.0)) for whole, part in ((bound, lift), (change, rise))]
    return np.stack([1.0 + lift / GRAVITY, *(each * (1.0 - ROUNDING) for each in left)], axis=1)


def _in_plane(pan: Sequence[float], u: Sequence[float]) -> PanState:
    """Return the state of a level pan from x, y, vx, vy (m, m/s) and its acceleration in the plane (m/s^2)."""
    (x, y, vx, vy), (ux, uy) = pan, u
    return PanState(x, y, 0.0, vx, vy, 0.0, ux, uy, 0.0)


def _braking(end: PanState, limits: Limits, friction: Friction) -> float:
    """Return how hard a pan may brake after a plan (m/s^2): so that a resting object stays where it is, if that goes.

    What could be stopped gently can be stopped so after refinement too; else an object that was on its mark in the end
    would slide away from it as soon as the plan is over.
    """
    gentle = min(gentle_strength(friction.static, limits), limits.acceleration)
    return gentle if gentle > 0.0 and _can_stop(end, limits, gentle) else limits.acceleration


def _can_stop(end: PanState, limits: Limits, braking: float) -> bool:
    most = strongest(end, limits.acceleration, limits.jerk)
    return stop_extent(end, find_brake(end, limits, min(braking, most))).within(limits)


def _governed(u: FloatArray, pan: Pan, sliding: FloatArray, friction: Friction, chunk: int) -> tuple[Motion, Pan]:
    """Let the governor go over accelerations, `chunk` samples at a time."""
    pans: Sequence[Pan] = [pan]
    states, accelerations = [np.array([pan.state[:6]])], []
    for first in range(0, len(u), chunk):
        acceleration, moved, pans = govern(pans, u[None, first : first + chunk])
        accelerations.append(acceleration[0])
        states.append(moved[0])
    kept = np.concatenate(accelerations)
    slid = np.concatenate([sliding[None], slide_one(sliding, kept, friction)])
    return Motion(kept, u, np.concatenate(states), slid), pans[0]


def expected(friction: Friction, robust: float) -> list[Friction]:
    """Return the frictions that a plan is judged by: the one planned for, and those around it if `robust` is not 0."""
    return [friction, *friction.corners(robust)] if robust > 0.0 else [friction]


def weights(frictions: int) -> FloatArray:
    """Return how much each of these frictions counts, (n,) with the sum 1."""
    each = np.ones(frictions)
    each[0] = PLANNED_FOR
    shares: FloatArray = each / each.sum()
    return shares


def robust_error(u: FloatArray, sliding: FloatArray, command: FloatArray, frictions: Sequence[Friction]) -> float:
    """Return the mean squared distance between object and command (m^2), on the weighted mean over frictions.

    Args:
        u: (K, 3) pan accelerations (m/s^2).
        sliding: (4,) the object at the start (m, m/s).
        command: (K, 2) where it should be before each sample (m).
        frictions: as `expected` returns them.
    """
    count, compiled = len(frictions), compiled_law()
    if compiled is not None:
        return float(weights(count) @ compiled.squares(sliding, u, command, frictions)) / len(command)
    slid = slide(np.tile(sliding, (count, 1)), np.tile(u[:-1], (count, 1, 1)), frictions)
    errors = slid[..., :2] - command[1:]
    squared = np.sum(errors * errors, axis=(1, 2)) + np.sum((sliding[:2] - command[0]) ** 2)
    return float(weights(count) @ squared) / len(command)

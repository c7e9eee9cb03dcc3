"""A receding-horizon cross-entropy planner on the compiled law of friction, told the friction it plans for.

Every `REPLAN` samples it draws candidate accelerations over the horizon, rolls each out through the law, keeps the
best, fits mean and spread to them, draws again, and executes the beginning of the best one found. See de Boer et al.,
"A Tutorial on the Cross-Entropy Method", Annals of Operations Research 134 (2005), and Pinneri et al.,
"Sample-efficient Cross-Entropy Method for Real-time Planning", CoRL 2020, for keeping elites and shifting the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from runtime.friction import DT, GRAVITY, FloatArray, Friction, slide_step

KNOT = 10
"""Samples for which a candidate's acceleration is constant."""

HORIZON = 25
"""Knots a candidate looks ahead: 250 ms."""

REPLAN = 5
"""Knots executed before the next planning: 50 ms."""

ACCELERATION = 30.0
"""Bound on |u| (m/s^2), the same as the network's."""

PAN_LIMIT = 0.2
"""Limit of the pan's motion (m), softly enforced."""

ELITE_SHARE = 0.1
"""Share of the candidates to which mean and spread are fitted."""

FRESH_SPREAD = 8.0
"""Standard deviation of knots that nothing is known about yet (m/s^2)."""

WARM_SPREAD = 5.0
"""Standard deviation of knots carried over from the last planning (m/s^2)."""

LIMIT_PRICE = 3e3
"""Cost of a sample beyond the pan limit, per metre squared, against 1 per metre squared of tracking error."""

CHANGE_PRICE = 2e-8
"""Cost of a change of acceleration between knots, per (m/s^2)^2, against 1 per metre squared of tracking error."""

_step = numba.njit(slide_step)


@dataclass(frozen=True)
class CrossEntropy:
    """The planner; calling it is a `benchmarks.accuracy.PlanFunction`.

    Attributes:
        candidates: number of candidates drawn in an iteration.
        iterations: number of times mean and spread are fitted in a planning.
        seed: of the candidates.
    """

    candidates: int = 512
    iterations: int = 20
    seed: int = 0

    @property
    def name(self) -> str:
        """How tables call it."""
        return f"CEM {self.candidates} x {self.iterations}"

    def __call__(self, positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        """Plan the commands one after the other: (K, 2) positions (m) to (K, 2) pan accelerations (m/s^2)."""
        return [self.plan(position, friction) for position, friction in zip(positions, frictions, strict=True)]

    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""
        samples = len(position)
        held = np.concatenate([position, position[-1:].repeat(KNOT * (HORIZON + REPLAN), axis=0)]) - position[0]
        u = np.empty((samples + KNOT * REPLAN, 2))
        elites = max(int(ELITE_SHARE * self.candidates), 4)
        _plan(
            held,
            samples,
            friction.static * GRAVITY,
            friction.kinetic * GRAVITY,
            self.candidates,
            self.iterations,
            elites,
            self.seed,
            u,
        )
        return u[:samples]


@numba.njit  # type: ignore[untyped-decorator]
def _cost(
    state: Any, before: Any, knots: Any, command: Any, first: int, static_limit: float, kinetic_limit: float
) -> float:
    """Roll one candidate out from `state` (pan and object, 8 numbers) and price it."""
    x, y, vx, vy, px, py, wx, wy = state
    cost = 0.0
    last_x, last_y = before
    k = first
    for knot in range(HORIZON):
        ux, uy = knots[knot]
        cost += CHANGE_PRICE * KNOT * ((ux - last_x) ** 2 + (uy - last_y) ** 2)
        last_x, last_y = ux, uy
        for _ in range(KNOT):
            px, py, wx, wy = _step(px, py, wx, wy, ux, uy, static_limit, kinetic_limit, DT)
            x += vx * DT + 0.5 * ux * DT * DT
            y += vy * DT + 0.5 * uy * DT * DT
            vx += ux * DT
            vy += uy * DT
            k += 1
            cost += (px - command[k, 0]) ** 2 + (py - command[k, 1]) ** 2
            over = np.sqrt(x * x + y * y) - PAN_LIMIT
            if over > 0.0:
                cost += LIMIT_PRICE * over * over
    return cost


@numba.njit  # type: ignore[untyped-decorator]
def _draw(mean: Any, spread: Any, knots: Any) -> None:
    """Draw one candidate and bound it."""
    for knot in range(HORIZON):
        ux = mean[knot, 0] + spread[knot, 0] * np.random.standard_normal()  # noqa: NPY002 (numba has no Generator here)
        uy = mean[knot, 1] + spread[knot, 1] * np.random.standard_normal()  # noqa: NPY002
        size = np.sqrt(ux * ux + uy * uy)
        factor = ACCELERATION / size if size > ACCELERATION else 1.0
        knots[knot, 0] = ux * factor
        knots[knot, 1] = uy * factor


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def _plan(
    command: Any,
    samples: int,
    static_limit: float,
    kinetic_limit: float,
    candidates: int,
    iterations: int,
    elites: int,
    seed: int,
    u: Any,
) -> None:
    """Plan a whole command into `u`, replanning as time goes on."""
    np.random.seed(seed)  # noqa: NPY002
    state = np.zeros(8)
    before = np.zeros(2)
    mean = np.zeros((HORIZON, 2))
    spread = np.full((HORIZON, 2), FRESH_SPREAD)
    knots = np.empty((candidates, HORIZON, 2))
    costs = np.empty(candidates)
    for first in range(0, samples, KNOT * REPLAN):
        best = mean.copy()
        lowest = _cost(state, before, best, command, first, static_limit, kinetic_limit)
        for iteration in range(iterations):
            for candidate in range(candidates):
                if candidate > 0 or iteration == 0:  # the best so far stays among the candidates
                    _draw(mean, spread, knots[candidate])
                else:
                    knots[candidate] = best
                costs[candidate] = _cost(state, before, knots[candidate], command, first, static_limit, kinetic_limit)
            order = np.argsort(costs)[:elites]
            if costs[order[0]] < lowest:
                lowest = costs[order[0]]
                best = knots[order[0]].copy()
            for knot in range(HORIZON):
                for axis in range(2):
                    mean[knot, axis] = knots[order, knot, axis].mean()
                    spread[knot, axis] = knots[order, knot, axis].std()
        for knot in range(REPLAN):
            ux, uy = best[knot]
            for k in range(first + KNOT * knot, first + KNOT * (knot + 1)):
                u[k] = best[knot]
                state[4], state[5], state[6], state[7] = _step(
                    state[4], state[5], state[6], state[7], ux, uy, static_limit, kinetic_limit, DT
                )
                state[0] += state[2] * DT + 0.5 * ux * DT * DT
                state[1] += state[3] * DT + 0.5 * uy * DT * DT
                state[2] += ux * DT
                state[3] += uy * DT
        before[:] = best[REPLAN - 1]
        mean[: HORIZON - REPLAN] = best[REPLAN:]
        mean[HORIZON - REPLAN :] = best[HORIZON - 1]
        spread[: HORIZON - REPLAN] = WARM_SPREAD
        spread[HORIZON - REPLAN :] = FRESH_SPREAD

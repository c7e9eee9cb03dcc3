"""A receding-horizon cross-entropy planner on the compiled law of friction, told the friction it plans for.

Every `REPLAN` samples it draws candidate accelerations over the horizon, rolls each out through the law, keeps the
best, fits mean and spread to them, draws again, and executes the beginning of the best one found. See de Boer et al.,
"A Tutorial on the Cross-Entropy Method", Annals of Operations Research 134 (2005), and Pinneri et al.,
"Sample-efficient Cross-Entropy Method for Real-time Planning", CoRL 2020, for keeping elites and shifting the mean.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from benchmarks.peers.objective import (
    HORIZON,
    REPLAN,
    WIDTH,
    SamplingPlanner,
    bound,
    execute,
    held_command,
    move,
    price_of_change,
)
from runtime.documents.checks import FloatArray
from runtime.friction import Friction

ELITE_SHARE = 0.05
"""Share of the candidates to which mean and spread are fitted."""

FRESH_SPREAD = 8.0
"""Standard deviation of knots that nothing is known about yet (m/s^2), for ACCELERATION of the objective."""

WARM_SPREAD = 5.0
"""Standard deviation of knots carried over from the last planning (m/s^2), likewise."""


class CrossEntropy(SamplingPlanner):
    """The planner; in an iteration, mean and spread are fitted to the best candidates."""

    KIND = "CEM"

    def plan(self, position: FloatArray, friction: Friction) -> FloatArray:
        """Plan one command."""
        samples = len(position)
        u = np.empty((samples + self.span * REPLAN, self.axes))
        elites = max(int(ELITE_SHARE * self.candidates), 4)
        _plan(
            held_command(position, self.span),
            samples,
            self.span,
            friction.static,
            friction.kinetic,
            self.bounds,
            self.strength,
            self.candidates,
            self.iterations,
            elites,
            self.seed,
            u,
        )
        return u[:samples]


@numba.njit  # type: ignore[untyped-decorator]
def _price(
    start: Any,
    before: Any,
    knots: Any,
    command: Any,
    first: int,
    span: int,
    static: float,
    kinetic: float,
    bounds: Any,
    state: Any,
    ceiling: float,
) -> float:
    """Price one candidate, whose knots have `span` samples, from the state `start`; infinite from `ceiling` on.

    `state` is overwritten.
    """
    state[:] = start
    price = 0.0
    last = before
    for knot in range(HORIZON):
        u = knots[knot]
        price += price_of_change(u, last, span, bounds)
        price += move(state, u, command, first + span * knot, span, static, kinetic, bounds)
        last = u
        if price >= ceiling:
            return np.inf
    return price


@numba.njit  # type: ignore[untyped-decorator]
def _draw(mean: Any, spread: Any, bounds: Any, axes: int, knots: Any) -> None:
    """Draw one candidate and bound it."""
    for knot in range(HORIZON):
        for axis in range(axes):
            drawn = np.random.standard_normal()  # noqa: NPY002 (numba has no Generator here)
            knots[knot, axis] = mean[knot, axis] + spread[knot, axis] * drawn
        bound(knots[knot], bounds)


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def _plan(
    command: Any,
    samples: int,
    span: int,
    static: float,
    kinetic: float,
    bounds: Any,
    strength: float,
    candidates: int,
    iterations: int,
    elites: int,
    seed: int,
    u: Any,
) -> None:
    """Plan a whole command into `u`, replanning as time goes on."""
    np.random.seed(seed)  # noqa: NPY002
    axes = u.shape[1]
    state, scratch = np.zeros(WIDTH), np.zeros(WIDTH)
    before = np.zeros(3)
    mean = np.zeros((HORIZON, 3))
    spread = np.full((HORIZON, 3), FRESH_SPREAD * strength)
    knots = np.zeros((candidates, HORIZON, 3))
    elite, elite_costs = np.zeros(elites, np.int64), np.empty(elites)
    for first in range(0, samples, span * REPLAN):
        best = mean.copy()
        lowest = _price(state, before, best, command, first, span, static, kinetic, bounds, scratch, np.inf)
        for iteration in range(iterations):
            elite_costs[:] = np.inf
            worst = 0  # of the elite so far; who costs more need not be rolled out to the end
            for candidate in range(candidates):
                if candidate > 0 or iteration == 0:  # the best so far stays among the candidates
                    _draw(mean, spread, bounds, axes, knots[candidate])
                else:
                    knots[candidate] = best
                cost = _price(
                    state,
                    before,
                    knots[candidate],
                    command,
                    first,
                    span,
                    static,
                    kinetic,
                    bounds,
                    scratch,
                    elite_costs[worst],
                )
                if cost < elite_costs[worst]:
                    elite_costs[worst], elite[worst] = cost, candidate
                    worst = int(np.argmax(elite_costs))
            cheapest = np.argmin(elite_costs)
            if elite_costs[cheapest] < lowest:
                lowest = elite_costs[cheapest]
                best = knots[elite[cheapest]].copy()
            for knot in range(HORIZON):
                for axis in range(axes):
                    mean[knot, axis] = knots[elite, knot, axis].mean()
                    spread[knot, axis] = knots[elite, knot, axis].std()
        for knot in range(REPLAN):
            execute(state, best[knot], command, first + span * knot, span, static, kinetic, bounds, u)
        before[:] = best[REPLAN - 1]
        mean[: HORIZON - REPLAN] = best[REPLAN:]
        mean[HORIZON - REPLAN :] = best[HORIZON - 1]
        spread[: HORIZON - REPLAN] = WARM_SPREAD * strength
        spread[HORIZON - REPLAN :] = FRESH_SPREAD * strength

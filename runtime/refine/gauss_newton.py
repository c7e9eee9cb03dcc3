"""One Gauss-Newton step down the tracking error of a whole plan, in time proportional to its length.

Along a plan the law is linearized, sample by sample (`runtime.linearization`), and the squared tracking
error, with a penalty where the pan nears its reach, becomes a quadratic function of the changes of the acceleration:
a linear-quadratic problem, which one backward sweep solves. The changes are constant over blocks of BLOCK samples. The
sweep also says how each block's change is to answer to where the motion differs from the plan it was linearized
along, so that a stroke that turned out longer than foreseen is made up for by the next. See Tassa, Erez and Todorov,
"Synthesis and stabilization of complex behaviors through online trajectory optimization", IROS 2012.

Gradients alone take a thousand steps here for what ten of these do: what an early change does grows with the time that
is left, so that one step length fits no two samples.

These functions are plain Python over sequences of floats: lists as they are, arrays where numba compiles them. States
are 8 numbers a sample: pan x, y, vx, vy and object x, y, vx, vy (m, m/s).
"""

from __future__ import annotations

import math
from typing import Any

from runtime.physics.law import DT, slide_step
from runtime.physics.linearized import linearize

BLOCK = 5
"""Samples over which a change of the acceleration is constant."""

REACH_WEIGHT = 10.0
"""Of the squared excess beyond the soft reach at a sample, against the squared tracking error there."""

END_WEIGHT = 1000.0
"""The same for where the pan would come to rest if it braked at the end, which is a single sample."""

STATE = 8
SIZE = 10
"""Numbers in a state, and with the two of a block's change."""

ROW = 2 * STATE + 2
"""Numbers of a block in `gains`: what its change is by itself, then by each of the state's deviations, x before y."""

Column = Any
"""A sequence of floats that can be written to: a list, or an array where the functions are compiled."""


def move(
    u: Column, command: Column, state: Column, law: Any, within: Any, gains: Column, planned: Column, share: float,
    states: Column, out: Column,
) -> tuple[float, float, float]:  # fmt: skip
    """Move pan and object along accelerations changed by `gains`, within the limits on acceleration and jerk.

    Args:
        u: (2n,) accelerations (m/s^2).
        command: (2n,) where the object should be before each sample (m).
        state: (8,) at the start; afterwards, at the end.
        law: static and kinetic limit mu g, mu' g (m/s^2), soft reach (m), and `stopping`'s time for the ramps (s).
        within: largest acceleration and change of it from sample to sample, acceleration of the sample before (m/s^2).
        gains: from `sweep`, ROW numbers a block; zeros leave `u` as it is.
        planned: (8n,) the states that the gains were found along.
        share: of the change that is made (0 to 1).
        states: (8n,) filled with the states before each sample.
        out: (2n,) filled with the accelerations.

    Returns:
        Sum of the squared distances to the command (m^2), that with the penalties, largest distance of the pan (m).
    """
    static_limit, kinetic_limit, reach, ramps = law
    bound, change, last_x, last_y = within
    x, y, vx, vy, px, py, wx, wy = state
    squared = penalty = farthest = add_x = add_y = 0.0
    for k in range(len(u) // 2):
        first = STATE * k
        states[first], states[first + 1], states[first + 2], states[first + 3] = x, y, vx, vy
        states[first + 4], states[first + 5], states[first + 6], states[first + 7] = px, py, wx, wy
        squared += (px - command[2 * k]) ** 2 + (py - command[2 * k + 1]) ** 2
        distance = math.sqrt(x * x + y * y)
        farthest = max(farthest, distance)
        penalty += REACH_WEIGHT * max(distance - reach, 0.0) ** 2
        if k % BLOCK == 0:
            row = ROW * (k // BLOCK)
            add_x = share * gains[row]
            add_y = share * gains[row + 1]
            for j in range(STATE):
                deviation = states[first + j] - planned[first + j]
                add_x += gains[row + 2 + j] * deviation
                add_y += gains[row + 2 + STATE + j] * deviation
        last_x, last_y = follow_one(last_x, last_y, u[2 * k] + add_x, u[2 * k + 1] + add_y, bound, change)
        out[2 * k], out[2 * k + 1] = last_x, last_y
        px, py, wx, wy = slide_step(px, py, wx, wy, last_x, last_y, static_limit, kinetic_limit, DT)
        x += vx * DT + last_x * (0.5 * DT * DT)
        y += vy * DT + last_y * (0.5 * DT * DT)
        vx += last_x * DT
        vy += last_y * DT
    state[0], state[1], state[2], state[3], state[4], state[5], state[6], state[7] = x, y, vx, vy, px, py, wx, wy
    tau = stopping(vx, vy, bound, ramps)
    distance = math.sqrt((x + tau * vx) ** 2 + (y + tau * vy) ** 2)
    penalty += END_WEIGHT * max(distance - reach, 0.0) ** 2
    return squared, squared + penalty, max(farthest, math.sqrt(x * x + y * y))


def follow_one(last_x: float, last_y: float, ux: float, uy: float, bound: float, change: float) -> tuple[float, float]:
    """Return the acceleration nearest to u that is at most `bound`, and then at most `change` away from the last."""
    size = math.sqrt(ux * ux + uy * uy)
    if size > bound:
        ux *= bound / size
        uy *= bound / size
    size = math.sqrt((ux - last_x) ** 2 + (uy - last_y) ** 2)
    if size > change:
        ux = last_x + (ux - last_x) * change / size
        uy = last_y + (uy - last_y) * change / size
    return ux, uy


def stopping(vx: float, vy: float, bound: float, ramps: float) -> float:
    """Return the time (s) in which a pan would go as far at this velocity as it needs to come to rest."""
    return 0.5 * math.sqrt(vx * vx + vy * vy) / bound + ramps


def sweep(
    u: Column, command: Column, state: Column, law: Any, bound: float, states: Column, damping: float, gains: Column,
    s: Column, g: Column,
) -> None:  # fmt: skip
    """Fill `gains` with the change of each block that brings the quadratic model down to its least, and its answers.

    Going back in time, S (10, 10) and g (10,) are the model of all the cost from here on, as a function of the state's
    deviation and the block's change: d' S d / 2 + g' d. Each substitution is one line of the law.

    Args:
        u, command, state, law, bound, states: as `move` left them; `state` is the one at the end.
        damping: weight of the squared change (m^2 per (m/s^2)^2): the smaller, the longer the step.
        gains: (ROW per block,) filled.
        s, g: (100,) and (10,), for S and g.
    """
    static_limit, kinetic_limit, reach, ramps = law
    for i in range(SIZE * SIZE):
        s[i] = 0.0
    for i in range(SIZE):
        g[i] = 0.0
    tau = stopping(state[2], state[3], bound, ramps)
    price_reach(s, g, state[0] + tau * state[2], state[1] + tau * state[3], tau, reach, END_WEIGHT)
    half = 0.5 * DT
    for k in range(len(u) // 2 - 1, -1, -1):
        first = STATE * k
        before = 2 * max(k - 1, 0)
        fxx, fxy, fyy, hxx, hxy, hyy = linearize(
            states[first + 6], states[first + 7], u[2 * k], u[2 * k + 1], u[before], u[before + 1],
            static_limit, kinetic_limit, DT,
        )  # fmt: skip
        # p+ = p + (v + v+) dt/2 and v+ = F v + H u, for the object and, with F = 1 and H = dt, for the pan.
        for i in range(2):
            substitute(s, g, 4 + i, 6 + i, half)
            substitute(s, g, i, 2 + i, half)
        substitute(s, g, 6, 8, hxx)
        substitute(s, g, 7, 9, hyy)
        if hxy != 0.0:
            substitute(s, g, 6, 9, hxy)
            substitute(s, g, 7, 8, hxy)
        turn(s, g, fxx, fxy, fyy)
        for i in range(2):
            substitute(s, g, 4 + i, 6 + i, half)
            substitute(s, g, 2 + i, 8 + i, DT)
            substitute(s, g, i, 2 + i, half)
            s[(4 + i) * (SIZE + 1)] += 1.0
            g[4 + i] += states[first + 4 + i] - command[2 * k + i]
        price_reach(s, g, states[first], states[first + 1], 0.0, reach, REACH_WEIGHT)
        if k % BLOCK == 0:
            settle(s, g, damping, gains, ROW * (k // BLOCK))


def substitute(s: Column, g: Column, i: int, j: int, factor: float) -> None:
    """Put d_i + factor d_j in the place of d_i."""
    for r in range(SIZE):
        s[SIZE * r + j] += factor * s[SIZE * r + i]
    for r in range(SIZE):
        s[SIZE * j + r] += factor * s[SIZE * i + r]
    g[j] += factor * g[i]


def turn(s: Column, g: Column, fxx: float, fxy: float, fyy: float) -> None:
    """Put F v, with a symmetric F, in the place of the object's velocity v."""
    if fxx == 1.0 and fxy == 0.0 and fyy == 1.0:
        return
    for r in range(SIZE):
        a, b = s[SIZE * r + 6], s[SIZE * r + 7]
        s[SIZE * r + 6], s[SIZE * r + 7] = fxx * a + fxy * b, fxy * a + fyy * b
    for r in range(SIZE):
        a, b = s[SIZE * 6 + r], s[SIZE * 7 + r]
        s[SIZE * 6 + r], s[SIZE * 7 + r] = fxx * a + fxy * b, fxy * a + fyy * b
    g[6], g[7] = fxx * g[6] + fxy * g[7], fxy * g[6] + fyy * g[7]


def price_reach(s: Column, g: Column, x: float, y: float, tau: float, reach: float, weight: float) -> None:
    """Add weight (|p + tau v| - reach)^2 / 2 for the pan, where p + tau v = (x, y) is beyond `reach`."""
    distance = math.sqrt(x * x + y * y)
    if distance <= reach:
        return
    along = (x / distance, y / distance, tau * x / distance, tau * y / distance)
    for i in range(4):
        for j in range(4):
            s[SIZE * i + j] += weight * along[i] * along[j]
        g[i] += weight * (distance - reach) * along[i]


def settle(s: Column, g: Column, damping: float, gains: Column, row: int) -> None:
    """Choose the block's change: the least of the model, with `damping`; S and g become those without it."""
    a, b, d = s[88] + damping, s[89], s[99] + damping
    determinant = a * d - b * b
    a, b, d = d / determinant, -b / determinant, a / determinant
    gains[row] = -(a * g[8] + b * g[9])
    gains[row + 1] = -(b * g[8] + d * g[9])
    for j in range(STATE):
        gains[row + 2 + j] = -(a * s[80 + j] + b * s[90 + j])
        gains[row + 2 + STATE + j] = -(b * s[80 + j] + d * s[90 + j])
    for i in range(STATE):
        p, q = s[SIZE * i + 8], s[SIZE * i + 9]
        for j in range(STATE):
            s[SIZE * i + j] += p * gains[row + 2 + j] + q * gains[row + 2 + STATE + j]
        g[i] += p * gains[row] + q * gains[row + 1]
    for i in range(SIZE):
        s[SIZE * i + 8] = s[SIZE * i + 9] = s[80 + i] = s[90 + i] = 0.0
    g[8] = g[9] = 0.0


FUNCTIONS = (
    slide_step, linearize, follow_one, stopping, substitute, turn, price_reach, settle, move, sweep
)  # fmt: skip
"""In the order in which they call each other."""

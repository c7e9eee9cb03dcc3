"""One Gauss-Newton step down the tracking error of a whole plan, in time proportional to its length.

Along a plan the law is linearized, sample by sample (`runtime.physics.linearized`), and the squared tracking
error, with a penalty where the pan nears its reach, becomes a quadratic function of the changes of the acceleration:
a linear-quadratic problem, which one backward sweep solves. The changes are constant over blocks of BLOCK samples. The
sweep also says how each block's change is to answer to where the motion differs from the plan it was linearized
along, so that a stroke that turned out longer than foreseen is made up for by the next. See Tassa, Erez and Todorov,
"Synthesis and stabilization of complex behaviors through online trajectory optimization", IROS 2012.

Gradients alone take a thousand steps here for what ten of these do: what an early change does grows with the time that
is left, so that one step length fits no two samples.

One pan may move several objects at once, each under a friction of its own: what is not known about the friction. Then
the error is the weighted mean of theirs, and one motion of the pan has to serve them all.

These functions are plain Python over sequences of floats: lists as they are, arrays where numba compiles them. A state
is 4 + 4 n numbers for n objects: pan x, y, vx, vy, and of each object x, y, vx, vy (m, m/s).
"""

from __future__ import annotations

import math
from typing import Any

from runtime.physics.law import DT, slide_step
from runtime.physics.linearized import linearize
from runtime.physics.pan import pan_step

BLOCK = 5
"""Samples over which a change of the acceleration is constant."""

REACH_WEIGHT = 10.0
"""Of the squared excess beyond the soft reach at a sample, against the squared tracking error there."""

END_WEIGHT = 1000.0
"""The same for where the pan would come to rest if it braked at the end, which is a single sample."""

PAN = OBJECT = 4
"""Numbers in the state of the pan, and of an object."""

Column = Any
"""A sequence of floats that can be written to: a list, or an array where the functions are compiled."""


def state_size(objects: int) -> int:
    """Return how many numbers a state has."""
    return PAN + OBJECT * objects


def row_size(state: int) -> int:
    """Return how many numbers `gains` has for a block: its change by itself, and by each deviation, x before y."""
    return 2 * state + 2


def move(
    u: Column, command: Column, state: Column, friction: Column, weights: Column, law: Any, room: Column, before: Any,
    gains: Column, planned: Column, share: float, states: Column, out: Column,
) -> tuple[float, float, float]:  # fmt: skip
    """Move pan and objects along accelerations changed by `gains`, within the limits on acceleration and jerk.

    Args:
        u: (2K,) accelerations (m/s^2).
        command: (2K,) where the objects should be before each sample (m).
        state: (size,) at the start; afterwards, at the end.
        friction: (2n,) of each of n objects mu g and mu' g (m/s^2).
        weights: (n,) how much each counts; their sum is 1.
        law: soft reach (m), and of the stop after the last sample, its braking acceleration (m/s^2) and `stopping`'s
            time for the ramps (s).
        room: (3K,) of each sample: what presses the objects on the pan, over g, which is 1 for a level pan; the largest
            acceleration in the plane, and the largest change of it from the sample before (m/s^2).
        before: acceleration of the sample before the first (m/s^2).
        gains: from `sweep`, a row for each block; zeros leave `u` as it is.
        planned: (size K,) the states that the gains were found along.
        share: of the change that is made (0 to 1).
        states: (size K,) filled with the states before each sample.
        out: (2K,) filled with the accelerations.

    Returns:
        Sum of the squared distances to the command (m^2), on the weighted mean of the objects; that with the
        penalties; the largest distance of the pan (m).
    """
    reach, braking, ramps = law
    last_x, last_y = before
    size, objects = len(state), len(friction) // 2
    row_length = row_size(size)
    squared = penalty = farthest = add_x = add_y = 0.0
    for k in range(len(u) // 2):
        first = size * k
        for j in range(size):
            states[first + j] = state[j]
        x, y, vx, vy = state[0], state[1], state[2], state[3]
        distance = math.sqrt(x * x + y * y)
        farthest = max(farthest, distance)
        penalty += REACH_WEIGHT * max(distance - reach, 0.0) ** 2
        if k % BLOCK == 0:
            row = row_length * (k // BLOCK)
            add_x = share * gains[row]
            add_y = share * gains[row + 1]
            for j in range(size):
                deviation = state[j] - planned[first + j]
                add_x += gains[row + 2 + j] * deviation
                add_y += gains[row + 2 + size + j] * deviation
        last_x, last_y = follow_one(
            last_x, last_y, u[2 * k] + add_x, u[2 * k + 1] + add_y, room[3 * k + 1], room[3 * k + 2]
        )
        press = room[3 * k]
        out[2 * k], out[2 * k + 1] = last_x, last_y
        for n in range(objects):
            p = PAN + OBJECT * n
            error = (state[p] - command[2 * k]) ** 2 + (state[p + 1] - command[2 * k + 1]) ** 2
            squared += weights[n] * error
            state[p], state[p + 1], state[p + 2], state[p + 3] = slide_step(
                state[p], state[p + 1], state[p + 2], state[p + 3], last_x, last_y, friction[2 * n] * press,
                friction[2 * n + 1] * press, DT,
            )  # fmt: skip
        state[0], state[2] = pan_step(x, vx, last_x, DT)
        state[1], state[3] = pan_step(y, vy, last_y, DT)
    x, y, vx, vy = state[0], state[1], state[2], state[3]
    tau = stopping(vx, vy, braking, ramps)
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


def stopping(vx: float, vy: float, braking: float, ramps: float) -> float:
    """Return the time (s) in which a pan would go as far at this velocity as it needs to come to rest."""
    return 0.5 * math.sqrt(vx * vx + vy * vy) / braking + ramps


def sweep(
    u: Column, command: Column, state: Column, friction: Column, weights: Column, law: Any, room: Column,
    states: Column, damping: float, gains: Column, s: Column, g: Column,
) -> None:  # fmt: skip
    """Fill `gains` with the change of each block that brings the quadratic model down to its least, and its answers.

    Going back in time, S (size + 2, size + 2) and g (size + 2,) are the model of all the cost from here on, as a
    function of the state's deviation and the block's change: d' S d / 2 + g' d. Each substitution is one line of the
    law.

    Args:
        u, command, state, friction, weights, law, room, states: as `move` left them; `state` is the one at the end.
        damping: weight of the squared change (m^2 per (m/s^2)^2): the smaller, the longer the step.
        gains: (a row for each block,) filled.
        s, g: ((size + 2)^2,) and (size + 2,), for S and g.
    """
    reach, braking, ramps = law
    size, objects = len(state), len(friction) // 2
    order, ux, uy = size + 2, size, size + 1
    for i in range(order * order):
        s[i] = 0.0
    for i in range(order):
        g[i] = 0.0
    tau = stopping(state[2], state[3], braking, ramps)
    price_reach(s, g, order, state[0] + tau * state[2], state[1] + tau * state[3], tau, reach, END_WEIGHT)
    half = 0.5 * DT
    for k in range(len(u) // 2 - 1, -1, -1):
        first = size * k
        before, press = 2 * max(k - 1, 0), room[3 * k]
        # p+ = p + (v + v+) dt/2 and v+ = F v + H u, for each object and, with F = 1 and H = dt, for the pan.
        for n in range(objects):
            p = PAN + OBJECT * n
            v = p + 2
            fxx, fxy, fyy, hxx, hxy, hyy = linearize(
                states[first + v], states[first + v + 1], u[2 * k], u[2 * k + 1], u[before], u[before + 1],
                friction[2 * n] * press, friction[2 * n + 1] * press, DT,
            )  # fmt: skip
            substitute(s, g, order, p, v, half)
            substitute(s, g, order, p + 1, v + 1, half)
            substitute(s, g, order, v, ux, hxx)
            substitute(s, g, order, v + 1, uy, hyy)
            if hxy != 0.0:
                substitute(s, g, order, v, uy, hxy)
                substitute(s, g, order, v + 1, ux, hxy)
            turn(s, g, order, v, fxx, fxy, fyy)
            for i in range(2):
                substitute(s, g, order, p + i, v + i, half)
                s[(p + i) * (order + 1)] += weights[n]
                g[p + i] += weights[n] * (states[first + p + i] - command[2 * k + i])
        for i in range(2):
            substitute(s, g, order, i, 2 + i, half)
            substitute(s, g, order, 2 + i, ux + i, DT)
            substitute(s, g, order, i, 2 + i, half)
        price_reach(s, g, order, states[first], states[first + 1], 0.0, reach, REACH_WEIGHT)
        if k % BLOCK == 0:
            solve_block(s, g, order, damping, gains, row_size(size) * (k // BLOCK))


def substitute(s: Column, g: Column, order: int, i: int, j: int, factor: float) -> None:
    """Put d_i + factor d_j in the place of d_i."""
    if factor == 0.0:
        return
    for r in range(order):
        s[order * r + j] += factor * s[order * r + i]
    for r in range(order):
        s[order * j + r] += factor * s[order * i + r]
    g[j] += factor * g[i]


def turn(s: Column, g: Column, order: int, v: int, fxx: float, fxy: float, fyy: float) -> None:
    """Put F v, with a symmetric F, in the place of an object's velocity, d_v and d_(v + 1)."""
    if fxx == 1.0 and fxy == 0.0 and fyy == 1.0:
        return
    for r in range(order):
        a, b = s[order * r + v], s[order * r + v + 1]
        s[order * r + v], s[order * r + v + 1] = fxx * a + fxy * b, fxy * a + fyy * b
    for r in range(order):
        a, b = s[order * v + r], s[order * (v + 1) + r]
        s[order * v + r], s[order * (v + 1) + r] = fxx * a + fxy * b, fxy * a + fyy * b
    g[v], g[v + 1] = fxx * g[v] + fxy * g[v + 1], fxy * g[v] + fyy * g[v + 1]


def price_reach(s: Column, g: Column, order: int, x: float, y: float, tau: float, reach: float, weight: float) -> None:
    """Add weight (|p + tau v| - reach)^2 / 2 for the pan, where p + tau v = (x, y) is beyond `reach`."""
    distance = math.sqrt(x * x + y * y)
    if distance <= reach:
        return
    along = (x / distance, y / distance, tau * x / distance, tau * y / distance)
    for i in range(4):
        for j in range(4):
            s[order * i + j] += weight * along[i] * along[j]
        g[i] += weight * (distance - reach) * along[i]


def solve_block(s: Column, g: Column, order: int, damping: float, gains: Column, row: int) -> None:
    """Choose the block's change: the least of the model, with `damping`; S and g become those without it."""
    size = order - 2
    x, y = order * size, order * (size + 1)
    a, b, d = s[x + size] + damping, s[x + size + 1], s[y + size + 1] + damping
    determinant = a * d - b * b
    a, b, d = d / determinant, -b / determinant, a / determinant
    gains[row] = -(a * g[size] + b * g[size + 1])
    gains[row + 1] = -(b * g[size] + d * g[size + 1])
    for j in range(size):
        gains[row + 2 + j] = -(a * s[x + j] + b * s[y + j])
        gains[row + 2 + size + j] = -(b * s[x + j] + d * s[y + j])
    for i in range(size):
        p, q = s[order * i + size], s[order * i + size + 1]
        for j in range(size):
            s[order * i + j] += p * gains[row + 2 + j] + q * gains[row + 2 + size + j]
        g[i] += p * gains[row] + q * gains[row + 1]
    for i in range(order):
        s[order * i + size] = s[order * i + size + 1] = s[x + i] = s[y + i] = 0.0
    g[size] = g[size + 1] = 0.0


FUNCTIONS = (
    slide_step, pan_step, linearize, row_size, follow_one, stopping, substitute, turn, price_reach, solve_block, move,
    sweep,
)  # fmt: skip
"""In the order in which they call each other."""

"""The governor: what the pan is let do of what the network asks for, so that the limits hold at every sample.

It stands inside the decode loop, chunk by chunk, and rests on one fact: for a pan in a given state, the motions that
keep the limits and then come to rest form a convex set, because the pan is linear and each limit is a convex set: balls
for acceleration, jerk and speed, a disc for the reach, a slab for the height, and a half space for LARGEST_SINK, by
which the pan may accelerate downwards. The governor always holds one member of that set, the stop from where the pan
is. Of a chunk

1.  the accelerations are shortened to the limit and to LARGEST_SINK, and follow no faster than the jerk allows; a level
    pan's have no part upwards;
2.  if the pan then keeps its reach, height and speed, and a stop that keeps them leads on from the chunk's end, that is
    the chunk. What keeps the limits by itself is not changed in a single bit;
3.  otherwise the chunk is the point on the line from the stop to it, nearest to what was asked for, from whose end a
    stop within the limits leads on. The stop itself is such a point, so there always is one;
4.  or the stop's beginning and then what was asked for, if that keeps the limits, leads to a stop that does, and is
    nearer: a pan that would leave its reach by a hair, and come back, is not held back for all of a chunk.

So whatever is asked for, the pan can come to rest within its limits from every sample: along the chunk and its stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.limits import LARGEST_SINK, Limits
from runtime.physics.compiled import compiler
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.safety.free import FreeChunks, Pans
from runtime.safety.pan import Pan, state_after
from runtime.safety.stop import PanState

BISECTIONS = 6
"""Halvings of the line between the stop and what was asked for: to within 1/64 of the way."""

DETOURS = (5, 10, 20, 40)
"""Numbers of samples of the stop that are tried before what was asked for."""


def govern(pans: Sequence[Pan], asked: FloatArray) -> tuple[FloatArray, FloatArray, Sequence[Pan]]:
    """Let B pans do what is asked for as far as their limits allow; see the module for the steps.

    Args:
        pans: before the chunk.
        asked: (B, C, 3) accelerations (m/s^2), finite.

    Returns:
        (B, C, 3) accelerations within the limits (m/s^2), (B, C, 6) pan position (m) and velocity (m/s) after each
        sample, and the pans after the chunk.
    """
    free_chunks = _free_chunks  # which another thread may replace
    if free_chunks is None:
        return govern_each(pans, np.array([pan.state for pan in pans]), [pan.limits for pan in pans], asked)
    moving = Pans(pans)
    others, states = free_chunks.find(moving, asked)
    if others:
        u = asked.copy()
        govern_others(moving, u, states)
    else:
        u = asked
        moving.held.clear()
    return u, states, [moving[row] for row in range(len(moving))]


def govern_others(pans: Pans, u: FloatArray, states: FloatArray) -> list[int]:
    """Govern the chunks that are not free, after `keep_limits` has looked at all.

    Args:
        pans: those whose chunks are free are at their ends, where the others go now.
        u: (B, C, 3) accelerations that are asked for (m/s^2); those of the others are changed in place.
        states: (B, C, 6) where they lead; as `u`.

    Returns:
        The rows of the others.
    """
    rows = np.flatnonzero(~pans.free).tolist()
    limits = [pans.limits[row] for row in rows]
    kept, led, after = govern_each([pans[row] for row in rows], pans.states[rows], limits, u[rows])
    u[rows], states[rows], pans.states[rows] = kept, led, [pan.state for pan in after]
    pans.held = dict(zip(rows, after, strict=True))
    return rows


def run_compiled(use: bool) -> None:
    """Let numba find the chunks that need no change from now on, in all of this process, or no longer."""
    global _free_chunks
    compile_one = compiler() if use else None
    _free_chunks = None if compile_one is None else FreeChunks(compile_one)


_free_chunks: FreeChunks | None = None


def compiled_governor() -> FreeChunks | None:
    """Return what numba runs of the governor, None where it runs nothing."""
    return _free_chunks


def govern_each(
    pans: Sequence[Pan], before: FloatArray, limits: Sequence[Limits], asked: FloatArray
) -> tuple[FloatArray, FloatArray, list[Pan]]:
    """Do what `govern` does, in plain numpy; `before` are the pans' states (B, 9), `limits` theirs."""
    u = follow(before[:, 6:], _level(asked, pans), limits)
    states = integrate_pan(before[:, :6], u)
    farthest = np.sqrt(_squares(states[..., :2]).max(axis=1)).tolist()
    ends = np.concatenate([states[:, -1], u[:, -1]], axis=1).tolist()
    after = []
    for row, (pan, reach, end) in enumerate(zip(pans, farthest, ends, strict=True)):
        if pan.limits.finite:
            ahead = Pan.at(PanState(*end), pan.limits)
            if not (reach <= pan.limits.pan_reach and _in_space(states[row], pan.limits) and ahead.can_stop):
                if u is asked:
                    u = asked.copy()
                u[row], states[row], ahead = _hold_back(pan, u[row], states[row])
        else:
            ahead = pan._replace(state=PanState(*end))
        after.append(ahead)
    return u, states, after


def _level(asked: FloatArray, pans: Sequence[Pan]) -> FloatArray:
    """Return what is asked for, (B, C, 3), without its part upwards where a pan is level."""
    if not asked[..., 2].any():
        return asked
    rows = [row for row, pan in enumerate(pans) if pan.limits.level]
    if not rows:
        return asked
    asked = asked.copy()
    asked[rows, :, 2] = 0.0
    return asked


def _in_space(states: FloatArray, limits: Limits) -> bool:
    """Whether a pan's states (C, 6) keep the limits on height and speed."""
    return (limits.level or bool(np.abs(states[:, 2]).max() <= limits.height)) and (
        math.isinf(limits.speed) or bool(_squares(states[:, 3:]).max() <= limits.speed * limits.speed)
    )


def follow(last: FloatArray, asked: FloatArray, limits: Sequence[Limits]) -> FloatArray:
    """Shorten accelerations to the limit and to LARGEST_SINK, and follow them no faster than the jerk allows.

    Args:
        last: (B, 3) acceleration of the sample before (m/s^2).
        asked: (B, C, 3) (m/s^2).
        limits: of each pan.

    Returns:
        (B, C, 3) accelerations (m/s^2): `asked` itself if it keeps the limits, otherwise a copy that differs where
        it did not, and until it has caught up.
    """
    step = asked - np.concatenate([last[:, None], asked[:, :-1]], axis=1)
    largest = np.array([(each.acceleration, each.jerk * DT, _sink(each)) for each in limits])[:, :, None]
    wrong = (
        (_squares(asked) > largest[:, 0] * largest[:, 0])
        | (_squares(step) > largest[:, 1] * largest[:, 1])
        | (asked[..., 2] < -largest[:, 2])
    )
    if not wrong.any():
        return asked
    u = asked.copy()
    for row in np.flatnonzero(wrong.any(axis=1)).tolist():
        _follow_one(last[row], u[row], np.flatnonzero(wrong[row]).tolist(), limits[row])
    return u


def _sink(limits: Limits) -> float:
    return LARGEST_SINK if limits.finite else math.inf


def _follow_one(last: FloatArray, u: FloatArray, wrong: Sequence[int], limits: Limits) -> None:
    """Correct one chunk `u` (C, 3) in place, from each of the samples `wrong` to where it has caught up."""
    bound, step, sink = limits.acceleration, limits.jerk * DT, _sink(limits)
    asked = u.tolist()
    caught_up = 0
    for first in wrong:
        if first < caught_up:
            continue
        hx, hy, hz = asked[first - 1] if first else last.tolist()
        for k in range(first, len(asked)):
            caught_up = k + 1
            x, y, z = asked[k]
            size = (x * x + y * y + z * z) ** 0.5
            if size > bound:
                x, y, z = x * bound / size, y * bound / size, z * bound / size
            sinks = z < -sink
            if sinks:
                z = -sink
            dx, dy, dz = x - hx, y - hy, z - hz
            change = (dx * dx + dy * dy + dz * dz) ** 0.5
            if change > step:
                hx, hy, hz = hx + dx * step / change, hy + dy * step / change, hz + dz * step / change
            elif size > bound or sinks:
                hx, hy, hz = x, y, z
            else:
                break
            u[k] = asked[k] = [hx, hy, hz]


def _hold_back(pan: Pan, u: FloatArray, states: FloatArray) -> tuple[FloatArray, FloatArray, Pan]:
    """Return what is nearest to the chunk `u` (C, 3) of what a stop within the limits leads on from.

    Args:
        pan: before the chunk.
        u: accelerations within their limits, jerk included (m/s^2).
        states: (C, 6) where they lead.

    Returns:
        Accelerations, pan states and the pan at the end, as `govern` does.
    """
    count, limits, start = len(u), pan.limits, np.array(pan.state[:6])
    stop = pan.brake.accelerations(count)
    stop_states = integrate_pan(start, stop)
    share = largest = _share_within(stop_states, states, limits)
    end, stop_end = np.concatenate([states[-1], u[-1]]), np.concatenate([stop_states[-1], stop[-1]])
    smallest, brake = 0.0, None
    for _ in range(BISECTIONS + 1):
        ahead = Pan.at(PanState(*(stop_end + share * (end - stop_end)).tolist()), limits)
        if ahead.can_stop:
            smallest, brake = share, ahead.brake
            if share == largest:
                break
        else:
            largest = share
        share = 0.5 * (smallest + largest)
    if brake is None:
        held, held_states = stop, stop_states
        after = pan.braked(count, stop_states, stop)
    else:
        held = stop + smallest * (u - stop)
        held_states = integrate_pan(start, held)
        after = Pan(state_after(held_states, held), brake, limits)
    return _nearest(pan, u, (held, held_states, after))


def _nearest(pan: Pan, u: FloatArray, held: tuple[FloatArray, FloatArray, Pan]) -> tuple[FloatArray, FloatArray, Pan]:
    """Return the shortest detour that keeps the limits if it is nearer to the chunk `u` (C, 3) than `held` is."""
    limits, farthest = pan.limits, float(_squares(held[0] - u).sum())
    for samples in DETOURS:
        if samples >= len(u):
            break
        path = np.concatenate([pan.brake.accelerations(samples), u[samples:]])
        detour = follow(np.array([pan.state[6:]]), path[None], [limits])[0]
        if not _squares(detour - u).sum() < farthest:
            break
        states = integrate_pan(np.array(pan.state[:6]), detour)
        reached = _squares(states[:, :2]).max() <= limits.pan_reach * limits.pan_reach
        if not (reached and _in_space(states, limits)):
            continue
        after = Pan.at(state_after(states, detour), limits)
        if after.can_stop:
            return detour, states, after
    return held


def _share_within(stop: FloatArray, there: FloatArray, limits: Limits) -> float:
    """Return the largest share of the way from states `stop` to `there`, (C, 6), that is within the limits throughout.

    Those on reach, height and speed: each is a ball, the height's in one dimension.
    """
    share = _share_in_ball(stop[:, :2], there[:, :2], limits.pan_reach)
    if not limits.level:
        share = min(share, _share_in_ball(stop[:, 2:3], there[:, 2:3], limits.height))
    if math.isfinite(limits.speed):
        share = min(share, _share_in_ball(stop[:, 3:], there[:, 3:], limits.speed))
    return share


def _share_in_ball(stop: FloatArray, there: FloatArray, radius: float) -> float:
    """Return the largest share of the way from points `stop` to `there`, (C, d), that is in the ball throughout.

    |p + share d|^2 <= radius^2 is a quadratic inequality in the share, at each sample; the smallest root decides.
    """
    d = there - stop
    a = _squares(d)
    b = _products(stop, d)
    c = np.minimum(_squares(stop) - radius * radius, 0.0)  # the stop is in the ball, whatever rounding says
    roots = np.divide(np.sqrt(b * b - a * c) - b, a, out=np.ones_like(a), where=a > 0.0)
    return float(np.clip(roots.min(), 0.0, 1.0))


def _squares(vectors: FloatArray) -> FloatArray:
    """Return the squared lengths (...) of vectors (..., d)."""
    return _products(vectors, vectors)


def _products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the inner products (...) of vectors (..., d)."""
    total: FloatArray = first[..., 0] * second[..., 0]
    for axis in range(1, first.shape[-1]):
        total = total + first[..., axis] * second[..., axis]
    return total

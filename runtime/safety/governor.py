"""The governor: what the pan is let do of what the network asks for, so that the limits hold at every sample.

It stands inside the decode loop, chunk by chunk, and rests on one fact: for a pan in a given state, the motions that
keep the limits on reach, acceleration and jerk and then come to rest form a convex set, because the pan is linear and
each limit is a ball. The governor always holds one member of that set, the stop from where the pan is. Of a chunk

1.  the accelerations are shortened to the limit, and follow no faster than the jerk allows;
2.  if the pan then stays in reach, and a stop in reach leads on from the chunk's end, that is the chunk. What keeps
    the limits by itself is not changed in a single bit;
3.  otherwise the chunk is the point on the line from the stop to it, nearest to what was asked for, from whose end a
    stop in reach leads on. The stop itself is such a point, so there always is one;
4.  or the stop's beginning and then what was asked for, if that keeps the limits, leads to a stop in reach, and is
    nearer: a pan that would leave its reach by a hair, and come back, is not held back for all of a chunk.

So whatever is asked for, the pan can come to rest in its reach from every sample: along the chunk and its stop.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.safety.pan import Motion
from runtime.safety.stop import PanState, find_brake, stop_reach

BISECTIONS = 6
"""Halvings of the line between the stop and what was asked for: to within 1/64 of the way."""

DETOURS = (5, 10, 20, 40)
"""Numbers of samples of the stop that are tried before what was asked for."""


class Governed(NamedTuple):
    """What the governor made of a chunk of B pans.

    Attributes:
        acceleration: (B, C, 2) (m/s^2), within the limits.
        pan: (B, C, 4) pan position (m) and velocity (m/s) after each sample.
        motions: the pans at the chunk's end.
    """

    acceleration: FloatArray
    pan: FloatArray
    motions: list[Motion]


def govern(motions: Sequence[Motion], asked: FloatArray) -> Governed:
    """Let B pans do what is asked for as far as their limits allow; see the module for the steps.

    Args:
        motions: the pans before the chunk.
        asked: (B, C, 2) accelerations (m/s^2), finite.
    """
    before = np.array([motion.state for motion in motions])
    u = follow(before[:, 4:], asked, [motion.limits for motion in motions])
    pan = integrate_pan(before[:, :4], u)
    farthest = np.sqrt(_squares(pan[..., :2]).max(axis=1)).tolist()
    ends = np.concatenate([pan[:, -1], u[:, -1]], axis=1).tolist()
    after = []
    for row, (motion, reach, end) in enumerate(zip(motions, farthest, ends, strict=True)):
        ahead = Motion(PanState(*end), motion.brake, motion.limits)
        if motion.limits.finite:
            brake = find_brake(ahead.state, motion.limits)
            ahead = ahead._replace(brake=brake)
            if max(reach, stop_reach(ahead.state, brake)) > motion.limits.pan_reach:
                if u is asked:
                    u = asked.copy()
                u[row], pan[row], ahead = _hold_back(motion, u[row], pan[row])
        after.append(ahead)
    return Governed(u, pan, after)


def follow(last: FloatArray, asked: FloatArray, limits: Sequence[Limits]) -> FloatArray:
    """Shorten accelerations to the limit, and follow them no faster than the jerk allows.

    Args:
        last: (B, 2) acceleration of the sample before (m/s^2).
        asked: (B, C, 2) (m/s^2).
        limits: of each pan.

    Returns:
        (B, C, 2) accelerations (m/s^2): `asked` itself if it keeps the limits, otherwise a copy that differs where
        it did not, and until it has caught up.
    """
    step = asked - np.concatenate([last[:, None], asked[:, :-1]], axis=1)
    largest = np.array([(each.acceleration, each.jerk * DT) for each in limits])[:, :, None]
    wrong = (_squares(asked) > largest[:, 0] * largest[:, 0]) | (_squares(step) > largest[:, 1] * largest[:, 1])
    if not wrong.any():
        return asked
    u = asked.copy()
    for row in np.flatnonzero(wrong.any(axis=1)).tolist():
        _follow_one(last[row], u[row], np.flatnonzero(wrong[row]).tolist(), limits[row])
    return u


def _follow_one(last: FloatArray, u: FloatArray, wrong: Sequence[int], limits: Limits) -> None:
    """Correct one chunk `u` (C, 2) in place, from each of the samples `wrong` to where it has caught up."""
    bound, step = limits.acceleration, limits.jerk * DT
    asked = u.tolist()
    caught_up = 0
    for first in wrong:
        if first < caught_up:
            continue
        hx, hy = asked[first - 1] if first else last.tolist()
        for k in range(first, len(asked)):
            caught_up = k + 1
            x, y = asked[k]
            size = (x * x + y * y) ** 0.5
            if size > bound:
                x, y = x * bound / size, y * bound / size
            dx, dy = x - hx, y - hy
            change = (dx * dx + dy * dy) ** 0.5
            if change > step:
                hx, hy = hx + dx * step / change, hy + dy * step / change
            elif size > bound:
                hx, hy = x, y
            else:
                break
            u[k] = asked[k] = hx, hy


def _hold_back(motion: Motion, u: FloatArray, pan: FloatArray) -> tuple[FloatArray, FloatArray, Motion]:
    """Return what is nearest to the chunk `u` (C, 2) of what a stop in reach leads on from.

    Args:
        motion: the pan before the chunk.
        u: accelerations within their limits, jerk included (m/s^2).
        pan: (C, 4) where they lead.

    Returns:
        Accelerations, pan states and the pan at the end, as in `Governed`.
    """
    count, limits = len(u), motion.limits
    stop = motion.brake.accelerations(count)
    stop_pan = integrate_pan(np.array(motion.state[:4]), stop)
    share = largest = _share_in_reach(stop_pan[:, :2], pan[:, :2], limits.pan_reach)
    end, stop_end = np.concatenate([pan[-1], u[-1]]), np.concatenate([stop_pan[-1], stop[-1]])
    smallest, found = 0.0, None
    for _ in range(BISECTIONS + 1):
        state = PanState(*(stop_end + share * (end - stop_end)).tolist())
        brake = find_brake(state, limits)
        if stop_reach(state, brake) <= limits.pan_reach:
            smallest, found = share, brake
            if share == largest:
                break
        else:
            largest = share
        share = 0.5 * (smallest + largest)
    if found is None:
        held, held_pan = stop, stop_pan
        found = motion.brake._replace(done=motion.brake.done + min(count, motion.brake.samples))
    else:
        held = stop + smallest * (u - stop)
        held_pan = integrate_pan(np.array(motion.state[:4]), held)
    after = PanState(*held_pan[-1].tolist(), *held[-1].tolist())
    return _nearest(motion, u, (held, held_pan, Motion(after, found, limits)))


def _nearest(
    motion: Motion, u: FloatArray, held: tuple[FloatArray, FloatArray, Motion]
) -> tuple[FloatArray, FloatArray, Motion]:
    """Return the shortest detour that keeps the limits if it is nearer to the chunk `u` (C, 2) than `held` is."""
    limits, farthest = motion.limits, float(_squares(held[0] - u).sum())
    for samples in DETOURS:
        if samples >= len(u):
            break
        path = np.concatenate([motion.brake.accelerations(samples), u[samples:]])
        detour = follow(np.array([motion.state[4:]]), path[None], [limits])[0]
        if not _squares(detour - u).sum() < farthest:
            break
        pan = integrate_pan(np.array(motion.state[:4]), detour)
        if _squares(pan[:, :2]).max() > limits.pan_reach * limits.pan_reach:
            continue
        end = PanState(*pan[-1].tolist(), *detour[-1].tolist())
        brake = find_brake(end, limits)
        if stop_reach(end, brake) <= limits.pan_reach:
            return detour, pan, Motion(end, brake, limits)
    return held


def _share_in_reach(stop: FloatArray, there: FloatArray, reach: float) -> float:
    """Return the largest share of the way from the positions `stop` to `there`, (C, 2), that is in reach throughout.

    |p + share d|^2 <= reach^2 is a quadratic inequality in the share, at each sample; the smallest root decides.
    """
    d = there - stop
    a = _squares(d)
    b = stop[:, 0] * d[:, 0] + stop[:, 1] * d[:, 1]
    c = np.minimum(_squares(stop) - reach * reach, 0.0)  # the stop is in reach, whatever rounding says
    roots = np.divide(np.sqrt(b * b - a * c) - b, a, out=np.ones_like(a), where=a > 0.0)
    return float(np.clip(roots.min(), 0.0, 1.0))


def _squares(vectors: FloatArray) -> FloatArray:
    """Return the squared lengths (...) of vectors (..., 2)."""
    return vectors[..., 0] * vectors[..., 0] + vectors[..., 1] * vectors[..., 1]

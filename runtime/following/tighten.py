"""The next chunk of a pan that an arm carries: where joints would pass a limit, the pan's own are tightened for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.following.chunk import next_chunk
from runtime.following.course import Course
from runtime.following.end import End
from runtime.following.state import StreamState
from runtime.limits import Limits
from runtime.physics.law import DT
from runtime.safety.stop import PanState

Check = Callable[[PanState, FloatArray], Mapping[str, float]]
"""Tells what the arm comes to along a motion of the pan: from a state on by (n, 3) accelerations (m/s^2), all of it
commanded. For "speed", "acceleration" and "jerk", each of which is less where the pan's is, how many times as much as
it may; 1 or less holds."""

TRIES = 8
"""Most chunks that are tried; the last resort is the one that comes closest."""

SPARE = 0.97
"""Share of a limit that is aimed at."""

LEAST = 0.1
"""Share of the pan's own limits below which they are not tightened."""


def checked_chunk(
    last: StreamState, course: Course, end: End, limits: Limits, samples: int, late: int | None, check: Check
) -> tuple[StreamState, Course]:
    """Return what `next_chunk` does, within limits of this one chunk under which the check holds.

    A chunk is checked with the stop that leads on from it: so the next one can fall back on what holds already.
    Whatever is tried keeps the pan's own limits.
    """
    tight, here = limits, PanState(*(*last.commanded.tolist(), *last.after.state[6:]))
    best, least = None, math.inf
    for _ in range(TRIES):
        state, followed = next_chunk(last, course, end, limits, samples, late, tight)
        state = state.within(state.room.limits)
        brake = state.after.brake
        motion = np.concatenate([state.motion.acceleration, brake.accelerations(brake.samples)])
        taken = check(here, motion)
        worst = max(taken.values())
        if best is None or worst < least:
            best, least = (state, followed), worst
        if worst <= 1.0:
            break
        tight = _tightened(tight, limits, state.before.state, motion, taken)
    assert best is not None
    return best


def _tightened(tight: Limits, limits: Limits, before: PanState, u: FloatArray, taken: Mapping[str, float]) -> Limits:
    """Return limits smaller by what is taken too much, than those tried and than what the pan came to.

    Args:
        tight: what was tried.
        limits: the pan's own.
        before: the pan before the chunk.
        u: (n, 3) what that gave (m/s^2).
        taken: what the check says of it.
    """
    velocity = np.array(before[3:6]) + DT * np.cumsum(u, axis=0)
    steps = np.diff(u, axis=0, prepend=np.array([before[6:]])) / DT
    least = {
        "speed": math.hypot(*before[3:6]),  # a pan that is faster already is not braked as hard as it may be
        "acceleration": LEAST * limits.acceleration,
        "jerk": LEAST * limits.jerk,
    }
    new = {}
    for name, rows in (("speed", velocity), ("acceleration", u), ("jerk", steps)):
        share = taken.get(name, 0.0)
        if share > 1.0:
            came_to = float(np.linalg.norm(rows, axis=1).max())
            new[name] = max(min(getattr(tight, name), came_to) * SPARE / share, least[name])
    return replace(tight, **new)

"""How a motion ends: the stop that leaves the object where it should be, as far as there is one."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.motion import Motion
from runtime.physics.positions import slide_to_rest
from runtime.safety.pan import Pan
from runtime.safety.stop import Brake, PanState, find_brake, gentle_strength, stop_extent, strongest

STRONGER = 1.4
"""Times that each stop tried is stronger than the one before, at most."""

MOST_STRONGER = 30.0
"""Times that a stop is tried in steps of STRONGER beyond the first that does not hold back a sliding object; after
them comes the strongest."""

KEPT = 5e-4
"""Distance (m) that the object may be moved by a stop, and counts as kept where it was."""

LONGEST_STOP = 0.6
"""Time (s) that a stop may take for gentleness, where the limits allow a shorter one."""

ORDINARY = Limits()
"""How a pan without limits brakes, wherever that leads it."""


def stop_after(motion: Motion, samples: int, ahead: Pan, mark: FloatArray, friction: Friction) -> FloatArray:
    """Return the stop that follows the first samples of a motion.

    It keeps the limits, and begins at once; where the pan could not stop within them then, it follows the motion until
    it can, at the latest by the stop that the governor kept for the motion's end.

    Args:
        motion: of pan and object.
        samples: after which the stop follows; at least 1, at most all.
        ahead: the pan at the motion's end.
        mark: (2,) where the object should come to rest, relative to the pan's centre (m).
        friction: what the object is predicted with.

    Returns:
        (n, 3) pan accelerations (m/s^2), n at least 1; the last is zero, and the pan is at rest after it.
    """
    u = motion.acceleration
    for k in range(samples, len(u) + 1):
        state = PanState(*motion.pan[k].tolist(), *u[k - 1].tolist())
        brake = kindest_stop(state, motion.sliding[k], mark, ahead.limits, friction)
        if brake is not None:
            return np.concatenate([u[samples:k], brake.accelerations(brake.samples)])
    return np.concatenate([u[samples:], ahead.brake.accelerations(max(1, ahead.brake.samples))])


def kindest_stop(
    state: PanState, sliding: FloatArray, mark: FloatArray, limits: Limits, friction: Friction
) -> Brake | None:
    """Return the stop within the limits that by the law leaves the object nearest to its mark; None if there is none.

    Of several strengths the gentlest comes first: one that holds back an object that slides, one that does not break
    away an object that rests, and on to the strongest. A stronger one must gain more than KEPT.

    Args:
        state: the pan.
        sliding: (4,) the object relative to the pan (m, m/s).
        mark: (2,) where it should come to rest (m).
        limits: where there are none, the pan is stopped as by ORDINARY ones, anywhere.
        friction: coefficients.
    """
    limits, anywhere = (limits, False) if limits.finite else (ORDINARY, True)
    best, least = None, math.inf
    good = math.dist(sliding[:2], mark) + KEPT
    for strength in _strengths(state, limits, friction):
        brake = find_brake(state, limits, strength)
        if not (anywhere or stop_extent(state, brake).within(limits)):
            continue
        left = math.dist(slide_to_rest(sliding, brake.accelerations(brake.samples), friction), mark)
        if left <= good:
            return brake
        if left < least - KEPT:
            best, least = brake, left
    return best


def _strengths(state: PanState, limits: Limits, friction: Friction) -> Iterator[float]:
    """Yield braking accelerations (m/s^2) from the gentlest to the strongest; the first is often enough."""
    most = strongest(state, limits.acceleration, limits.jerk)
    least = min(most, math.hypot(*state[3:6]) / LONGEST_STOP)
    holding, carrying = (gentle_strength(coefficient, limits) for coefficient in (friction.kinetic, friction.static))
    gentlest = min(max(holding, least), most)
    if gentlest > 0.0:
        yield gentlest
    first = min(max(carrying, least), most)
    last = min(most, first * MOST_STRONGER)
    more = np.geomspace(first, last, 1 + math.ceil(math.log(last / first) / math.log(STRONGER))).tolist()
    stronger = {min(max(strength, least), most) for strength in (*more, most)} - {gentlest}
    yield from sorted(strength for strength in stronger if strength > 0.0)

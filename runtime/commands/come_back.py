"""The move that brings an object back to its mark."""

from __future__ import annotations

import math

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY

SHARE = 0.7
"""Share of kinetic friction's mu' g that the object is accelerated by at most: what the pan can make of it."""

SPEED = 0.6
"""Highest speed of the object on its way (m/s)."""

DURATIONS = (0.3, 2.0)
"""Shortest and longest time on the way (s)."""

PEAK_ACCELERATION, PEAK_SPEED = 10.0 / math.sqrt(3.0), 15.0 / 8.0
"""Of the minimum-jerk move over length 1 in time 1."""


def come_back(position: FloatArray, mark: FloatArray, friction: Friction) -> FloatArray:
    """Return the positions (K, 2) of a minimum-jerk move from where an object is to its mark, both (2,) (m)."""
    distance, most = math.dist(position, mark), SHARE * friction.kinetic * GRAVITY
    needed = max(
        PEAK_SPEED * distance / SPEED, math.sqrt(PEAK_ACCELERATION * distance / most) if most > 0.0 else math.inf
    )
    duration = min(max(needed, DURATIONS[0]), DURATIONS[1])
    x = np.linspace(0.0, 1.0, math.ceil(duration / DT))[:, None]
    move: FloatArray = position + x**3 * (10.0 - 15.0 * x + 6.0 * x * x) * (mark - position)
    return move

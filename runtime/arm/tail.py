"""How a run on the arm ends: the pan brakes so that the object stays on it."""

from __future__ import annotations

import numpy as np

from runtime.arm.geometry import OBJECT_RADIUS, PAN_RADIUS
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.pan import integrate_pan

BRAKES = (1.5, 2.5, 4.0, 6.0, 9.0, 13.0, 18.0)
"""Peak decelerations tried for the tail (m/s^2)."""

TAIL_REACH = 0.3
"""Distance from where the pan began within which the tail should stop it (m); the arm reaches half a metre."""

SAFE_RADIUS = PAN_RADIUS - OBJECT_RADIUS - 0.01
"""Distance from the pan's centre within which the object touches no rim, and a centimetre less (m)."""

MAX_DROP = 0.8 * GRAVITY
"""Largest acceleration downwards of the tail (m/s^2): the object keeps a fifth of its weight on the pan."""

MAX_TAIL = 2.0
"""Longest deceleration (s); a pan that leaves a plan faster than 2 m/s is not saved by a gentle one."""

REST = 0.3
"""Time the pan is held still after the tail (s), in which an object that still slides comes to rest."""


def brake(pan: FloatArray, sliding: FloatArray, friction: Friction) -> FloatArray:
    """Plan the tail that brings the pan to rest without throwing the object.

    The velocity falls along a cubic, straight ahead. Of several peak decelerations that one is taken which by the law
    of friction keeps the object off the rim, then stops the pan within 0.3 m of where it began, then moves the object
    least. Static friction is not counted on.

    Args:
        pan: (6,) commanded position relative to where the pan began (m) and velocity (m/s) at the end of the plan.
        sliding: (4,) object position (m) and velocity (m/s) relative to the pan, then.
        friction: coefficients.

    Returns:
        (n, 3) pan accelerations (m/s^2), those of the rest after it included.
    """
    least = Friction(friction.kinetic, friction.kinetic)

    def cost(tail: FloatArray) -> tuple[float, float, float]:
        object_position = slide_one(sliding, tail, least)[:, :2]
        object_reach = float(np.hypot(*object_position.T).max())
        pan_reach = float(np.linalg.norm(integrate_pan(pan, tail)[-1, :3]))
        moved = float(np.hypot(*(object_position - sliding[:2]).T).max())
        return max(0.0, object_reach - SAFE_RADIUS), max(0.0, pan_reach - TAIL_REACH), moved

    tails = (_decelerate(pan[3:], peak) for peak in BRAKES)
    return min((tail for tail in tails if tail[:, 2].min() > -MAX_DROP), key=cost)


def _decelerate(velocity: FloatArray, peak: float) -> FloatArray:
    speed = float(np.linalg.norm(velocity))
    samples = max(1, round(min(1.5 * speed / peak, MAX_TAIL) / DT))
    x = np.arange(samples + 1) / samples
    left = 1.0 - x * x * (3.0 - 2.0 * x)
    return np.concatenate([np.diff(left)[:, None] * velocity / DT, np.zeros((round(REST / DT), 3))])

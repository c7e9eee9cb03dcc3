"""The law of friction, linearized: how the object's motion answers to a small change of the pan's (Eqs. 4 and 9).

`linearize` is to changes what `runtime.physics.law.slide_step` is to states: one scalar function in plain floats, which
training compiles for the CPU and for CUDA, and refinement where numba is installed. `lift_equivalent` adds a pan that
lifts.
"""

from __future__ import annotations

import math

SPEED_FLOOR = 0.02
"""Smallest speed that d(v/|v|)/dv is divided by (m/s).

Its true size, mu' g dt / |v| per sample, explodes as the object comes to rest and drowns every other change.
"""

LEAST_RISE = 1.0
"""Smallest rise of |u| over the sample in which an object breaks away that its time is reckoned with (m/s^2)."""


def linearize(
    vx: float, vy: float, ux: float, uy: float, before_x: float, before_y: float,
    static_limit: float, kinetic_limit: float, dt: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Return how the object's next velocity answers to its velocity and to the pan acceleration in one sample.

    While the object slides these are the derivatives of the law (with SPEED_FLOOR). When it stops or breaks away in a
    sample, what answers is the time at which it does, which the law rounds to whole samples: its derivative is zero or
    next to it, and a search that believed it would be blind to both. Here the time is not rounded: an object that
    arrives faster by w stops later by w/(u.d + mu'g), and if the pan is then strong enough to break it away at once,
    begins the way back later by as much; one that rests breaks away when |u| comes to mu n.

    Args:
        vx, vy: object velocity before the sample (m/s).
        ux, uy, before_x, before_y: pan acceleration over the sample, and over the one before (m/s^2).
        static_limit, kinetic_limit: mu n and mu' n (m/s^2).
        dt: sampling interval (s).

    Returns:
        F_xx, F_xy, F_yy (dimensionless) and H_xx, H_xy, H_yy (s), of two symmetric matrices.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    push = math.sqrt(ux * ux + uy * uy)
    if speed > 0.0:
        dx, dy = vx / speed, vy / speed
        along = ux * dx + uy * dy
        if speed - (along + kinetic_limit) * dt > 0.0:
            stiffness = kinetic_limit * dt / max(speed, SPEED_FLOOR)
            return 1.0 - stiffness * dy * dy, stiffness * dx * dy, 1.0 - stiffness * dx * dx, -dt, 0.0, -dt
        if push < static_limit or along <= 0.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        turned = along * (1.0 - kinetic_limit / push) / (along + kinetic_limit)
        return turned, 0.0, turned, -dt * turned, 0.0, -dt * turned
    if push < static_limit or push == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    dx, dy = ux / push, uy / push
    held = static_limit / push
    earlier = 0.0
    before = math.sqrt(before_x * before_x + before_y * before_y)
    if before < static_limit:
        earlier = (static_limit - kinetic_limit) / max(push - before, LEAST_RISE)
    return (
        1.0,
        0.0,
        1.0,
        dt * (held * dy * dy - 1.0 - earlier * dx * dx),
        -dt * (held + earlier) * dx * dy,
        dt * (held * dx * dx - 1.0 - earlier * dy * dy),
    )


def lift_equivalent(
    vx: float, vy: float, ux: float, uy: float, static: float, kinetic: float
) -> tuple[float, float]:  # fmt: skip
    """Return the change of u that does to the object what a change of the upward acceleration w by 1 m/s^2 does.

    A pan that accelerates upwards presses the object on it, and friction grows. While the object slides, it grows by
    mu' against the velocity, and a pan acceleration of mu' v/|v| would do the same. At rest it grows by mu, as if the
    pan's acceleration were smaller by mu u/|u|. So the derivative by w is `linearize`'s H times this.

    Args:
        vx, vy: object velocity before the sample (m/s).
        ux, uy: pan acceleration in the plane over the sample (m/s^2).
        static, kinetic: coefficients mu and mu'.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > 0.0:
        return kinetic * vx / speed, kinetic * vy / speed
    push = math.sqrt(ux * ux + uy * uy)
    if push > 0.0:
        return -static * ux / push, -static * uy / push
    return 0.0, 0.0

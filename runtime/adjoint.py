"""The adjoint of the law of friction: how a gradient with respect to where the object went is one to the pan's motion.

`slide_step_adjoint` is to gradients what `runtime.friction.slide_step` is to states: one scalar function in plain
floats, which training compiles for the CPU and for CUDA, and refinement where numba is installed.
"""

from __future__ import annotations

import math

ADJOINT_SPEED_FLOOR = 0.02
"""Smallest speed that d(v/|v|)/dv is divided by (m/s), in the gradient only.

Its true size, mu' g dt / |v| per sample, explodes as the object comes to rest and drowns every other gradient.
"""


def slide_step_adjoint(
    vx: float,
    vy: float,
    ux: float,
    uy: float,
    static_limit: float,
    kinetic_limit: float,
    dt: float,
    grad_px: float,
    grad_py: float,
    grad_vx: float,
    grad_vy: float,
) -> tuple[float, float, float, float]:
    """Carry a gradient back through one `slide_step`, branch by branch.

    Args:
        vx, vy, ux, uy, static_limit, kinetic_limit, dt: the step's own arguments (its position plays no part).
        grad_px, grad_py, grad_vx, grad_vy: gradient with respect to the step's next position and velocity.

    Returns:
        The gradient with respect to vx, vy, ux, uy. That with respect to the position is grad_px, grad_py unchanged.
    """
    half = 0.5 * dt * dt
    speed = math.sqrt(vx * vx + vy * vy)
    grad_ax = grad_px * half + grad_vx * dt
    grad_ay = grad_py * half + grad_vy * dt
    if speed > 0.0:
        dx = vx / speed
        dy = vy / speed
        next_vx = vx + (-ux - kinetic_limit * dx) * dt
        next_vy = vy + (-uy - kinetic_limit * dy) * dt
        if next_vx * vx + next_vy * vy <= 0.0:
            # Comes to rest: v+ = 0 and p+ = p + v dt/2, whatever u is.
            return 0.5 * dt * grad_px, 0.5 * dt * grad_py, 0.0, 0.0
        along = dx * grad_ax + dy * grad_ay
        stiffness = kinetic_limit / max(speed, ADJOINT_SPEED_FLOOR)
        return (
            grad_vx + dt * grad_px - stiffness * (grad_ax - along * dx),
            grad_vy + dt * grad_py - stiffness * (grad_ay - along * dy),
            -grad_ax,
            -grad_ay,
        )
    push = math.sqrt(ux * ux + uy * uy)
    if push >= static_limit and push > 0.0:
        # a = -u + mu g u/|u|, so da/du = -(1 - mu g/|u|) I - mu g/|u| (u/|u|)(u/|u|)'.
        dx = ux / push
        dy = uy / push
        along = dx * grad_ax + dy * grad_ay
        held = static_limit / push
        return (
            dt * grad_px,
            dt * grad_py,
            held * (grad_ax - along * dx) - grad_ax,
            held * (grad_ay - along * dy) - grad_ay,
        )
    return dt * grad_px, dt * grad_py, 0.0, 0.0

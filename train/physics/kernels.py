"""The rollout and its adjoint as plain functions, to be compiled for the CPU and for CUDA."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from runtime.physics.law import slide_step
from runtime.physics.linearized import lift_equivalent, linearize
from runtime.physics.pan import pan_step


def make_rollout(compiler: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Compile the law, its derivative and the loops over the samples of one trajectory with `compiler`.

    Args:
        compiler: turns a Python function into a compiled one, e.g. `numba.njit` or `cuda.jit(device=True)`.

    Returns:
        `forward(b, start, u, static, kinetic, gravity, dt, states)`, which fills states[b], and
        `backward(b, start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u)`, which fills
        grad_start[b] and grad_u[b]. Shapes: start (B, 10), u (B, n, 3), static, kinetic and gravity (B,), states
        (B, n, 10).
    """
    step, pan = compiler(slide_step), compiler(pan_step)
    linear = compiler(linearize)
    lift = compiler(lift_equivalent)

    @compiler
    def forward(b, start, u, static, kinetic, gravity, dt, states):  # type: ignore[no-untyped-def]
        x, y, z, vx, vy, vz = start[b, 0], start[b, 1], start[b, 2], start[b, 3], start[b, 4], start[b, 5]
        px, py, wx, wy = start[b, 6], start[b, 7], start[b, 8], start[b, 9]
        for k in range(u.shape[1]):
            ux, uy, uz = u[b, k, 0], u[b, k, 1], u[b, k, 2]
            normal = gravity[b] + uz
            px, py, wx, wy = step(px, py, wx, wy, ux, uy, static[b] * normal, kinetic[b] * normal, dt)
            x, vx = pan(x, vx, ux, dt)
            y, vy = pan(y, vy, uy, dt)
            z, vz = pan(z, vz, uz, dt)
            states[b, k, 0], states[b, k, 1], states[b, k, 2] = x, y, z
            states[b, k, 3], states[b, k, 4], states[b, k, 5] = vx, vy, vz
            states[b, k, 6], states[b, k, 7], states[b, k, 8], states[b, k, 9] = px, py, wx, wy

    @compiler
    def backward(b, start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u):  # type: ignore[no-untyped-def]
        half = 0.5 * dt * dt
        gx = gy = gz = gvx = gvy = gvz = gpx = gpy = gwx = gwy = 0.0
        for k in range(u.shape[1] - 1, -1, -1):
            gx += grad_states[b, k, 0]
            gy += grad_states[b, k, 1]
            gz += grad_states[b, k, 2]
            gvx += grad_states[b, k, 3]
            gvy += grad_states[b, k, 4]
            gvz += grad_states[b, k, 5]
            gpx += grad_states[b, k, 6]
            gpy += grad_states[b, k, 7]
            gwx += grad_states[b, k, 8]
            gwy += grad_states[b, k, 9]
            if k > 0:
                wx, wy = states[b, k - 1, 8], states[b, k - 1, 9]
            else:
                wx, wy = start[b, 8], start[b, 9]
            # The sample before a chunk is not known here: an object that breaks away in its first counts as if it
            # could not have done so any earlier.
            before = max(k - 1, 0)
            ux, uy, normal = u[b, k, 0], u[b, k, 1], gravity[b] + u[b, k, 2]
            fxx, fxy, fyy, hxx, hxy, hyy = linear(
                wx, wy, ux, uy, u[b, before, 0], u[b, before, 1], static[b] * normal, kinetic[b] * normal, dt
            )
            ex, ey = lift(wx, wy, ux, uy, static[b], kinetic[b])
            # p+ = p + (w + w+) dt/2 with w+ = F w + H (u + e uz).
            gwx += 0.5 * dt * gpx
            gwy += 0.5 * dt * gpy
            by_ux, by_uy = hxx * gwx + hxy * gwy, hxy * gwx + hyy * gwy
            grad_u[b, k, 0] = by_ux + gvx * dt + gx * half
            grad_u[b, k, 1] = by_uy + gvy * dt + gy * half
            grad_u[b, k, 2] = by_ux * ex + by_uy * ey + gvz * dt + gz * half
            gwx, gwy = (
                fxx * gwx + fxy * gwy + 0.5 * dt * gpx,
                fxy * gwx + fyy * gwy + 0.5 * dt * gpy,
            )
            gvx += gx * dt
            gvy += gy * dt
            gvz += gz * dt
        grad_start[b, 0], grad_start[b, 1], grad_start[b, 2] = gx, gy, gz
        grad_start[b, 3], grad_start[b, 4], grad_start[b, 5] = gvx, gvy, gvz
        grad_start[b, 6], grad_start[b, 7], grad_start[b, 8], grad_start[b, 9] = gpx, gpy, gwx, gwy

    return forward, backward

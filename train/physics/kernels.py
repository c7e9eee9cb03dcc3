"""The rollout and its adjoint as plain functions, to be compiled for the CPU and for CUDA."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from runtime.physics.law import slide_step
from runtime.physics.linearized import linearize


def make_rollout(compiler: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Compile the law, its derivative and the loops over the samples of one trajectory with `compiler`.

    Args:
        compiler: turns a Python function into a compiled one, e.g. `numba.njit` or `cuda.jit(device=True)`.

    Returns:
        `forward(b, start, u, static_limit, kinetic_limit, dt, states)`, which fills states[b], and
        `backward(b, start, u, static_limit, kinetic_limit, dt, states, grad_states, grad_start, grad_u)`, which
        fills grad_start[b] and grad_u[b]. Shapes: start (B, 8), u (B, n, 2), limits (B,), states (B, n, 8).
    """
    step = compiler(slide_step)
    linear = compiler(linearize)

    @compiler
    def forward(b, start, u, static_limit, kinetic_limit, dt, states):  # type: ignore[no-untyped-def]
        half = 0.5 * dt * dt
        x, y, vx, vy = start[b, 0], start[b, 1], start[b, 2], start[b, 3]
        px, py, wx, wy = start[b, 4], start[b, 5], start[b, 6], start[b, 7]
        for k in range(u.shape[1]):
            ux, uy = u[b, k, 0], u[b, k, 1]
            px, py, wx, wy = step(px, py, wx, wy, ux, uy, static_limit[b], kinetic_limit[b], dt)
            x += vx * dt + ux * half
            y += vy * dt + uy * half
            vx += ux * dt
            vy += uy * dt
            states[b, k, 0], states[b, k, 1], states[b, k, 2], states[b, k, 3] = x, y, vx, vy
            states[b, k, 4], states[b, k, 5], states[b, k, 6], states[b, k, 7] = px, py, wx, wy

    @compiler
    def backward(b, start, u, static_limit, kinetic_limit, dt, states, grad_states, grad_start, grad_u):  # type: ignore[no-untyped-def]
        half = 0.5 * dt * dt
        gx = gy = gvx = gvy = gpx = gpy = gwx = gwy = 0.0
        for k in range(u.shape[1] - 1, -1, -1):
            gx += grad_states[b, k, 0]
            gy += grad_states[b, k, 1]
            gvx += grad_states[b, k, 2]
            gvy += grad_states[b, k, 3]
            gpx += grad_states[b, k, 4]
            gpy += grad_states[b, k, 5]
            gwx += grad_states[b, k, 6]
            gwy += grad_states[b, k, 7]
            if k > 0:
                wx, wy = states[b, k - 1, 6], states[b, k - 1, 7]
            else:
                wx, wy = start[b, 6], start[b, 7]
            # The sample before a chunk is not known here: an object that breaks away in its first counts as if it
            # could not have done so any earlier.
            before = max(k - 1, 0)
            fxx, fxy, fyy, hxx, hxy, hyy = linear(
                wx, wy, u[b, k, 0], u[b, k, 1], u[b, before, 0], u[b, before, 1], static_limit[b], kinetic_limit[b], dt
            )
            # p+ = p + (w + w+) dt/2 with w+ = F w + H u.
            gwx += 0.5 * dt * gpx
            gwy += 0.5 * dt * gpy
            grad_u[b, k, 0] = hxx * gwx + hxy * gwy + gvx * dt + gx * half
            grad_u[b, k, 1] = hxy * gwx + hyy * gwy + gvy * dt + gy * half
            gwx, gwy = (
                fxx * gwx + fxy * gwy + 0.5 * dt * gpx,
                fxy * gwx + fyy * gwy + 0.5 * dt * gpy,
            )
            gvx += gx * dt
            gvy += gy * dt
        grad_start[b, 0], grad_start[b, 1], grad_start[b, 2], grad_start[b, 3] = gx, gy, gvx, gvy
        grad_start[b, 4], grad_start[b, 5], grad_start[b, 6], grad_start[b, 7] = gpx, gpy, gwx, gwy

    return forward, backward

"""The differentiable rollout: pan and object driven by pan accelerations, and the adjoint of that (Eqs. 3, 4, 9).

The law is `runtime.friction.slide_step`, and its derivative, with the time at which an object stops or breaks away in
place of the rounded sample, `runtime.linearization.linearize`: two scalar functions in plain Python. `make_rollout`
compiles them, with the loops over samples around them, for whatever target it is handed: numba's CPU compiler here, one
thread per trajectory on CUDA in `train.rollout_cuda`. `Rollout` is the one `torch.autograd.Function` per chunk that
training sees; everything in it is float64.

A row of states is (pan x, y, vx, vy, object x, y, vx, vy): pan in the world, object relative to the pan, m and m/s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import torch
from torch import Tensor

from runtime.friction import DT, slide_step
from runtime.linearization import linearize


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


_forward_one, _backward_one = make_rollout(numba.njit)


@numba.njit(nogil=True)
def _forward_cpu(start, u, static_limit, kinetic_limit, dt, states):  # type: ignore[no-untyped-def]
    for b in range(u.shape[0]):
        _forward_one(b, start, u, static_limit, kinetic_limit, dt, states)


@numba.njit(nogil=True)
def _backward_cpu(start, u, static_limit, kinetic_limit, dt, states, grad_states, grad_start, grad_u):  # type: ignore[no-untyped-def]
    for b in range(u.shape[0]):
        _backward_one(b, start, u, static_limit, kinetic_limit, dt, states, grad_states, grad_start, grad_u)


def _run(name: str, tensors: list[Tensor], dt: float) -> None:
    """Run the kernel `name` on the device the tensors are on; the fifth argument of every kernel is dt."""
    if tensors[0].is_cuda:
        from train import rollout_cuda

        rollout_cuda.launch(name, tensors, dt)
        return
    arrays = [tensor.numpy() for tensor in tensors]
    kernel = _forward_cpu if name == "forward" else _backward_cpu
    kernel(*arrays[:4], dt, *arrays[4:])


class Rollout(torch.autograd.Function):
    """One chunk of pan and object motion; see `rollout` for shapes."""

    @staticmethod
    def forward(ctx: Any, start: Tensor, u: Tensor, static_limit: Tensor, kinetic_limit: Tensor, dt: float) -> Tensor:
        """Run the law from `start` along `u`."""
        start, u = start.detach().contiguous(), u.detach().contiguous()
        states = torch.empty(u.shape[0], u.shape[1], 8, dtype=torch.float64, device=u.device)
        _run("forward", [start, u, static_limit, kinetic_limit, states], dt)
        ctx.save_for_backward(start, u, static_limit, kinetic_limit, states)
        ctx.dt = dt
        return states

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, Tensor, None, None, None]:
        """Carry the gradient of the states back to `start` and `u`."""
        start, u, static_limit, kinetic_limit, states = ctx.saved_tensors
        grad_start, grad_u = torch.empty_like(start), torch.empty_like(u)
        grad_states = grad_outputs[0].contiguous()
        inputs = [start, u, static_limit, kinetic_limit, states, grad_states, grad_start, grad_u]
        _run("backward", inputs, ctx.dt)
        return grad_start, grad_u, None, None, None


def rollout(start: Tensor, u: Tensor, static_limit: Tensor, kinetic_limit: Tensor, dt: float = DT) -> Tensor:
    """Move pan and object along `u`, differentiably (Eqs. 3, 4, 9; the gradient is `linearize`'s, see above).

    Args:
        start: (B, 8) float64 state before the first sample.
        u: (B, n, 2) float64 pan accelerations (m/s^2).
        static_limit, kinetic_limit: (B,) float64, mu g and mu' g (m/s^2).
        dt: sampling interval (s).

    Returns:
        (B, n, 8) float64 states after each sample.
    """
    states: Tensor = Rollout.apply(start, u, static_limit.contiguous(), kinetic_limit.contiguous(), dt)  # type: ignore[no-untyped-call]
    return states

"""The differentiable rollout: pan and object driven by pan accelerations, and the adjoint of that (Eqs. 3, 4, 9).

The law is `runtime.friction.slide_step`, and its derivative, with the time at which an object stops or breaks away in
place of the rounded sample, `runtime.linearization.linearize`: two scalar functions in plain Python. `make_rollout`
compiles them, with the loops over samples around them, for whatever target it is handed: numba's CPU compiler here, one
thread per trajectory on CUDA in `train.rollout_cuda`. `Rollout` is the one `torch.autograd.Function` per chunk that
training sees; everything in it is float64.

A row of states is (pan x, y, vx, vy, object x, y, vx, vy): pan in the world, object relative to the pan, m and m/s.
"""

from __future__ import annotations

from typing import Any

import numba
import torch
from torch import Tensor

from runtime.physics.law import DT
from train.physics.kernels import make_rollout

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
        from train.physics import cuda as rollout_cuda

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

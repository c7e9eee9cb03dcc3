"""The differentiable rollout: pan and object driven by pan accelerations, and the adjoint of that (Eqs. 3, 4, 9).

The law is `runtime.physics.law.slide_step`, and its derivative, with the time at which an object stops or breaks away
in place of the rounded sample, `runtime.physics.linearized.linearize`: scalar functions in plain Python. `make_rollout`
in `train.physics.kernels` compiles them, with the loops over samples around them, for whatever target it is handed:
numba's CPU compiler here, one thread per trajectory on CUDA in `train.physics.cuda`. `Rollout` is the one
`torch.autograd.Function` per chunk that training sees; everything in it is float64.

A row of states is (pan x, y, z, vx, vy, vz, object x, y, vx, vy): pan in the world, object relative to the pan, m and
m/s; a row of accelerations (x, y, z), m/s^2. A level pan may leave its z and vz out of both.
"""

from __future__ import annotations

from typing import Any

import numba
import torch
from torch import Tensor
from torch.nn import functional as F

from runtime.physics.law import DT, GRAVITY
from train.physics.kernels import make_rollout

STATE = 10
"""Columns of a row of states."""

LEVEL = (0, 1, 3, 4, 6, 7, 8, 9)
"""Those of a level pan's."""

_forward_one, _backward_one = make_rollout(numba.njit)


@numba.njit(nogil=True)
def _forward_cpu(start, u, static, kinetic, gravity, dt, states):  # type: ignore[no-untyped-def]
    for b in range(u.shape[0]):
        _forward_one(b, start, u, static, kinetic, gravity, dt, states)


@numba.njit(nogil=True)
def _backward_cpu(start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u):  # type: ignore[no-untyped-def]
    for b in range(u.shape[0]):
        _backward_one(b, start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u)


def _run(name: str, tensors: list[Tensor], dt: float) -> None:
    """Run the kernel `name` on the device the tensors are on; the sixth argument of every kernel is dt."""
    if tensors[0].is_cuda:
        from train.physics import cuda as rollout_cuda

        rollout_cuda.launch(name, tensors, dt)
        return
    arrays = [tensor.numpy() for tensor in tensors]
    kernel = _forward_cpu if name == "forward" else _backward_cpu
    kernel(*arrays[:5], dt, *arrays[5:])


class Rollout(torch.autograd.Function):
    """One chunk of pan and object motion; see `rollout` for shapes."""

    @staticmethod
    def forward(
        ctx: Any, start: Tensor, u: Tensor, static: Tensor, kinetic: Tensor, gravity: Tensor, dt: float
    ) -> Tensor:
        """Run the law from `start` along `u`."""
        start, u = start.detach().contiguous(), u.detach().contiguous()
        states = torch.empty(u.shape[0], u.shape[1], STATE, dtype=torch.float64, device=u.device)
        _run("forward", [start, u, static, kinetic, gravity, states], dt)
        ctx.save_for_backward(start, u, static, kinetic, gravity, states)
        ctx.dt = dt
        return states

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, Tensor, None, None, None, None]:
        """Carry the gradient of the states back to `start` and `u`."""
        start, u, static, kinetic, gravity, states = ctx.saved_tensors
        grad_start, grad_u = torch.empty_like(start), torch.empty_like(u)
        grad_states = grad_outputs[0].contiguous()
        _run("backward", [start, u, static, kinetic, gravity, states, grad_states, grad_start, grad_u], ctx.dt)
        return grad_start, grad_u, None, None, None, None


def rollout(
    start: Tensor, u: Tensor, static: Tensor, kinetic: Tensor, gravity: Tensor | float = GRAVITY, dt: float = DT
) -> Tensor:
    """Move pan and object along `u`, differentiably (Eqs. 3, 4, 9; the gradient is `linearize`'s, see above).

    Args:
        start: (B, 10) float64 state before the first sample; (B, 8) of a level pan.
        u: (B, n, 3) float64 pan accelerations (m/s^2), which must leave the object pressed on the pan: u_z > -gravity;
            (B, n, 2) of a level pan.
        static, kinetic: (B,) float64, coefficients mu and mu'.
        gravity: of all or, where units differ, of each (B,) (m/s^2).
        dt: sampling interval (s).

    Returns:
        (B, n, 10) float64 states after each sample; (B, n, 8) of a level pan.
    """
    level = u.shape[-1] == 2
    if level:
        start, u = start.new_zeros(len(start), STATE).index_copy(1, _columns(start), start), F.pad(u, (0, 1))
    if not isinstance(gravity, Tensor):
        gravity = torch.full_like(static, gravity)
    law = (static.contiguous(), kinetic.contiguous(), gravity.contiguous())
    states: Tensor = Rollout.apply(start, u, *law, dt)  # type: ignore[no-untyped-call]
    return states[..., _columns(states)] if level else states


def _columns(like: Tensor) -> Tensor:
    return torch.tensor(LEVEL, device=like.device)

"""The rollout as one CUDA kernel per chunk, a thread per trajectory, from the same scalar functions as on the CPU."""

from __future__ import annotations

import warnings
from typing import Any

from numba import cuda
from torch import Tensor

from train.physics.kernels import make_rollout

# numba finds a few hundred threads few for a GPU; they are as many as there are trajectories.
warnings.filterwarnings("ignore", message=".*Grid size .* will likely result in GPU under-utilization")

THREADS_PER_BLOCK = 32
"""One warp: batches are a few hundred trajectories at most, better spread over the multiprocessors."""

_forward_one, _backward_one = make_rollout(cuda.jit(device=True))


@cuda.jit
def forward(start, u, static, kinetic, gravity, dt, states):  # type: ignore[no-untyped-def]
    """Kernel: fill `states`, trajectory by trajectory."""
    b = cuda.grid(1)
    if b < u.shape[0]:
        _forward_one(b, start, u, static, kinetic, gravity, dt, states)


@cuda.jit
def backward(start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u):  # type: ignore[no-untyped-def]
    """Kernel: fill `grad_start` and `grad_u`, trajectory by trajectory."""
    b = cuda.grid(1)
    if b < u.shape[0]:
        _backward_one(b, start, u, static, kinetic, gravity, dt, states, grad_states, grad_start, grad_u)


KERNELS = {"forward": forward, "backward": backward}


def launch(name: str, tensors: list[Tensor], dt: float) -> None:
    """Launch a kernel on torch's current stream; the tensors share their memory with numba (no copy)."""
    import torch

    blocks = -(-tensors[1].shape[0] // THREADS_PER_BLOCK)
    arrays: list[Any] = [cuda.as_cuda_array(tensor.detach()) for tensor in tensors]
    stream = cuda.external_stream(torch.cuda.current_stream().cuda_stream)
    KERNELS[name][blocks, THREADS_PER_BLOCK, stream](*arrays[:5], dt, *arrays[5:])

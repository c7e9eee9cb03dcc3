"""Training in several processes, as torchrun starts them: who one is, and means over all of them.

Every process draws the same batch and keeps its rows of it. Its loss divides by what the whole batch would divide by,
so the mean of the gradients, which DistributedDataParallel takes, is the gradient of one process with the whole batch.
A process alone needs none of this: it is process 0 of 1, and every mean is the value itself.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor
from torch import distributed as dist

from runtime.errors import InputError


@contextmanager
def process_group(device: str) -> Iterator[None]:
    """Join the processes that torchrun has started, if it has; gradients go by nccl on CUDA and gloo on CPUs.

    Args:
        device: "cpu" or "cuda"; on CUDA each process of a machine takes a GPU of its own.

    Raises:
        InputError: a machine has more processes than GPUs.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield
        return
    if device == "cuda":
        local, gpus = int(os.environ["LOCAL_RANK"]), torch.cuda.device_count()
        if local >= gpus:
            raise InputError(f"process {local + 1} of this machine finds {gpus} GPUs: start one process for each")
        torch.cuda.set_device(local)
    dist.init_process_group("nccl" if device == "cuda" else "gloo")
    try:
        yield
    finally:
        dist.destroy_process_group()


def processes() -> int:
    """Return how many processes train together."""
    return dist.get_world_size() if dist.is_available() and dist.is_initialized() else 1


def rank() -> int:
    """Return this process's number, from 0; process 0 writes the checkpoints and the progress."""
    return dist.get_rank() if processes() > 1 else 0


def share(batch: int, process: int | None = None, of: int | None = None) -> slice:
    """Return the rows of a batch of `batch` trajectories that are a process's.

    Args:
        batch: number of trajectories.
        process, of: the process's number and how many there are; this one's if None.

    Raises:
        InputError: the batch cannot be shared evenly.
    """
    process, of = rank() if process is None else process, of or processes()
    if batch % of:
        raise InputError(f"batch: {batch} trajectories cannot be shared evenly by {of} processes")
    rows = batch // of
    return slice(process * rows, (process + 1) * rows)


def mean_over_processes(value: Tensor) -> Tensor:
    """Return the mean of a tensor that each process has; no gradient passes."""
    if processes() == 1:
        return value
    total = value.detach().clone()
    dist.all_reduce(total)
    return total / processes()


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of (B, K) `values` over the samples that count; the mean of all processes' is that over the whole batch."""
    return (values * mask).sum() / mean_over_processes(mask.sum())

"""Trajectories that begin in mid-course, or off the mark."""

from __future__ import annotations

import torch
from torch import Tensor

from runtime.physics.law import DT
from train.batches.batches import Batch
from train.batches.disturbances import Disturbance
from train.network.model import Seq2Seq
from train.physics.closed_loop import decode


def disturb(model: Seq2Seq, batch: Batch, disturbance: Disturbance) -> Batch:
    """Return the batch as it is disturbed; where it begins in mid-course, the network leads it there."""
    lead, chunk = disturbance.lead_in, model.chunk
    start, push, noise = (torch.from_numpy(part).to(batch.command.device) for part in disturbance[1:])
    before = start[:, None].expand(-1, chunk, -1)
    if lead == 0:
        return batch._replace(before=before, noise=noise)
    before = lead_in(model, batch.command, batch.static, batch.kinetic, lead, before)
    before[:, -1] += push
    first = lead * chunk
    origin = batch.command[:, first : first + 1, :2]
    return batch._replace(
        command=torch.cat([batch.command[:, first:, :2] - origin, batch.command[:, first:, 2:]], dim=-1),
        object_position=batch.object_position[:, first:] - origin,
        mask=batch.mask[:, first:],
        before=before,
        noise=noise,
    )


def last_acceleration(before: Tensor) -> Tensor:
    """Return the acceleration (B, 2) (m/s^2) that led to the last of the pan's states in (B, C, 8), C at least 2."""
    return (before[:, -1, 2:4] - before[:, -2, 2:4]) / DT


@torch.no_grad()
def lead_in(model: Seq2Seq, command: Tensor, static: Tensor, kinetic: Tensor, chunks: int, before: Tensor) -> Tensor:
    """Follow the first `chunks` chunks of a command, as a planner does that then reads on from there.

    Args:
        model, command, static, kinetic, before: as for `decode`.
        chunks: how far to follow.

    Returns:
        (B, C, 8) the last C states, the object relative to the command at the end of these chunks: what `decode`
        takes as `before` for the rest of the command.
    """
    samples = chunks * model.chunk
    moved = decode(model, command, static, kinetic, before=before).states
    states = moved[:, samples - model.chunk : samples].clone()
    states[..., 4:6] -= command[:, None, samples, :2]
    return states

"""The sequence-to-sequence network of Section IV-A: an LSTM encoder and an LSTM decoder that works in chunks.

Layouts, all flattened row by row: a command chunk is C rows of (x, y, vx, vy); an observation is C rows of
(pan x, y, vx, vy, object x, y, vx, vy) followed by `command_ahead` command chunks, the first being the one whose
accelerations the decoder is about to produce. SI units go in and come out; normalization is part of the network.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

POSITION_SCALE = 0.1
"""Positions enter the network divided by this (m)."""

VELOCITY_SCALE = 0.5
"""Velocities enter the network divided by this (m/s)."""

ACCELERATION_SCALE = 10.0
"""The output layer's unit (m/s^2)."""

MAX_CORRELATION = 0.95
"""Bound on the correlation of the two accelerations, so that their covariance stays invertible."""

LOG_STD_RANGE = (-7.0, 4.0)
"""Range of the log standard deviations (of m/s^2); outside, exp() could underflow or overflow in a bad step."""

FEEDFORWARD_UNITS = 500
"""Width of the decoder's tanh layer (Section IV-A)."""

SQUARE_FLOOR = 1e-12
"""Added to |u|^2 under the root of the bound ((m/s^2)^2): the root's derivative at zero would be infinite."""


class DecoderState(NamedTuple):
    """What the decoder carries from chunk to chunk: hidden and cell, each (layers, B, units)."""

    hidden: Tensor
    cell: Tensor


class DecoderOutput(NamedTuple):
    """One decoder iteration: accelerations (B, C, 2) in m/s^2, their covariance as (B, C, 3): xx, xy, yy."""

    acceleration: Tensor
    covariance: Tensor


def bound_acceleration(u: Tensor, limit: float) -> Tensor:
    """Bound |u| smoothly below `limit` and keep its direction: limit tanh(|u|/limit) u/|u|.

    Args:
        u: (..., 2) accelerations (m/s^2).
        limit: the bound (m/s^2).
    """
    size = torch.sqrt((u * u).sum(-1, keepdim=True) + SQUARE_FLOOR)
    return u * (limit * torch.tanh(size / limit) / size)


class Seq2Seq(nn.Module):
    """Encoder and decoder of Fig. 5.

    Args:
        units: LSTM units per layer.
        chunk: samples per iteration, C.
        layers: LSTM layers in the encoder and in the decoder.
        command_ahead: command chunks added to the decoder's input (0 in the paper).
        acceleration_bound: bound on |u| (m/s^2), None for none (the paper).
    """

    command_scale: Tensor
    observation_scale: Tensor

    def __init__(
        self,
        units: int,
        chunk: int = 100,
        layers: int = 2,
        command_ahead: int = 0,
        acceleration_bound: float | None = None,
    ) -> None:
        super().__init__()
        self.units, self.chunk, self.layers = units, chunk, layers
        self.command_ahead, self.acceleration_bound = command_ahead, acceleration_bound
        self.encoder_lstm = nn.LSTM(4 * chunk, units, layers, batch_first=True)
        self.decoder_lstm = nn.LSTM((8 + 4 * command_ahead) * chunk, units, layers)
        self.feedforward = nn.Linear(units, FEEDFORWARD_UNITS)
        self.output = nn.Linear(FEEDFORWARD_UNITS, 5 * chunk)
        row = torch.tensor([1 / POSITION_SCALE] * 2 + [1 / VELOCITY_SCALE] * 2)
        self.register_buffer("command_scale", row.repeat(chunk), persistent=False)
        self.register_buffer("observation_scale", row.repeat((2 + command_ahead) * chunk), persistent=False)

    def encode(self, command: Tensor) -> DecoderState:
        """Read a whole command, (B, chunks, 4C); the decoder starts from the state it leaves."""
        return last_states(self.encoder_lstm, command.float() * self.command_scale)

    def decoder(self, command: Tensor) -> ChunkDecoder:
        """Prepare the decoding of `command`, (B, chunks, 4C), for `ChunkDecoder.step`."""
        return ChunkDecoder(self, command)

    def read_out(self, top: Tensor) -> DecoderOutput:
        """Turn the top layer's hidden state, (B, units), into accelerations and covariances."""
        raw = self.output(torch.tanh(self.feedforward(top))).float()
        u = ACCELERATION_SCALE * raw[:, : 2 * self.chunk].reshape(-1, self.chunk, 2)
        if self.acceleration_bound is not None:
            u = bound_acceleration(u, self.acceleration_bound)
        spread = raw[:, 2 * self.chunk :].reshape(-1, self.chunk, 3)
        std = torch.exp(spread[..., :2].clamp(*LOG_STD_RANGE))
        correlation = MAX_CORRELATION * torch.tanh(spread[..., 2])
        xx, yy = std[..., 0] ** 2, std[..., 1] ** 2
        xy = correlation * std[..., 0] * std[..., 1]
        return DecoderOutput(u, torch.stack([xx, xy, yy], dim=-1))


class ChunkDecoder:
    """The decoder over one batch of commands, with what does not depend on the motion computed beforehand.

    The part of the first layer's gates that comes from the command ahead is one large product for all chunks, and
    the weights are taken apart once: several times faster than `nn.LSTM` called chunk by chunk.

    Args:
        model: the network.
        command: (B, chunks, 4C) commands; past the end they are held at the last position, at rest.
    """

    def __init__(self, model: Seq2Seq, command: Tensor) -> None:
        self.model = model
        self.weights = model.decoder_lstm.all_weights
        moving = 8 * model.chunk
        w_ih, _, b_ih, _ = self.weights[0]
        self.w_moving = w_ih[:, :moving].contiguous()
        if model.command_ahead:
            ahead = command_ahead(command, model.command_ahead) * model.observation_scale[moving:]
            self.command_gates = F.linear(ahead, w_ih[:, moving:].contiguous(), b_ih).unbind(1)
        else:
            self.command_gates = (b_ih,) * command.shape[1]

    def step(self, n: int, motion: Tensor, state: DecoderState) -> tuple[DecoderOutput, DecoderState]:
        """Decoder iteration n: the last C states, (B, C, 8), to the next C accelerations."""
        model = self.model
        x = motion.flatten(1).float() * model.observation_scale[: 8 * model.chunk]
        gates = F.linear(x, self.w_moving) + self.command_gates[n]
        hidden, cell = [], []
        for layer, (w_ih, w_hh, b_ih, b_hh) in enumerate(self.weights):
            if layer > 0:
                gates = F.linear(x, w_ih, b_ih)
            x, c = lstm_cell(gates, state.hidden[layer], state.cell[layer], w_hh, b_hh)
            hidden.append(x)
            cell.append(c)
        return model.read_out(x), DecoderState(torch.stack(hidden), torch.stack(cell))


def last_states(lstm: nn.LSTM, x: Tensor) -> DecoderState:
    """Return the states, (layers, B, units), in which an LSTM is after reading x, (B, N, width)."""
    hidden, cell = [], []
    for w_ih, w_hh, b_ih, b_hh in lstm.all_weights:
        gates = F.linear(x, w_ih, b_ih)
        h = c = x.new_zeros(x.shape[0], lstm.hidden_size)
        outputs = []
        for input_gates in gates.unbind(1):
            h, c = lstm_cell(input_gates, h, c, w_hh, b_hh)
            outputs.append(h)
        x = torch.stack(outputs, dim=1)
        hidden.append(h)
        cell.append(c)
    return DecoderState(torch.stack(hidden), torch.stack(cell))


def lstm_cell(input_gates: Tensor, hidden: Tensor, cell: Tensor, w_hh: Tensor, b_hh: Tensor) -> tuple[Tensor, Tensor]:
    """One LSTM step in torch's gate order (i, f, g, o); the cell state stays float32 under autocast."""
    gates = (input_gates + F.linear(hidden, w_hh, b_hh)).float()
    i, f, g, o = gates.chunk(4, dim=-1)
    c = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
    return torch.sigmoid(o) * torch.tanh(c), c


def command_ahead(command: Tensor, chunks: int) -> Tensor:
    """For each decoder iteration n, the command of chunks n, n+1, ... n+chunks-1, flattened.

    Args:
        command: (B, N, 4C) command chunks, rows (x, y, vx, vy).
        chunks: how many chunks ahead the decoder sees.

    Returns:
        (B, N, 4C chunks); past the end the command is held at its last position, at rest.
    """
    batch, count, width = command.shape
    rest = command[:, -1, -4:].clone()
    rest[:, 2:] = 0.0
    held = rest.repeat(1, width // 4)[:, None].expand(batch, chunks, width)
    padded = torch.cat([command, held], dim=1)
    return torch.cat([padded[:, j : j + count] for j in range(chunks)], dim=-1)

"""The sequence-to-sequence network of Section IV-A: an LSTM encoder and an LSTM decoder that works in chunks.

Layouts, all flattened row by row: a command chunk is C rows of (x, y, vx, vy); an observation is C rows of
(pan x, y, vx, vy, object x, y, vx, vy). SI units go in and come out; normalization is part of the network.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from train.network.lstm import DecoderState, last_states, step

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


class DecoderOutput(NamedTuple):
    """One decoder iteration: accelerations (B, C, 2) in m/s^2, their covariance as (B, C, 3): xx, xy, yy."""

    acceleration: Tensor
    covariance: Tensor


class PaperNetwork(nn.Module):
    """Encoder and decoder of Fig. 5.

    Args:
        units: LSTM units per layer.
        chunk: samples per iteration, C.
        layers: LSTM layers in the encoder and in the decoder.
    """

    command_scale: Tensor
    observation_scale: Tensor

    def __init__(self, units: int, chunk: int = 100, layers: int = 2) -> None:
        super().__init__()
        self.units, self.chunk, self.layers = units, chunk, layers
        self.encoder_lstm = nn.LSTM(4 * chunk, units, layers, batch_first=True)
        self.decoder_lstm = nn.LSTM(8 * chunk, units, layers)
        self.feedforward = nn.Linear(units, FEEDFORWARD_UNITS)
        self.output = nn.Linear(FEEDFORWARD_UNITS, 5 * chunk)
        row = torch.tensor([1 / POSITION_SCALE] * 2 + [1 / VELOCITY_SCALE] * 2)
        self.register_buffer("command_scale", row.repeat(chunk), persistent=False)
        self.register_buffer("observation_scale", row.repeat(2 * chunk), persistent=False)

    def encode(self, command: Tensor) -> DecoderState:
        """Read a whole command, (B, chunks, 4C); the decoder starts from the state it leaves."""
        return last_states(self.encoder_lstm, command.float() * self.command_scale)

    def step(self, motion: Tensor, state: DecoderState) -> tuple[DecoderOutput, DecoderState]:
        """Take one decoder iteration: the last C states, (B, C, 8), to the next C accelerations."""
        top, after = step(self.decoder_lstm, motion.flatten(1).float() * self.observation_scale, state)
        return self.read_out(top), after

    def read_out(self, top: Tensor) -> DecoderOutput:
        """Turn the top layer's hidden state, (B, units), into accelerations and covariances."""
        raw = self.output(torch.tanh(self.feedforward(top))).float()
        u = ACCELERATION_SCALE * raw[:, : 2 * self.chunk].reshape(-1, self.chunk, 2)
        spread = raw[:, 2 * self.chunk :].reshape(-1, self.chunk, 3)
        std = torch.exp(spread[..., :2].clamp(*LOG_STD_RANGE))
        correlation = MAX_CORRELATION * torch.tanh(spread[..., 2])
        xx, yy = std[..., 0] ** 2, std[..., 1] ** 2
        xy = correlation * std[..., 0] * std[..., 1]
        return DecoderOutput(u, torch.stack([xx, xy, yy], dim=-1))

"""The encoder and the decoder (Section IV-A), for every pan: what they see, and accelerations in space.

All numbers are in the network's units (`runtime.network.units`). A row of states is (pan x, y, z, vx, vy, vz, object
x, y, vx, vy), a row of a command (x, y, vx, vy). What the decoder sees of the object and of the command is relative to
where the command is now: where on the pan that is makes no difference to the law.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from runtime.network.units import (
    ACCELERATION,
    AHEAD_ROWS,
    CHUNK,
    CONDITIONS,
    ENCODER_CHUNK,
    ENCODER_ROWS,
    SEEN_ROWS,
    Situation,
)
from train.network.lstm import DecoderState, last_states, step

STATE_GAINS = (10.0, 10.0, 10.0, 2.0, 2.0, 2.0, 20.0, 20.0, 2.0, 2.0)
"""What each column of the states is multiplied by on its way in."""

NOW_GAINS = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 5.0, 2.5, 2.5)
"""What the columns of the last row are multiplied by once more, seen a second time: small errors count there."""

COMMAND_GAINS = (20.0, 20.0, 2.0, 2.0)
"""What each column of the command ahead is multiplied by."""

ENCODER_GAINS = (10.0, 10.0, 2.0, 2.0)
"""What each column of the command is multiplied by for the encoder."""

ACCELERATION_GAIN = 0.1
"""What the last acceleration is multiplied by."""

OUTPUT_SCALE = 10.0
"""The output layer's unit of acceleration."""

SQUARE_FLOOR = 1e-12
"""Added to the square of a size under its root, whose derivative at zero would be infinite."""

FLOOR_SHARPNESS = 3.0
"""How sharply the upward acceleration bends at its floor, per unit of acceleration."""

SEEN = slice(SEEN_ROWS[0], None, SEEN_ROWS[1] - SEEN_ROWS[0])
"""SEEN_ROWS, of which a slice has the cheaper derivative."""

OBSERVATION = 10 * len(SEEN_ROWS) + 10 + 3 + 4 * len(AHEAD_ROWS) + CONDITIONS + 1
"""Width of what the decoder sees."""


class Told(NamedTuple):
    """What a network is told of B situations: conditions (B, CONDITIONS), floor and lift (B,), float32."""

    conditions: Tensor
    floor: Tensor
    lift: Tensor

    @classmethod
    def of(cls, situation: Situation) -> Told:
        """Return it as tensors."""
        parts = (situation.conditions(), situation.floor, situation.lift)
        return cls(*(torch.from_numpy(part).float() for part in parts))


class Network(nn.Module):
    """Encoder and decoder.

    Args:
        units: LSTM units per layer.
        layers: LSTM layers of each.
        features: units of the decoder's tanh layer.
    """

    def __init__(self, units: int, layers: int = 2, features: int = 384) -> None:
        super().__init__()
        self.units, self.layers = units, layers
        self.encoder_lstm = nn.LSTM(4 * len(ENCODER_ROWS) + CONDITIONS, units, layers, batch_first=True)
        self.decoder_lstm = nn.LSTM(OBSERVATION, units, layers)
        self.feedforward = nn.Linear(units, features)
        self.output = nn.Linear(features, 3 * CHUNK)
        with torch.no_grad():  # to begin with, pans lift little
            self.output.weight[2 * CHUNK :] *= 0.1

    def encode(self, command: Tensor, told: Told) -> DecoderState:
        """Read a command, (B, K, 4) from its first position on, K a multiple of ENCODER_CHUNK."""
        return last_states(self.encoder_lstm, encoder_input(command, told))

    def step(self, observation: Tensor, told: Told, state: DecoderState) -> tuple[Tensor, DecoderState]:
        """Plan one chunk.

        Args:
            observation: (B, OBSERVATION), see `observe`.
            told: the situations.
            state: what the decoder carries.

        Returns:
            Accelerations in space, (B, CHUNK, 3), and what the decoder carries on.
        """
        top, after = step(self.decoder_lstm, observation, state)
        raw = OUTPUT_SCALE * self.output(torch.tanh(self.feedforward(top))).float()
        return bounded(raw, told), after


def bounded(raw: Tensor, told: Told) -> Tensor:
    """Turn the output layer's (B, 3 CHUNK), x before y before z, into accelerations (B, CHUNK, 3) within the limits.

    Their size is bent below ACCELERATION as tanh does, with the direction kept; the upward one then above -floor. A
    level pan's is zero.
    """
    x, y, z = raw.chunk(3, dim=1)
    lift, floor = told.lift[:, None], told.floor[:, None]
    z = z * lift
    size = torch.sqrt(x * x + y * y + z * z + SQUARE_FLOOR)
    share = ACCELERATION * torch.tanh(size / ACCELERATION) / size
    above = F.softplus(FLOOR_SHARPNESS * (z * share + floor)) / FLOOR_SHARPNESS - floor
    return torch.stack([x * share, y * share, above * torch.sign(lift)], dim=-1)


def encoder_input(command: Tensor, told: Told) -> Tensor:
    """Lay out commands (B, K, 4) as the encoder reads them: (B, K / ENCODER_CHUNK, rows and conditions), float32."""
    count = command.shape[1] // ENCODER_CHUNK
    chunks = command.reshape(len(command), count, ENCODER_CHUNK, 4)
    rows = chunks[:, :, _constant(ENCODER_ROWS, command.device)]
    rows = (rows * command.new_tensor(ENCODER_GAINS)).flatten(2).float()
    return torch.cat([rows, told.conditions[:, None].expand(-1, count, -1)], dim=-1)


def observe(
    states: Tensor,
    ahead: Tensor,
    acceleration: Tensor,
    told: Told,
    elapsed: float,
    noise: Tensor | None = None,
) -> Tensor:
    """Lay out what the decoder sees, (B, OBSERVATION), float32.

    Args:
        states: (B, CHUNK, 10) the last states, the last of them now.
        ahead: (B, AHEAD, 4) the command, its first row now.
        acceleration: (B, 3) of the sample before.
        told: the situations.
        elapsed: samples since the decoder was asked before, over CHUNK; 1 the first time.
        noise: (B, len(SEEN_ROWS), 10) added to the states that are seen; none if None.
    """
    seen = states[:, SEEN]
    if noise is not None:
        seen = seen + noise
    here = ahead[:, :1, :2]
    none = here.new_zeros(here.shape)
    seen = (seen - torch.cat([none, none, none, here, none], dim=-1)) * states.new_tensor(STATE_GAINS)
    rows = ahead[:, _constant(AHEAD_ROWS, ahead.device)]
    rows = (rows - torch.cat([here, none], dim=-1)) * ahead.new_tensor(COMMAND_GAINS)
    now = seen[:, -1] * states.new_tensor(NOW_GAINS)
    moving = torch.cat([seen.flatten(1), now, acceleration * ACCELERATION_GAIN, rows.flatten(1)], dim=-1).float()
    return torch.cat([moving, told.conditions, moving.new_full((len(moving), 1), elapsed)], dim=-1)


def _constant(values: tuple[int, ...], device: torch.device) -> Tensor:
    return torch.tensor(values, device=device)

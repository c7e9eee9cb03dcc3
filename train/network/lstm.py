"""LSTM layers written out: on a CPU several times faster than `nn.LSTM` called step by step."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class DecoderState(NamedTuple):
    """What a decoder carries from chunk to chunk: hidden and cell, each (layers, B, units)."""

    hidden: Tensor
    cell: Tensor


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


def step(lstm: nn.LSTM, x: Tensor, state: DecoderState) -> tuple[Tensor, DecoderState]:
    """Take one step with x, (B, width); return the top layer's output, (B, units), and the states after it."""
    hidden, cell = [], []
    for layer, (w_ih, w_hh, b_ih, b_hh) in enumerate(lstm.all_weights):
        x, c = lstm_cell(F.linear(x, w_ih, b_ih), state.hidden[layer], state.cell[layer], w_hh, b_hh)
        hidden.append(x)
        cell.append(c)
    return x, DecoderState(torch.stack(hidden), torch.stack(cell))


def lstm_cell(input_gates: Tensor, hidden: Tensor, cell: Tensor, w_hh: Tensor, b_hh: Tensor) -> tuple[Tensor, Tensor]:
    """One LSTM step in torch's gate order (i, f, g, o); the cell state stays float32 under autocast."""
    gates = (input_gates + F.linear(hidden, w_hh, b_hh)).float()
    i, f, g, o = gates.chunk(4, dim=-1)
    c = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
    return torch.sigmoid(o) * torch.tanh(c), c

"""Steps along the gradient: Adam as in the paper, or Muon for the matrices and Adam for the biases.

Muon (Jordan et al. 2024) replaces the momentum of a matrix by the nearest orthogonal matrix, so that every direction
gets a step of the same size, the rare ones too. An LSTM's matrix is four matrices on top of each other, one a gate, and
each of them gets a step of its own: better than one for all, and five times cheaper.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from train.run_config import OptimizerKind

GATES = 4
"""Of an LSTM: its matrices are that many, one on top of the other."""


class Optimizer:
    """Updates the weights of a network in place.

    Args:
        model: the network.
        kind: "adam", or "muon" with steps as large as Adam's usually are, so that it likes Adam's learning rates.
        rate: the learning rate.
    """

    def __init__(self, model: nn.Module, kind: OptimizerKind, rate: float) -> None:
        self.parameters = list(model.parameters())
        matrices = [(name, weight) for name, weight in model.named_parameters() if weight.ndim == 2 and kind == "muon"]
        self._parts = [(weight, _parts(name, weight)) for name, weight in matrices]
        taken = {id(weight) for _, weight in matrices}
        self._optimizers: list[torch.optim.Optimizer] = [
            torch.optim.Adam([weight for weight in self.parameters if id(weight) not in taken], lr=rate)
        ]
        if matrices:
            parts = [part for _, parts in self._parts for part in parts]
            self._optimizers.append(torch.optim.Muon(parts, lr=rate, weight_decay=0.0, adjust_lr_fn="match_rms_adamw"))

    def set_rate(self, rate: float) -> None:
        """Set the learning rate of the steps to come."""
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = rate

    def zero_grad(self) -> None:
        """Forget the gradients."""
        for weight in self.parameters:
            weight.grad = None

    def step(self) -> None:
        """Make one step along the gradients that the weights have."""
        for weight, parts in self._parts:
            assert weight.grad is not None
            for part, gradient in zip(parts, weight.grad.chunk(len(parts)), strict=True):
                part.grad = gradient
        for optimizer in self._optimizers:
            optimizer.step()

    def state_dict(self) -> list[dict[str, Any]]:
        """Return what `load_state_dict` goes on from."""
        return [optimizer.state_dict() for optimizer in self._optimizers]

    def load_state_dict(self, states: list[dict[str, Any]]) -> None:
        """Go on from a state that `state_dict` returned."""
        for optimizer, state in zip(self._optimizers, states, strict=True):
            optimizer.load_state_dict(state)


def _parts(name: str, weight: Tensor) -> list[nn.Parameter]:
    """Return the matrices that a weight consists of; they are views of it, so that a step of theirs is a step of it."""
    return [nn.Parameter(part) for part in weight.data.chunk(GATES if "lstm" in name else 1)]

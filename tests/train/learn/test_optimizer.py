"""The optimizers: Adam is torch's, Muon steps matrix by matrix and gate by gate, both go on from their state."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from train.learn.optimizer import Optimizer

UNITS = 12


def network() -> nn.Module:
    torch.manual_seed(0)
    return nn.ModuleDict({"the_lstm": nn.LSTM(20, UNITS), "output": nn.Linear(UNITS, 8)})


def give_gradients(model: nn.Module, seed: int) -> None:
    """Give every weight a gradient of its own, gates of very different sizes included."""
    generator = torch.Generator().manual_seed(seed)
    for name, weight in model.named_parameters():
        weight.grad = torch.randn(weight.shape, generator=generator)
        if "lstm" in name:
            weight.grad[:UNITS] *= 1000.0


def test_adam_is_torchs():
    ours, theirs = network(), network()
    optimizer, reference = Optimizer(ours, "adam", 1e-2), torch.optim.Adam(theirs.parameters(), lr=1e-2)
    for seed in range(3):
        give_gradients(ours, seed)
        give_gradients(theirs, seed)
        optimizer.step()
        reference.step()
    for mine, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        assert torch.equal(mine, other)


def test_muon_steps_equally_far_in_all_directions_of_each_gate():
    model = network()
    before = copy.deepcopy(model.state_dict())
    give_gradients(model, 0)
    optimizer = Optimizer(model, "muon", 1e-2)
    optimizer.set_rate(1e-3)
    optimizer.step()
    for name, weight in model.state_dict().items():
        step = weight - before[name]
        if weight.ndim == 1:
            torch.testing.assert_close(step.abs(), torch.full_like(step, 1e-3), rtol=1e-3, atol=0.0)
            continue
        for part in step.chunk(4 if "lstm" in name else 1):
            sizes = torch.linalg.svdvals(part) / (0.2e-3 * max(part.shape) ** 0.5)
            assert sizes.median() > 0.6, name
            assert sizes.max() < 1.3, name


@pytest.mark.parametrize("kind", ["adam", "muon"])
def test_it_goes_on_from_its_state_to_the_last_bit(kind):
    model = network()
    optimizer = Optimizer(model, kind, 1e-2)
    for seed in range(2):
        give_gradients(model, seed)
        optimizer.step()
    resumed = network()
    resumed.load_state_dict(model.state_dict())
    again = Optimizer(resumed, kind, 1e-2)
    again.load_state_dict(copy.deepcopy(optimizer.state_dict()))
    for it, its in ((model, optimizer), (resumed, again)):
        give_gradients(it, 2)
        its.step()
    for mine, other in zip(model.parameters(), resumed.parameters(), strict=True):
        assert torch.equal(mine, other)
    optimizer.zero_grad()
    assert all(weight.grad is None for weight in model.parameters())

"""The network: what it sees, and what comes out of it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from runtime.network.units import ACCELERATION, AHEAD, CHUNK, ENCODER_CHUNK, Situation
from train.network.network import OBSERVATION, Network, Told, bounded, observe


def told(height, gravity=15.0, batch=3):
    parts = (gravity, 5_000.0, 3.0, height, 0.5, 0.3, 1.0)
    return Told.of(Situation(*(np.full(batch, part) for part in parts)))


def seen(seed=0, batch=3):
    rng = np.random.default_rng(seed)
    shapes = ((CHUNK, 10), (AHEAD, 4), (3,))
    return [torch.from_numpy(rng.normal(0, 0.1, (batch, *shape))) for shape in shapes]


@pytest.mark.parametrize("height", [0.0, 0.01, 0.1])
def test_accelerations_are_within_the_limit_and_leave_a_fifth_of_the_weight(height):
    raw = torch.from_numpy(np.random.default_rng(0).normal(0, 60, (3, 3 * CHUNK)))
    u = bounded(raw, told(height))
    assert u.shape == (3, CHUNK, 3)
    assert torch.linalg.vector_norm(u, dim=-1).max() <= ACCELERATION + 1e-3
    assert u[..., 2].min() >= -0.8 * 15.0
    assert bool((u[..., 2] == 0.0).all()) == (height == 0.0)


def test_small_accelerations_are_what_the_output_layer_says():
    raw = torch.from_numpy(np.random.default_rng(0).normal(0, 0.1, (3, 3 * CHUNK)))
    u = bounded(raw, told(0.1))
    for axis in range(3):
        np.testing.assert_allclose(u[..., axis], raw[:, axis * CHUNK : (axis + 1) * CHUNK], atol=1e-4)


def test_where_on_the_pan_command_and_object_are_makes_no_difference():
    states, ahead, last = seen()
    offset = torch.tensor([0.07, -0.11])
    moved, moved_ahead = states.clone(), ahead.clone()
    moved[..., 6:8] += offset
    moved_ahead[..., :2] += offset
    here, there = (observe(s, a, last, told(0.1), 0.5) for s, a in ((states, ahead), (moved, moved_ahead)))
    assert here.shape == (3, OBSERVATION)
    np.testing.assert_allclose(here, there, atol=1e-5)


def test_every_part_of_what_is_seen_is_seen():
    states, ahead, last = seen()
    plain = observe(states, ahead, last, told(0.1), 0.5)
    for part in (states, ahead, last):
        for column in range(part.shape[-1]):
            part[..., column] += 0.05 * torch.rand(part.shape[:-1], dtype=torch.float64)
            changed = observe(states, ahead, last, told(0.1), 0.5)
            assert (changed != plain).any(dim=1).all()
            plain = changed
    assert (observe(states, ahead, last, told(0.1), 0.25) != plain).sum() == 3
    assert (observe(states, ahead, last, told(0.1, gravity=20.0), 0.5) != plain).any()


def test_every_weight_has_a_gradient():
    network = Network(8, features=6)
    states, ahead, last = seen()
    state = network.encode(ahead[:, : 2 * ENCODER_CHUNK], told(0.1))
    u, state = network.step(observe(states, ahead, last, told(0.1), 1.0), told(0.1), state)
    u, _ = network.step(observe(states, ahead, u[:, -1].double(), told(0.1), 1.0), told(0.1), state)
    u.square().sum().backward()
    for name, weight in network.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().max() > 0, name

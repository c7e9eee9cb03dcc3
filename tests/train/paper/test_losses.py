"""The losses: closed forms against the recursions they stand for, weights and masks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from runtime.physics.law import DT
from train.learn.parallel import masked_mean
from train.paper.losses import Weights, gaussian_nll, loss_object, loss_pan, position_covariance


def random_covariances(batch=2, samples=150):
    rng = np.random.default_rng(0)
    root = rng.normal(0, 1, (batch, samples, 2, 2))
    return root @ root.swapaxes(-1, -2)


def packed(matrices):
    return torch.from_numpy(np.stack([matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]], axis=-1))


def test_position_covariance_equals_the_recursion_of_equations_19_and_20():
    inputs = random_covariances()
    got = position_covariance(packed(inputs)).numpy()
    a = np.block([[np.eye(2), DT * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    b = np.vstack([DT**2 / 2 * np.eye(2), DT * np.eye(2)])
    for trajectory in range(len(inputs)):
        s = np.zeros((4, 4))
        for k, su in enumerate(inputs[trajectory]):
            s = a @ s @ a.T + b @ su @ b.T
            want = np.array([s[0, 0], s[0, 1], s[1, 1]])
            np.testing.assert_allclose(got[trajectory, k], want, rtol=1e-8, atol=1e-22)


def test_likelihood_is_equation_22_with_the_floor_on_the_covariance():
    rng = np.random.default_rng(1)
    covariances, error = 1e-6 * random_covariances(1, 20), rng.normal(0, 1e-3, (1, 20, 2))
    got = gaussian_nll(torch.from_numpy(error), packed(covariances), floor=1e-3).numpy()
    for k in range(20):
        s, e = covariances[0, k] + 1e-6 * np.eye(2), error[0, k]
        want = math.log(2 * math.pi * math.sqrt(np.linalg.det(s))) + e @ np.linalg.solve(s, e)
        assert got[0, k] == pytest.approx(want, rel=1e-12)


def test_masked_samples_do_not_count():
    values = torch.tensor([[1.0, 2.0, 100.0]])
    assert masked_mean(values, torch.tensor([[1.0, 1.0, 0.0]])).item() == pytest.approx(1.5)


def motion(samples=4):
    states = torch.zeros(1, samples, 8, dtype=torch.float64)
    u = torch.zeros(1, samples, 2, dtype=torch.float64)
    covariance = torch.ones(1, samples, 3, dtype=torch.float64) * torch.tensor([1.0, 0.0, 1.0])
    return states, u, covariance, torch.zeros(1, samples, 2, dtype=torch.float64), torch.ones(1, samples)


def test_pan_limit_is_penalized_by_the_distance_beyond_it():
    states, u, covariance, wanted, mask = motion()
    weights = Weights(alpha=1.0, beta=7.0, gamma=0.0, pan_limit=0.2)
    inside = loss_object(states, u, covariance, wanted, mask, weights)
    states[0, 1, :2] = torch.tensor([0.3, 0.4])
    beyond = loss_object(states, u, covariance, wanted, mask, weights)
    assert (beyond - inside).item() == pytest.approx(7.0 * (0.5 - 0.2) / 4)


def test_change_of_acceleration_is_penalized():
    states, u, covariance, wanted, mask = motion()
    weights = Weights(alpha=1.0, beta=0.0, gamma=2.0, pan_limit=0.2)
    smooth = loss_object(states, u, covariance, wanted, mask, weights)
    u[0, 2] = torch.tensor([3.0, 4.0])
    rough = loss_object(states, u, covariance, wanted, mask, weights)
    assert (rough - smooth).item() == pytest.approx(2.0 * (5.0 + 5.0) / 4)


def test_smooth_motion_has_a_finite_gradient():
    states, u, covariance, wanted, mask = motion()
    u.requires_grad_()
    loss_object(states, u, covariance, wanted, mask, Weights(1.0, 50.0, 0.1, 0.2)).backward()
    assert torch.isfinite(u.grad).all()


def test_pan_loss_looks_at_the_pan_alone():
    states, _, covariance, wanted, mask = motion()
    plain = loss_pan(states, covariance, wanted, mask)
    states[..., 4:] = 1.0
    assert loss_pan(states, covariance, wanted, mask).item() == plain.item()
    states[..., 0] = 0.01
    assert loss_pan(states, covariance, wanted, mask).item() > plain.item()

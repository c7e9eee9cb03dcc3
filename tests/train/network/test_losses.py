"""What a motion costs."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from runtime.network.units import REACH, Situation
from train.config import load_config
from train.network.closed_loop import Moved
from train.network.losses import farthest, loss, tracking_errors
from train.network.network import Told
from train.network.situations import Trajectories

CONFIG = load_config("smoke")
B, K = 2, 50


def trajectories(height=0.1, jerk=5_000.0, speed=2.0):
    situation = Situation(*(np.full(B, part) for part in (15.0, jerk, speed, height, 0.5, 0.3, 1.0)))
    zeros = torch.zeros(B, K, 10, dtype=torch.float64)
    return Trajectories(
        zeros[..., :4],
        zeros[..., :2],
        torch.ones(B, K, dtype=torch.float64),
        Told.of(situation),
        *(torch.from_numpy(part) for part in (situation.static, situation.kinetic, situation.gravity)),
        *(torch.from_numpy(part) for part in (situation.jerk, situation.speed, situation.height)),
        start=zeros[:, 0],
        push=zeros[:, 0],
        noise=zeros[None],
    )


def price(states=None, u=None, drawn=None, **columns):
    """Return what pans that keep these columns of their states for all of the time cost more than pans at rest."""
    drawn = drawn or trajectories()
    zeros = torch.zeros(B, K, 10, dtype=torch.float64)
    moved = Moved(zeros.clone(), torch.zeros(B, K, 3, dtype=torch.float64) if u is None else u)
    names = ("x", "y", "z", "vx", "vy", "vz", "px", "py", "wx", "wy")
    for name, value in columns.items():
        moved.states[..., names.index(name)] = value
    errors = tracking_errors(moved, drawn)
    rest = Moved(zeros, torch.zeros_like(moved.u))
    return (loss(moved, drawn, errors, CONFIG) - loss(rest, drawn, tracking_errors(rest, drawn), CONFIG)).item()


def test_error_is_the_root_mean_square_of_samples_that_count():
    drawn = trajectories()
    drawn.mask[:, K // 2 :] = 0.0
    moved = Moved(torch.zeros(B, K, 10, dtype=torch.float64), torch.zeros(B, K, 3, dtype=torch.float64))
    moved.states[:, : K // 2, 6] = 0.003
    moved.states[:, : K // 2, 7] = -0.004
    moved.states[:, K // 2 :, 6] = 1.0
    assert tracking_errors(moved, drawn).tolist() == pytest.approx([0.005] * B, rel=1e-3)


def test_large_error_is_not_as_much_dearer_as_it_is_larger():
    small, large = price(px=0.001), price(px=0.1)
    assert small > 0.5
    assert small < large < 30 * small


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ({"x": 0.19}, {"x": 0.21}),
        ({"y": -0.19}, {"y": -0.21}),
        ({"x": 0.1, "vx": 1.0}, {"x": 0.19, "vx": 1.0}),  # would have to stop
        ({"z": 0.09}, {"z": 0.11}),
        ({"z": -0.09}, {"z": -0.11}),
        ({"z": 0.05, "vz": 0.8}, {"z": 0.09, "vz": 0.8}),
        ({"x": -0.19, "vx": 1.0}, {"x": -0.19, "vx": -1.0}),  # comes back, goes out
    ],
)
def test_being_out_of_reach_or_height_costs_what_being_inside_does_not(inside, outside):
    assert price(**inside) == pytest.approx(0.0, abs=1e-9)
    assert price(**outside) > 1.0


def test_speed_in_space_has_a_limit():
    slow = {"x": -0.1, "vx": 0.9, "vz": 0.0}
    drawn = trajectories(speed=1.0)
    assert price(drawn=drawn, **slow) == pytest.approx(0.0, abs=1e-9)
    assert price(drawn=drawn, **(slow | {"vx": 1.2})) > 1.0


def test_change_of_acceleration_costs_and_more_beyond_the_jerk_limit():
    ramp = torch.arange(K, dtype=torch.float64)[None, :, None] * torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    within, beyond = (price(u=(step * ramp).expand(B, -1, -1), drawn=trajectories(jerk=5_000.0)) for step in (2.0, 6.0))
    share = (K - 1) / K
    assert within == pytest.approx(share * CONFIG.gamma * 2.0, rel=1e-3)
    assert beyond == pytest.approx(share * (CONFIG.gamma * 6.0 + CONFIG.jerk_price * (6.0 - 4.0)), rel=1e-3)


def test_pan_at_rest_has_a_finite_gradient():
    states = torch.zeros(B, K, 10, dtype=torch.float64, requires_grad=True)
    u = torch.zeros(B, K, 3, dtype=torch.float64, requires_grad=True)
    drawn = trajectories(height=0.0)
    moved = Moved(states, u)
    loss(moved, drawn, tracking_errors(moved, drawn), CONFIG).backward()
    assert torch.isfinite(states.grad).all()
    assert torch.isfinite(u.grad).all()


def test_farthest_is_in_the_plane():
    moved = Moved(torch.zeros(B, K, 10, dtype=torch.float64), torch.zeros(B, K, 3, dtype=torch.float64))
    moved.states[0, 3, :3] = torch.tensor([0.03, -0.04, 1.0])
    assert farthest(moved).tolist() == pytest.approx([0.05, 0.0])
    assert REACH == 0.2

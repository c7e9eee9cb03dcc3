"""The network at work at 1 kHz: instants, limits, and the law in SI."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.friction import Friction
from runtime.network.units import CHUNK
from runtime.physics.law import DT, slide_batch
from runtime.physics.pan import integrate_pan
from train.config import load_config
from train.network.real_time import PanLimits, follow, to_milliseconds
from train.network.recipe import NetworkRecipe

NETWORK = NetworkRecipe(load_config("smoke")).build()
FRICTION = Friction(0.3, 0.2)


@pytest.mark.parametrize("step", [1.0, 1.7, 5.0])
def test_accelerations_that_rise_evenly_do_so_in_milliseconds_too(step):
    slope = np.array([1.0, -2.0, 0.5])
    middles = step * (np.arange(CHUNK) + 0.5)
    answer = (slope * middles[:, None])[None]
    last = slope[None] * -0.5
    count = int((CHUNK - 0.5) * step)
    got = to_milliseconds(answer, last, step, count)
    np.testing.assert_allclose(got[0], slope * (np.arange(count) + 0.5)[:, None], atol=1e-9)


def test_samples_of_a_millisecond_are_what_they_are():
    rng = np.random.default_rng(0)
    answer = rng.normal(0, 5, (2, CHUNK, 3))
    np.testing.assert_allclose(to_milliseconds(answer, np.zeros((2, 3)), 1.0, CHUNK), answer, atol=1e-12)


@pytest.mark.parametrize("step", [0.3, 1.7])
def test_last_acceleration_is_held_beyond_the_samples(step):
    answer = np.ones((1, CHUNK, 3)) * np.array([1.0, 2.0, 3.0])
    got = to_milliseconds(answer, answer[:, 0], step, int(CHUNK * step) + 4)
    np.testing.assert_allclose(got[0], answer[0, :1].repeat(got.shape[1], axis=0), atol=1e-12)


def test_fast_network_keeps_the_change_of_velocity():
    answer = np.random.default_rng(0).normal(0, 5, (2, CHUNK, 3))
    got = to_milliseconds(answer, np.zeros((2, 3)), 0.25, CHUNK // 4)
    np.testing.assert_allclose(got.sum(axis=1), 0.25 * answer.sum(axis=1), atol=1e-12)


def commands(samples=700):
    t = np.linspace(0.0, 1.0, samples)
    way = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
    return np.stack([way[:, None] * goal for goal in ((0.05, 0.02), (-0.03, 0.08))])


@pytest.mark.parametrize("limits", [PanLimits(0.2, 9.0, 4_500.0, 0.2, 0.1), PanLimits(0.05, 30.0, 10_000.0)])
@pytest.mark.parametrize("executed", [0.3, 1.0])
def test_motion_is_the_laws_and_keeps_acceleration_jerk_and_speed(limits, executed):
    position = commands()
    found = follow(NETWORK, position, limits, FRICTION, FRICTION, executed=executed)
    assert found.acceleration.shape == (2, 700, 3)
    start = np.concatenate([position[:, 0], np.zeros((2, 2))], axis=1)
    np.testing.assert_allclose(
        found.sliding, slide_batch(start, found.acceleration, FRICTION.static, FRICTION.kinetic), atol=1e-9
    )
    np.testing.assert_allclose(found.pan, integrate_pan(np.zeros((2, 6)), found.acceleration), atol=1e-9)
    size = np.linalg.norm(found.acceleration, axis=-1)
    change = np.linalg.norm(np.diff(found.acceleration, axis=1), axis=-1)
    assert 0.0 < size.max() <= limits.acceleration * (1 + 1e-9)
    assert np.linalg.norm(found.pan[..., 3:], axis=-1).max() <= limits.speed * (1 + 1e-9)
    assert bool(found.acceleration[..., 2].any()) == (limits.height > 0.0)
    if np.isinf(limits.speed):
        assert change.max() <= limits.jerk * DT * (1 + 1e-9)


def test_what_is_told_makes_a_difference_and_what_is_not_does_not():
    position = commands(300)
    limits = PanLimits(0.2, 9.0, 4_500.0)
    plans = [follow(NETWORK, position, limits, FRICTION, told).acceleration for told in (None, FRICTION)]
    assert (plans[0] != plans[1]).any()


def test_command_longer_than_a_window_is_followed_to_its_end():
    position = np.concatenate([commands(300), np.repeat(commands(300)[:, -1:], 1_700, axis=1)], axis=1)
    found = follow(NETWORK, position, PanLimits(0.05, 40.0, 10_000.0), FRICTION, FRICTION)
    assert found.acceleration.shape == (2, 2_000, 3)
    assert np.isfinite(found.sliding).all()


def test_pan_with_a_quarter_of_the_reach_does_the_same_twice_as_fast():
    """All of it scales, jerk and speed too; the friction and the acceleration limit stay."""
    slow = commands(1_200)
    fast = np.stack([each[::2] for each in slow]) / 4.0
    # Instants of one and of the other: a sample of the slow pan's network is 1.67 ms, of the fast one's 0.83.
    large = follow(NETWORK, slow, PanLimits(0.2, 9.0, 4_500.0), FRICTION, FRICTION)
    small = follow(NETWORK, fast, PanLimits(0.05, 9.0, 9_000.0), FRICTION, FRICTION)
    at_once = np.linalg.norm(4.0 * small.pan[:, :300, :2] - large.pan[:, 1:600:2, :2], axis=-1)
    assert at_once.max() < 0.1 * np.linalg.norm(large.pan[..., :2], axis=-1).max()

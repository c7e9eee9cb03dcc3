"""The command trajectories: bounds, starts, symmetry, and that the controlled slide slides."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.physics.law import DT, GRAVITY
from train.commands.families import FAMILIES, free_commands, scale, soft_start, turn
from train.paper.controlled_slide import physics_commands

REACH = (0.01, 0.15)
SPEED = 0.7


def draw(family, seed=0, batch=32, samples=800, shorten=100):
    rng = np.random.default_rng(seed)
    return free_commands(rng, batch, samples, {family: 1.0}, REACH, SPEED, shorten)


@pytest.mark.parametrize("family", FAMILIES)
def test_family_keeps_to_reach_and_speed_and_starts_at_the_origin(family):
    commands = draw(family)
    assert commands.position.shape == (32, 800, 2)
    assert np.isfinite(commands.position).all()
    assert (commands.position[:, 0] == 0).all()
    assert np.linalg.norm(commands.position, axis=-1).max() <= REACH[1] + 1e-12
    assert np.linalg.norm(np.diff(commands.position, axis=1), axis=-1).max() <= SPEED * DT + 1e-12
    moving = np.linalg.norm(commands.position, axis=-1).max(axis=1) > 1e-3
    assert moving.mean() > 0.9


@pytest.mark.parametrize("family", FAMILIES)
def test_family_is_drawn_alike_from_the_same_seed_and_otherwise_from_another(family):
    assert np.array_equal(draw(family, 1).position, draw(family, 1).position)
    assert not np.array_equal(draw(family, 1).position, draw(family, 2).position)


def test_half_of_the_commands_end_early_and_are_held():
    commands = draw("drawings", batch=400)
    early = commands.samples < 800
    assert 0.35 < early.mean() < 0.65
    assert commands.samples.min() > 700
    for position, end in zip(commands.position[early], commands.samples[early], strict=True):
        assert (position[end:] == position[end - 1]).all()


def test_families_are_mixed_by_their_shares():
    rng = np.random.default_rng(0)
    commands = free_commands(rng, 300, 600, {"creeps": 3.0, "loops": 1.0}, REACH, SPEED, 1)
    speed = np.linalg.norm(np.diff(commands.position, axis=1), axis=-1).max(axis=1) / DT
    assert (speed <= 0.1 * SPEED + 1e-9).mean() == pytest.approx(0.75, abs=0.1)
    with pytest.raises(KeyError):
        free_commands(rng, 4, 600, {"zigzag": 1.0}, REACH, SPEED, 1)


def test_scaling_leaves_a_command_that_does_not_move_at_rest():
    still = np.full((2, 50, 2), 0.3)
    assert (scale(still, np.array([0.1, 0.1]), SPEED) == 0).all()


def test_turning_keeps_lengths_and_has_no_preferred_direction():
    rng = np.random.default_rng(0)
    line = np.zeros((2000, 2, 2))
    line[:, 1, 0] = 1.0
    turned = turn(rng, line)[:, 1]
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0)
    assert np.linalg.norm(turned.mean(axis=0)) < 0.1


def test_soft_start_rises_from_zero_to_one():
    factor = soft_start(500, np.array([0.1, 0.3]))
    assert (factor[:, 0] == 0).all()
    assert (np.diff(factor, axis=1) >= -1e-12).all()
    assert factor[0, 100] == pytest.approx(1.0)
    assert factor[1, 150] == pytest.approx(0.5)


def test_controlled_slide_slides_and_its_pan_motion_explains_it():
    rng = np.random.default_rng(0)
    commands = physics_commands(rng, 16, 1200, (0.15, 0.4), (0.03, 0.15), 1.0, 0.5)
    assert commands.pan_position is not None
    speed = np.linalg.norm(np.diff(commands.position, axis=1), axis=-1)
    assert (speed > 0).mean() > 0.99
    assert np.linalg.norm(commands.pan_position, axis=-1).max() > 1.0
    # While it slides, friction alone accelerates the object in the world: by mu' g, whatever the pan does.
    world = commands.position + commands.pan_position
    acceleration = np.linalg.norm(np.diff(world, 2, axis=1), axis=-1) / DT**2
    assert np.median(acceleration) == pytest.approx(0.5 * GRAVITY, rel=1e-3)

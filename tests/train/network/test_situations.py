"""What a training step of the network for every pan is made of."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from runtime.errors import InputError
from runtime.limits import WEIGHT_KEPT
from runtime.network.units import ACCELERATION, CHUNK, LEAST_JERK
from train.config import load_config
from train.network.config import GROUPS
from train.network.recipe import NetworkRecipe
from train.network.situations import draw_executed, draw_situation, strongest_friction

CONFIG = load_config("smoke").model_copy(update={"batch": 64, "trajectories": 64})
RECIPE = NetworkRecipe(CONFIG)
STEPS = 100


PARTS = (
    "command",
    "object_position",
    "mask",
    "static",
    "kinetic",
    "gravity",
    "jerk",
    "speed",
    "height",
    "start",
    "push",
)


def test_step_is_drawn_the_same_again_and_by_whoever_draws_its_rows():
    whole, again, half = (RECIPE.draw(70, STEPS, rows) for rows in (slice(0, 64), slice(0, 64), slice(32, 64)))
    assert whole.step == again.step == half.step
    for name in PARTS:
        mine = getattr(whole.trajectories, name)
        assert torch.equal(getattr(again.trajectories, name), mine)
        assert torch.equal(getattr(half.trajectories, name), mine[32:])
    assert torch.equal(half.trajectories.noise, whole.trajectories.noise[:, 32:])
    assert torch.equal(half.trajectories.told.conditions, whole.trajectories.told.conditions[32:])


def test_every_step_and_every_group_has_trajectories_of_its_own():
    friction = [RECIPE.draw(step, STEPS, slice(0, 64)).trajectories.static for step in (70, 71)]
    rows = torch.cat(friction)
    assert len(torch.unique(rows[rows != 1.0])) == (rows != 1.0).sum()


def test_rows_that_are_not_whole_groups_are_refused():
    with pytest.raises(InputError, match="8 groups cannot be shared evenly"):
        RECIPE.draw(0, STEPS, slice(0, 20))


def situations(progress, count=4_000, **changes):
    return draw_situation(CONFIG.model_copy(update=changes), progress, count, np.random.default_rng(0))


def test_friction_grows_from_a_twentieth_to_all_of_it():
    first, half, whole = (situations(progress, eased=0.2) for progress in (0.0, 0.1, 0.2))
    np.testing.assert_allclose(first.static, 0.05 * whole.static)
    np.testing.assert_allclose(half.kinetic, 0.525 * whole.kinetic)
    assert whole.static.max() > 1.0


def test_every_pan_can_break_its_object_away():
    found = situations(1.0)
    angle = np.linspace(0.0, 0.5 * np.pi, 400)[:, None]
    down = np.minimum(ACCELERATION * np.sin(angle), (1.0 - WEIGHT_KEPT) * found.gravity) * (found.height > 0.0)
    along = np.sqrt(ACCELERATION**2 - down**2)
    assert (along - found.static * (found.gravity - down)).max(axis=0).min() > 0.0
    assert (found.kinetic <= found.static).all()


def test_pans_are_as_the_configuration_has_them():
    found = situations(1.0, level=0.5, told=0.5)
    assert 0.45 < (found.height == 0.0).mean() < 0.55
    assert 0.45 < found.told.mean() < 0.55
    assert found.jerk.min() >= LEAST_JERK * 0.999
    nominal = (found.static == 1.0) & (found.kinetic == 0.5)
    assert 0.05 < nominal.mean() < 0.25


@pytest.mark.parametrize("lifts", [False, True])
def test_strongest_friction_is_the_one_that_the_whole_acceleration_just_breaks(lifts):
    gravity = np.array([30.0, 60.0])
    static = strongest_friction(gravity, np.array([lifts, lifts]), drive=1.0)
    angle = np.linspace(0.0, 0.5 * np.pi, 10_000)[:, None] * lifts
    most = (ACCELERATION * np.cos(angle) - static * (gravity - ACCELERATION * np.sin(angle))).max(axis=0)
    np.testing.assert_allclose(most, 0.0, atol=1e-3)


def test_decoder_is_asked_again_after_what_was_executed():
    rng = np.random.default_rng(0)
    for _ in range(50):
        executed = draw_executed(512, rng)
        assert sum(executed) == 512
        assert max(executed) <= CHUNK
        assert min(executed[:-1]) >= 16


def test_trajectories_are_disturbed_late_in_the_run_only():
    early, late = (RECIPE.draw(step, STEPS, slice(0, 64)).trajectories for step in (10, 90))
    for name in ("start", "push", "noise"):
        assert not getattr(early, name).any()
        assert getattr(late, name).any()
    assert not late.push[:, :6].any()  # the object's alone


def test_commands_of_later_groups_are_faster():
    speed = [
        torch.linalg.vector_norm(RECIPE.draw(step, STEPS, slice(0, 64)).trajectories.command[..., 2:], dim=-1).amax(1)
        for step in range(20)
    ]
    by_group = torch.stack(speed).reshape(20, GROUPS, -1).amax(dim=(0, 2))
    assert by_group[0] < by_group[-1]
    assert by_group.max() <= 1.2 * CONFIG.speed[1]

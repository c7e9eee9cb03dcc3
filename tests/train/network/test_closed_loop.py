"""Decoding in closed loop: the states are those of the law, whenever the decoder is asked."""

from __future__ import annotations

import pytest
import torch

from runtime.network.units import CHUNK
from train.config import load_config
from train.network.closed_loop import decode
from train.network.recipe import NetworkRecipe
from train.network.situations import Step
from train.physics.rollout import rollout

CONFIG = load_config("smoke").model_copy(update={"displaced": 1.0, "pushed": 1.0, "noisy": 0.0})
RECIPE = NetworkRecipe(CONFIG)


def drawn(executed, reread=None, pushed_at=0):
    samples = sum(executed)
    part = RECIPE.draw(90, 100, slice(0, 16)).trajectories
    noise = part.noise.new_zeros(len(executed), 16, *part.noise.shape[2:])
    cut = {name: getattr(part, name)[:, :samples] for name in ("command", "object_position", "mask")}
    return part._replace(noise=noise, **cut), Step(samples, executed, reread, pushed_at)


def test_motion_is_what_the_law_makes_of_the_accelerations():
    trajectories, step = drawn((CHUNK, CHUNK, 32, 32, CHUNK))
    moved = decode(RECIPE.build(), trajectories, step)
    law = trajectories.static, trajectories.kinetic, trajectories.gravity
    assert torch.equal(moved.states, rollout(trajectories.start, moved.u, *law))
    assert torch.linalg.vector_norm(moved.u, dim=-1).max() > 0.0


def test_object_is_pushed_at_its_instant_and_nothing_else_is():
    trajectories, step = drawn((CHUNK,) * 4, pushed_at=100)
    network = RECIPE.build()
    pushed = decode(network, trajectories, step).states
    left_alone = decode(network, trajectories, step._replace(pushed_at=0)).states
    assert torch.equal(pushed[:, :100], left_alone[:, :100])
    law = trajectories.static, trajectories.kinetic, trajectories.gravity
    u = decode(network, trajectories, step).u
    assert torch.equal(pushed[:, 100:101], rollout(pushed[:, 99] + trajectories.push, u[:, 100:101], *law))
    assert (pushed[:, 100, 6:] != left_alone[:, 100, 6:]).any()


def test_decoder_asked_early_answers_to_what_is_by_then():
    """The first question is the same; the second comes half a chunk in, and its answer is another."""
    network = RECIPE.build()
    late, early = (decode(network, *drawn(executed)).u for executed in ((CHUNK, CHUNK), (CHUNK // 2,) * 4))
    assert torch.equal(early[:, : CHUNK // 2], late[:, : CHUNK // 2])
    assert (early[:, CHUNK // 2 : CHUNK] != late[:, CHUNK // 2 : CHUNK]).any()


def test_command_read_anew_changes_only_what_comes_after():
    network = RECIPE.build()
    once, anew = (decode(network, *drawn((CHUNK,) * 4, reread)).u for reread in (None, 2))
    assert torch.equal(once[:, : 2 * CHUNK], anew[:, : 2 * CHUNK])
    assert (once[:, 2 * CHUNK :] != anew[:, 2 * CHUNK :]).any()


@pytest.mark.parametrize("executed", [(CHUNK,) * 4, (48, 16, 64, 64, 64)])
def test_gradient_reaches_every_weight(executed):
    network = RECIPE.build()
    moved = decode(network, *drawn(executed, reread=1))
    moved.states.square().sum().backward()
    assert all(weight.grad is not None and weight.grad.abs().max() > 0 for weight in network.parameters())

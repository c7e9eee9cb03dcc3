"""The batches of training: where their trajectories begin and what the network sees."""

import numpy as np
import pytest
import torch

from train.batches.batches import draw
from train.batches.mid_course import disturb
from train.config import TrainConfig, load_config
from train.curriculum import CURRICULA, task_at
from train.network.checkpoint import build_model
from train.physics.closed_loop import decode


def disturbed(**shares):
    """The smoke configuration with every trajectory of stage 5 disturbed in the ways given, and that stage's task."""
    config = TrainConfig.model_validate(load_config("smoke").model_dump() | shares)
    return config, task_at(CURRICULA[config.curriculum], "A", config.epochs, config.epochs)


def test_mid_course_batch_begins_where_the_network_led_it():
    config, task = disturbed(lead_in=1.0, lead_in_chunks=(2, 2))
    drawn = draw(config, task, np.random.default_rng(0))
    model = build_model(config)
    whole, batch = drawn.batch, disturb(model, drawn.batch, drawn.disturbance)
    mark = whole.command[:, 200, :2]
    assert batch.command.shape[1] == whole.command.shape[1] - 200
    assert torch.allclose(batch.command[:, 0, :2], torch.zeros_like(mark))
    assert torch.allclose(batch.object_position + mark[:, None], whole.object_position[:, 200:])
    motion = decode(model, whole.command, whole.static, whole.kinetic)
    led = motion.states[:, 100:200].detach()
    assert torch.allclose(batch.before[..., :4], led[..., :4])
    assert torch.allclose(batch.before[..., 4:6] + mark[:, None], led[..., 4:6])
    assert torch.equal(batch.noise, torch.zeros_like(batch.noise))


def test_displaced_trajectories_begin_off_the_centre_and_off_their_mark():
    config, task = disturbed(displaced=1.0)
    drawn = draw(config, task, np.random.default_rng(0))
    batch = disturb(build_model(config), drawn.batch, drawn.disturbance)
    assert (batch.before == batch.before[:, :1]).all()
    reach = torch.linalg.vector_norm(batch.before[:, -1, :2], dim=-1)
    assert ((reach > 0.0) & (reach <= config.start_reach)).all()
    assert (batch.before[:, -1, 4:6] != 0.0).all()


def test_trajectories_in_mid_course_were_displaced_where_their_lead_in_began_and_pushed_where_it_ended():
    config, task = disturbed(lead_in=1.0, lead_in_chunks=(2, 2), displaced=1.0)
    drawn = draw(config, task, np.random.default_rng(0))
    whole, (_, start, push, _) = drawn.batch, drawn.disturbance
    assert (start[:, :2] != 0.0).all()
    assert (push[:, 4:6] != 0.0).all()
    assert (push[:, :4] == 0.0).all()
    model = build_model(config)
    batch = disturb(model, whole, drawn.disturbance)
    led = decode(model, whole.command, whole.static, whole.kinetic, before=held(start, config.chunk)).states
    pushed = led[:, 199, 4:].detach() + torch.from_numpy(push[:, 4:])
    pushed[:, :2] -= whole.command[:, 200, :2]
    assert torch.allclose(batch.before[:, -1, 4:], pushed)
    assert torch.allclose(batch.before[:, -1, :4], led[:, 199, :4].detach())


def held(state, chunk):
    """The states (B, C, 8) of trajectories that were in one state for a chunk."""
    return torch.from_numpy(state)[:, None].expand(-1, chunk, -1)


@pytest.mark.parametrize(("share", "least", "most"), [(0.0, 0, 0), (0.5, 60, 140), (1.0, 200, 200)])
def test_share_of_the_trajectories_that_vary_friction_has_the_nominal_one(share, least, most):
    config = TrainConfig.model_validate(
        load_config("smoke").model_dump() | {"nominal": share, "batch": 200, "trajectories": 200}
    )
    task = task_at(CURRICULA[config.curriculum], "A", config.epochs, config.epochs)
    batch = draw(config, task, np.random.default_rng(0)).batch
    nominal = (batch.static == config.static) & (batch.kinetic == config.kinetic)
    assert least <= int(nominal.sum()) <= most
    assert bool((batch.kinetic <= batch.static).all())


def test_configuration_without_shares_disturbs_nothing():
    config, task = disturbed()
    assert task.disturbed
    assert draw(config, task, np.random.default_rng(0)).disturbance is None


def test_noise_is_seen_but_does_not_move_anything():
    config, task = disturbed(noisy=1.0)
    drawn = draw(config, task, np.random.default_rng(0))
    batch = disturb(build_model(config), drawn.batch, drawn.disturbance)
    assert batch.noise[..., [0, 1, 4, 5]].std().item() == pytest.approx(config.noise[0], rel=0.05)
    assert batch.noise[..., [2, 3, 6, 7]].std().item() == pytest.approx(config.noise[1], rel=0.05)
    model = build_model(config)
    law = batch.static, batch.kinetic
    plain, noisy = (decode(model, batch.command, *law, noise=noise) for noise in (None, batch.noise))
    assert torch.equal(plain.u[:, :100], noisy.u[:, :100])
    assert not torch.equal(plain.u[:, 100:200], noisy.u[:, 100:200])

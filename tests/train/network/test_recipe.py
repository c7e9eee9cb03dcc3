"""Training the network: it learns, resumes, and is told apart from the paper's."""

from __future__ import annotations

import shutil

import pytest
import torch

from runtime.errors import InputError
from train.config import load_config
from train.learn.checkpoint import load_checkpoint
from train.learn.optimizer import Optimizer
from train.learn.trainer import Trainer
from train.network.config import Restart
from train.network.recipe import NetworkRecipe, load_network


@pytest.fixture(scope="module")
def smoke_run(tmp_path_factory):
    """A run of smoke, with a copy of its folder as it was after epoch 6, and the steps it reported."""
    folder, steps = tmp_path_factory.mktemp("run"), []
    trainer = Trainer(load_config("smoke"), folder)
    save = trainer.save

    def save_and_keep():
        save()
        if trainer.epoch == 6:
            shutil.copytree(folder, folder / "half", ignore=shutil.ignore_patterns("tensorboard", "half"))

    trainer.save = save_and_keep
    trainer.train(steps.append)
    return folder, trainer, steps


def test_run_goes_through_all_stages(smoke_run):
    _, trainer, steps = smoke_run
    assert len(steps) == trainer.steps
    assert [step.stage for step in steps] == sorted(step.stage for step in steps)
    assert {step.stage for step in steps} == {1, 2, 3, 4}
    assert trainer.skipped == 0
    assert set(trainer.validation) == {
        f"{pan}_{figure}"
        for pan in ("30_level", "30_lifting", "9_level", "9_lifting")
        for figure in ("tracking", "reach")
    }


def test_resumed_run_is_the_same_to_the_last_bit(smoke_run):
    folder, trainer, steps = smoke_run
    again, reported = Trainer(load_config("smoke"), folder / "half"), []
    again.resume(load_checkpoint(folder / "half"))
    again.train(reported.append)
    assert [step.loss for step in reported] == [step.loss for step in steps[-len(reported) :]]
    for name, weight in trainer.model.state_dict().items():
        assert torch.equal(weight, again.model.state_dict()[name]), name


def test_it_learns_to_follow_where_pans_are_slippery():
    """Where every run begins; the same batch again and again, with a new network."""
    recipe = NetworkRecipe(load_config("smoke").model_copy(update={"told": 1.0}))
    network = recipe.build()
    decoding, part = recipe.decoding(network), recipe.draw(0, 1_000, slice(0, 16))
    optimizer = Optimizer(network, "muon", 3e-3)
    errors = []
    for _ in range(60):
        found = recipe.outcome(decoding, part, torch.device("cpu"))
        optimizer.zero_grad()
        found.loss.backward()
        optimizer.step()
        errors.append(found.error.item())
    assert min(errors[-10:]) < 0.6 * errors[0]


def test_network_is_read_from_its_checkpoint_and_from_no_other(smoke_run, tmp_path):
    folder, trainer, _ = smoke_run
    _, network = load_network(load_checkpoint(folder))
    for name, weight in trainer.evaluated_model().state_dict().items():
        assert torch.equal(weight, network.state_dict()[name])
    Trainer(load_config("paper", units=8, batch=8, trajectories=8), tmp_path).save()
    with pytest.raises(InputError, match="the paper's own network"):
        load_network(load_checkpoint(tmp_path))


RESTART = Restart(after=0.6, learning_rate=1e-3, gamma=0.1, robust=0.07)
LAST = Restart(after=0.8, learning_rate=5e-4, gamma=0.05, robust=0.0)


def test_learning_rate_rises_and_falls_in_each_part_of_a_run():
    changes = {"warm_up": 4, "learning_rate": 2e-3, "restarts": (RESTART, LAST)}
    recipe = NetworkRecipe(load_config("smoke").model_copy(update=changes))
    rates = [recipe.learning_rate(step, 1000) for step in range(1000)]
    assert rates[3] == max(rates) == pytest.approx(2e-3, rel=1e-3)
    assert rates[603] == max(rates[600:]) == pytest.approx(1e-3, rel=1e-3)
    assert rates[803] == max(rates[800:]) == pytest.approx(5e-4, rel=1e-3)
    for first, last in ((3, 600), (603, 800), (803, 1000)):
        assert rates[first:last] == sorted(rates[first:last], reverse=True)
        assert rates[last - 1] == pytest.approx(recipe.config.final_learning_rate, rel=0.1)


def test_prices_change_with_each_part():
    config = load_config("smoke").model_copy(update={"restarts": (RESTART, LAST)})
    drawn = [NetworkRecipe(config).draw(step, 10, slice(0, 16)).config for step in (0, 5, 6, 7, 8, 9)]
    prices = [(config.gamma, config.robust)] * 2 + [(0.1, 0.07)] * 2 + [(0.05, 0.0)] * 2
    assert [(each.gamma, each.robust) for each in drawn] == prices


def test_price_on_changes_of_acceleration_is_that_of_the_step():
    """Of one batch, once with and once without it."""
    free = RESTART.model_copy(update={"gamma": 0.0})
    losses = []
    for restart in (RESTART, free):
        recipe = NetworkRecipe(load_config("smoke").model_copy(update={"restarts": (restart,)}))
        part = recipe.draw(9, 10, slice(0, 16))
        losses.append(recipe.outcome(recipe.decoding(recipe.build()), part, torch.device("cpu")).loss.item())
    assert losses[0] > losses[1]

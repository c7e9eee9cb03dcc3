"""Training the paper's network: it learns, and is not exported."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from export.write_bundle import export_bundle
from runtime.errors import InputError
from train.config import load_config
from train.learn.checkpoint import load_checkpoint
from train.learn.trainer import Trainer
from train.paper.batches import draw
from train.paper.curriculum import task_at
from train.paper.recipe import build_network, load_network

SMALL = {
    "units": 16, "epochs": 10, "trajectories": 16, "batch": 8, "samples": (200, 400), "threads": 1,
    "precision": "float32",
}  # fmt: skip


def config_of(**changes):
    return load_config("paper", **SMALL | changes)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder, steps = tmp_path_factory.mktemp("paper"), []
    Trainer(config_of(), folder).train(steps.append)
    return folder, steps


def test_run_goes_through_the_stages_and_changes_every_weight(run):
    folder, steps = run
    assert [steps[i].stage for i in (0, -1)] == [1, 5]
    fresh = build_network(config_of()).state_dict()
    config, network = load_network(load_checkpoint(folder))
    assert config == config_of()
    for name, tensor in network.state_dict().items():
        assert not torch.equal(tensor, fresh[name]), name


def test_pan_is_learned_in_stage_1(tmp_path):
    """Model C: after a hundred steps of L' the pan is much nearer to the one that generated the command."""
    steps = []
    Trainer(config_of(model="C", epochs=4, trajectories=200, learning_rate=3e-3), tmp_path).train(steps.append)
    first, last = (sum(step.loss for step in part) / len(part) for part in (steps[:10], steps[-10:]))
    assert last < 0.1 * first


def test_batches_are_what_the_stage_says():
    config = config_of()
    for epoch, physics in ((1, True), (10, False)):
        drawn = draw(config, task_at("A", epoch, 10), np.random.default_rng(0))
        assert drawn.pan_loss == physics
        assert (drawn.batch.pan_position is not None) == physics
        assert drawn.batch.command.shape[1] % config.chunk == 0
        assert (drawn.batch.static == 1.0).all()
        assert (drawn.batch.kinetic == 0.5).all()


def test_papers_network_is_no_bundle(run, tmp_path):
    with pytest.raises(InputError, match="a run of the paper's own network is only evaluated:  slide-eval"):
        export_bundle(run[0], tmp_path / "bundle")
    assert not (tmp_path / "bundle").exists()

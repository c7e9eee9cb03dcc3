"""Weights to begin with: of a run, of a bundle that has them, and of nothing else."""

from __future__ import annotations

import pytest
import torch

from export.hub import float_weights, publish
from export.write_bundle import export_bundle
from runtime.errors import InputError
from runtime.network.bundle import SHIPPED, Bundle
from train.config import load_config
from train.learn.checkpoint import load_checkpoint
from train.learn.trainer import Trainer
from train.learn.warm_start import begin_with


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    Trainer(load_config("smoke"), folder).save()
    return folder


def test_run_begins_with_the_weights_of_another_and_says_so(run, tmp_path):
    trainer, other = Trainer(load_config("smoke", seed=5), tmp_path / "new"), Trainer(load_config("smoke"), run)
    begin_with(trainer, run)
    for network in (trainer.model, trainer.average.module):
        for name, weight in network.state_dict().items():
            assert torch.equal(weight, other.model.state_dict()[name])
    trainer.save()
    export_bundle(tmp_path / "new", tmp_path / "bundle")
    training = Bundle.load(tmp_path / "bundle").manifest.training
    assert training["command"] == "slide-train smoke --init smoke"
    assert training["began_with"] == load_checkpoint(tmp_path / "new")["began_with"] == trainer.began_with


def test_published_bundle_has_weights_to_begin_with(run, tmp_path):
    pytest.importorskip("safetensors")
    export_bundle(run, tmp_path / "bundle")
    publish(tmp_path / "bundle", tmp_path / "hub", float_weights(run))
    trainer = Trainer(load_config("smoke", seed=5), tmp_path / "new")
    begin_with(trainer, tmp_path / "hub")
    assert trainer.began_with == {"name": "smoke", "sha256": Bundle.load(tmp_path / "hub").sha256}


def test_what_has_no_such_weights_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"models/default: it has no model.safetensors"):
        begin_with(Trainer(load_config("smoke"), tmp_path), SHIPPED / "default")
    for name, changes in (("smoke", {"units": 24}), ("paper", {"units": 24, "batch": 8, "trajectories": 8})):
        trainer = Trainer(load_config(name, **changes), tmp_path)
        with pytest.raises(InputError, match=r"cannot begin with .*: its decoder_lstm.bias_hh_l0 is of shape"):
            begin_with(trainer, run)

"""Weights to begin with: a run's or a bundle's, and no others."""

from __future__ import annotations

import hashlib

import pytest
import torch

from export.write_bundle import export_bundle
from runtime.errors import FormatError, InputError
from runtime.network.bundle import Bundle
from train.config import load_config
from train.learn.trainer import Trainer
from train.learn.warm_start import begin_with, load_weights
from train.network.checkpoint import build_model, load_checkpoint, load_model


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """An untrained run of the smoke configuration."""
    folder = tmp_path_factory.mktemp("run")
    trainer = Trainer(load_config("smoke"), folder)
    trainer.save()
    return folder, trainer.evaluated_model().state_dict()


def other(**changes):
    return build_model(load_config("smoke", seed=1).model_copy(update=changes))


def test_weights_of_a_run_are_its_networks(run):
    folder, weights = run
    model = other()
    load_weights(model, folder)
    assert all(torch.equal(tensor, weights[name]) for name, tensor in model.state_dict().items())


def test_weights_of_a_bundle_are_its_networks_but_for_the_covariances(run, tmp_path):
    folder, weights = run
    export_bundle(folder, tmp_path / "bundle")
    model, fresh = other(), other().state_dict()
    load_weights(model, tmp_path / "bundle")
    for name, tensor in model.state_dict().items():
        rows = 2 * model.chunk if name.startswith("output") else len(tensor)
        assert torch.equal(tensor[:rows], weights[name][:rows]), name
        assert torch.equal(tensor[rows:], fresh[name][rows:]), name


def test_run_remembers_what_it_began_with_and_its_bundle_tells(run, tmp_path):
    folder, _ = run
    export_bundle(folder, tmp_path / "first")
    sha256 = {
        folder: hashlib.sha256((folder / "checkpoint.pt").read_bytes()).hexdigest(),
        tmp_path / "first": Bundle.load(tmp_path / "first").sha256,
    }
    for number, source in enumerate(sha256):
        trainer = Trainer(load_config("smoke"), tmp_path / f"run{number}")
        begin_with(trainer, source)
        trainer.save()
        resumed = Trainer(load_config("smoke"), tmp_path / f"run{number}")
        resumed.resume(load_checkpoint(tmp_path / f"run{number}"))
        resumed.save()
        manifest = export_bundle(tmp_path / f"run{number}", tmp_path / f"bundle{number}").manifest
        assert manifest.training["began_with"] == {"name": "smoke", "sha256": sha256[source]}
        assert manifest.training["command"] == "slide-train smoke --init smoke"


def test_wider_network_computes_what_the_narrower_did_and_can_learn_more(run, tmp_path):
    folder, _ = run
    narrow = load_model(load_checkpoint(folder))[1]
    export_bundle(folder, tmp_path / "bundle")
    commands, motion = torch.randn(3, 4, 400), torch.randn(3, 100, 8)
    for source, units in ((folder, 24), (tmp_path / "bundle", 400)):  # 400 values are a chunk of a command, too
        wide = other(units=units)
        load_weights(wide, source)
        found, grown = [
            model.decoder(commands).step(0, motion, model.encode(commands))[0].acceleration for model in (narrow, wide)
        ]
        torch.testing.assert_close(grown, found, rtol=1e-5, atol=1e-5)
        grown.square().sum().backward()
        assert wide.feedforward.weight.grad is not None
        assert bool((wide.feedforward.weight.grad[:, 16:] != 0.0).all())


def test_narrower_or_deeper_network_is_refused(run, tmp_path):
    folder, _ = run
    export_bundle(folder, tmp_path / "bundle")
    for source in (folder, tmp_path / "bundle"):
        with pytest.raises(InputError, match=r"weight_ih_l0 is of shape \(64, 400\), this network's is \(32, 400\)"):
            load_weights(other(units=8), source)
        with pytest.raises(InputError, match="weight_ih_l2 is missing"):
            load_weights(other(layers=3), source)
        with pytest.raises(InputError, match=r"it has decoder_lstm\.bias_hh_l1, which this network has not"):
            load_weights(other(layers=1), source)


def test_what_is_neither_run_nor_bundle_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no such checkpoint"):
        load_weights(other(), tmp_path)

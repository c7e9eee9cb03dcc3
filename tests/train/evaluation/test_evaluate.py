"""Evaluation knows where a network comes from: a run or a bundle, on how much it was trained, after what."""

from __future__ import annotations

import json

import pytest
import torch

from export.write_bundle import export_bundle
from train.config import load_config
from train.evaluation.evaluate import load_subjects
from train.learn.checkpoint import load_checkpoint
from train.learn.trainer import Trainer


@pytest.fixture
def run(tmp_path):
    """A run of the smoke configuration after two epochs that were not trained, which began with another."""
    trainer = Trainer(load_config("smoke"), tmp_path / "run")
    trainer.epoch = 2
    trainer.save()
    checkpoint = load_checkpoint(tmp_path / "run") | {"began_with": {"name": "base", "sha256": "0" * 64}}
    torch.save(checkpoint, tmp_path / "run" / "checkpoint.pt")
    return tmp_path / "run"


def test_run_and_bundle_say_what_they_were_trained_on(run):
    export_bundle(run, run.parent / "bundle")
    assert load_subjects(run)[0].origin == "64 trajectories, after base; acceleration, jerk and speed held"
    assert load_subjects(run.parent / "bundle", "mine")[0].origin == "64 trajectories, after base; limits in force"


def test_bundle_that_does_not_say_how_it_was_trained_is_evaluated_all_the_same(run):
    export_bundle(run, run.parent / "bundle")
    manifest = run.parent / "bundle" / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"training": {"by": "hand"}}))
    assert load_subjects(run.parent / "bundle")[0].origin == "training unknown; limits in force"

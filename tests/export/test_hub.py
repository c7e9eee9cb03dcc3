"""Bundles as they are published on the Hugging Face hub."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import torch
import yaml

from export.cli import export_main
from export.hub import float_weights, publish
from runtime import Planner
from runtime.network.bundle import SHIPPED, Bundle
from train.config import load_config
from train.learn.checkpoint import load_checkpoint, weights_to_use
from train.learn.trainer import Trainer
from train.learn.weights_file import read_weights

pytest.importorskip("safetensors")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    Trainer(load_config("smoke"), folder).save()
    return folder


@pytest.fixture(scope="module")
def published(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `slide-export --hub` writes of a run."""
    folder = tmp_path_factory.mktemp("hub") / "model"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["slide-export", str(run), "--hub", str(folder)])
        with pytest.raises(SystemExit) as ended:
            export_main()
    assert not ended.value.code
    return folder


def test_repository_is_a_bundle_with_its_facts(published: Path) -> None:
    bundle = Planner(published).bundle
    config = json.loads((published / "config.json").read_text())
    assert config["manifest_sha256"] == bundle.sha256
    assert config["network"]["chunk"] == bundle.manifest.network.chunk
    assert "*.onnx filter=lfs" in (published / ".gitattributes").read_text()


def test_card_has_figures_ranges_limits_licence_and_where_it_fails(published: Path) -> None:
    card = (published / "README.md").read_text()
    manifest = Bundle.load(published).manifest
    front = yaml.safe_load(card.split("---")[1])
    assert (front["license"], front["pipeline_tag"]) == ("mit", "robotics")
    found = {each["dataset"]["name"]: each["metrics"][0]["value"] for each in front["model-index"][0]["results"]}
    tracking = {name: value for name, value in manifest.evaluation.items() if name.endswith("_tracking")}
    assert found == {
        name.removesuffix("_tracking").replace("_", " "): pytest.approx(1e3 * value, abs=0.005)
        for name, value in tracking.items()
    }
    for title in ("What it is for", "What it was trained on", "Where it fails", "Licence and citation"):
        assert f"\n## {title}\n" in card
    for name, (low, high) in manifest.trained_on.items():
        assert f"| {name.replace('_', ' ')} | {low:g} to {high:g}" in card
    for name, value in manifest.limits.to_dict().items():
        assert f"| {name.replace('_', ' ')} | {'none' if value is None else f'{value:g} '}" in card
    assert "10.1109/LRA.2018.2854958" in card


def test_weights_are_those_of_the_run(run: Path, published: Path) -> None:
    saved = load_checkpoint(run)
    weights = weights_to_use(saved, load_config("smoke"))
    found = read_weights(published / "model.safetensors")
    assert found.keys() == weights.keys()
    assert all(torch.equal(found[name], weights[name]) for name in weights)


def test_bundle_in_integers_is_published_without_weights_and_says_so(tmp_path: Path) -> None:
    source = SHIPPED / "default"
    files = publish(source, tmp_path / "hub", float_weights(source))
    assert "model.safetensors" not in files
    assert "no weights in floats" in (tmp_path / "hub" / "README.md").read_text()


def test_somewhere_to_write_must_be_given(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["slide-export", str(run)])
    with pytest.raises(SystemExit) as ended:
        export_main()
    assert ended.value.code == 2
    assert "give the folder of the bundle, -o, or that of a repository, --hub" in capsys.readouterr().err

"""A bundle as models are published on the Hugging Face hub: with a card, its facts, and weights to train on with."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

from torch import Tensor

from export.write_bundle import bundle_folder
from runtime.limits import UNITS
from runtime.network.bundle import Bundle
from runtime.network.manifest import MANIFEST_FILE, TRAINED_ON, Manifest
from runtime.version import __version__
from train.config import read_config
from train.learn.checkpoint import load_checkpoint, weights_to_use
from train.learn.weights_file import WEIGHTS_FILE, write_weights

CARD = "README.md"
CONFIG = "config.json"

LARGE_FILES = "*.onnx filter=lfs diff=lfs merge=lfs -text\n*.safetensors filter=lfs diff=lfs merge=lfs -text\n"
"""Which files git keeps elsewhere."""

CITATION = """@article{kutsuzawa2018sequence,
  title = {Sequence-to-Sequence Model for Trajectory Planning of Nonprehensile Manipulation Including Contact Model},
  author = {Kutsuzawa, Kyo and Sakaino, Sho and Tsuji, Toshiaki},
  journal = {IEEE Robotics and Automation Letters},
  year = {2018},
  doi = {10.1109/LRA.2018.2854958}
}"""

MM = 1e3
"""Millimetres in a metre."""

NO_WEIGHTS = "There are no weights in floats here to train on with."

READABLE = 0o644


def float_weights(source: Path) -> dict[str, Tensor] | None:
    """Return the weights of a run or a checkpoint by torch's names; None if it is a bundle, whose graphs have others.

    Raises:
        FormatError: it is a checkpoint that cannot be read.
    """
    if (source / MANIFEST_FILE).exists():
        return None
    saved = load_checkpoint(source)
    return weights_to_use(saved, read_config(saved["config"]))


def publish(bundle: Path, folder: Path, weights: Mapping[str, Tensor] | None) -> list[str]:
    """Write a bundle as a repository of the hub; the folder is a bundle too, and appears whole or not at all.

    Args:
        bundle: its folder.
        folder: to write.
        weights: in floats, by torch's names; None if there are none.

    Returns:
        The files' names.

    Raises:
        BundleError: the bundle cannot be trusted or understood.
        OutputError: `folder` holds something that is no bundle, or cannot be written.
        MissingExtraError: weights without safetensors.
    """
    loaded = Bundle.load(bundle)
    manifest = loaded.manifest
    with bundle_folder(folder) as temporary:
        for name in (MANIFEST_FILE, *(graph.file for graph in manifest.graphs.values())):
            shutil.copyfile(loaded.path / name, temporary / name)
        if weights is not None:
            write_weights(temporary / WEIGHTS_FILE, weights)
            (temporary / WEIGHTS_FILE).chmod(READABLE)  # safetensors makes it its owner's alone
        (temporary / CONFIG).write_text(config(manifest, loaded.sha256), encoding="utf-8")
        (temporary / CARD).write_text(card(manifest, weights is not None), encoding="utf-8")
        (temporary / ".gitattributes").write_text(LARGE_FILES, encoding="utf-8")
        return sorted(file.name for file in temporary.iterdir())


def config(manifest: Manifest, sha256: str) -> str:
    """Return what the network is, as a JSON document.

    Args:
        manifest: the bundle's.
        sha256: of the manifest.
    """
    document = manifest.to_dict()
    names = ("name", "precision", "opset", "layers", "units", "network", "dt", "training")
    facts = {
        "model_type": "slide-planner",
        "slide_planner_version": __version__,
        "manifest_sha256": sha256,
        **{name: document[name] for name in names},
    }
    return json.dumps(facts, indent=2) + "\n"


def card(manifest: Manifest, with_weights: bool) -> str:
    """Return the model card: what the model is for, what it knows, how good it is, and where it fails."""
    errors = {
        name.removesuffix("_tracking").replace("_", " "): MM * value
        for name, value in manifest.evaluation.items()
        if name.endswith("_tracking") and isinstance(value, float)
    }
    ranges = {name: f"{low:g} to {high:g} {TRAINED_ON[name]}" for name, (low, high) in manifest.trained_on.items()}
    limits = {
        name: "none" if value is None else f"{value:g} {UNITS[name]}"
        for name, value in manifest.limits.to_dict().items()
    }
    template = (files("export") / "card.md").read_text(encoding="utf-8")
    return Template(template).substitute(
        name=manifest.name,
        quoted_name=json.dumps(manifest.name),
        layers=manifest.layers,
        units=manifest.units,
        precision=manifest.precision,
        metrics="".join(map(_metric, errors, errors.values())) or " []",
        train_on=train_on(manifest.units) if with_weights else NO_WEIGHTS,
        limits=_rows(limits),
        ranges=_rows(ranges),
        static=f"{manifest.friction.static:g}",
        kinetic=f"{manifest.friction.kinetic:g}",
        figures=_rows({name: f"{value:.2f}" for name, value in errors.items()} or {"not measured": ""}),
        citation=CITATION,
    )


def _rows(values: Mapping[str, str]) -> str:
    """Return the rows of a table of names and values."""
    return "\n".join(f"| {name.replace('_', ' ')} | {value.strip()} |" for name, value in values.items())


def _metric(name: str, value: float) -> str:
    """Return an error (mm) in the form in which the hub reads it from a card's head."""
    return f"""
      - task: {{type: robotics, name: Sliding along a path}}
        dataset: {{type: slide-planner-{name.replace(" ", "-")}, name: {name}}}
        metrics: [{{type: rmse, name: Tracking RMSE (mm), value: {value:.2f}}}]"""


def train_on(units: int) -> str:
    """Return how to train on with the weights of a network of so many units."""
    return (
        f"`{WEIGHTS_FILE}` has the weights in floats, to train on with, by a configuration of {units} units (extras "
        "`hub` and `train`):\n\n    slide-train my_robot.json --init hf://USER/NAME"
    )

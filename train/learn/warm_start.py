"""Weights to begin with: those of another run, or in floats beside a bundle's graphs."""

from __future__ import annotations

import hashlib
from pathlib import Path

from torch import Tensor, nn

from runtime.errors import InputError
from runtime.network.bundle import Bundle
from runtime.network.manifest import MANIFEST_FILE
from train.config import read_config
from train.learn.checkpoint import CHECKPOINT, load_checkpoint, weights_to_use
from train.learn.trainer import Trainer
from train.learn.weights_file import WEIGHTS_FILE, read_weights


def begin_with(trainer: Trainer, source: Path) -> None:
    """Let a new run begin with the weights of another run's folder, of a checkpoint, or beside a bundle.

    Raises:
        FormatError, BundleError: it is none of these, or damaged.
        InputError: a bundle without weights beside it, or a network of another shape, which is named.
        MissingExtraError: the weights are beside the graphs, and safetensors is not installed.
    """
    weights, trainer.began_with = weights_of(source)
    _check_shapes(trainer.model, weights, source)
    trainer.model.load_state_dict(weights)
    trainer.average.module.load_state_dict(weights)


def weights_of(source: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return weights by torch's names, and the `name` and `sha256` of the checkpoint or of the bundle's manifest.

    Raises:
        FormatError, BundleError, InputError, MissingExtraError: as `begin_with`.
    """
    if (source / MANIFEST_FILE).exists():
        bundle = Bundle.load(source)
        if not (source / WEIGHTS_FILE).exists():
            raise InputError(f"cannot begin with {source}: it has no {WEIGHTS_FILE}, weights to train on with")
        return read_weights(source / WEIGHTS_FILE), {"name": bundle.manifest.name, "sha256": bundle.sha256}
    saved = load_checkpoint(source)
    config = read_config(saved["config"])
    checkpoint = source / CHECKPOINT if source.is_dir() else source
    origin = {"name": config.name, "sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest()}
    return weights_to_use(saved, config), origin


def _check_shapes(network: nn.Module, weights: dict[str, Tensor], source: Path) -> None:
    own = network.state_dict()
    for name in sorted(own.keys() | weights.keys()):
        shapes = [tuple(each[name].shape) if name in each else None for each in (weights, own)]
        if shapes[0] != shapes[1]:
            found, wanted = ("missing" if shape is None else f"of shape {shape}" for shape in shapes)
            raise InputError(f"cannot begin with {source}: its {name} is {found}, this network's is {wanted}")

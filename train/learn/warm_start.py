"""Weights to begin with: those of another run, or of a bundle, in its graphs or in floats beside them.

A bundle has no covariances (the rows of the output layer beyond 2C), which only the likelihoods of Eqs. 22 and 25
need; these rows stay as they are. A wider network takes a narrower one's weights so that it computes what that did:
what the units in common read of the new ones is zero, to begin with (after Chen, Goodfellow and Shlens, Net2Net, 2016).
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import torch
from torch import Tensor

from runtime.errors import InputError
from runtime.network.bundle import Bundle
from runtime.network.manifest import MANIFEST_FILE
from train.learn.trainer import Trainer
from train.network.checkpoint import CHECKPOINT, load_checkpoint, load_model
from train.network.model import Seq2Seq
from train.network.onnx_weights import weights_of_graphs
from train.network.weights_file import WEIGHTS_FILE, read_weights

READS_UNITS = re.compile(r"weight_hh|weight_ih_l[1-9]|feedforward\.weight")
"""Matrices whose columns are the units of a layer, not samples of a chunk."""


def begin_with(trainer: Trainer, source: Path) -> None:
    """Let a new run begin with the weights of another run or of a bundle.

    Raises:
        InputError: the run trains a network for every pan, which begins with nothing; or what `load_weights` raises.
    """
    if not isinstance(trainer.model, Seq2Seq):
        raise InputError(f"{trainer.config.name} is trained from scratch: leave --init out")
    trainer.began_with = load_weights(trainer.model, source)
    trainer.average.module.load_state_dict(trainer.model.state_dict())


def load_weights(model: Seq2Seq, source: Path) -> dict[str, str]:
    """Give `model`, which may have more units, the weights of a run's folder, a checkpoint or an fp32 bundle, in place.

    Returns:
        Its configuration's or the bundle's `name`, and the `sha256` of the checkpoint or of the bundle's manifest.

    Raises:
        FormatError, BundleError: it is none of these, or damaged.
        InputError: it is in integers alone, or a network of another shape, which is named.
        MissingExtraError: the weights are beside the graphs, and safetensors is not installed.
    """
    if (source / MANIFEST_FILE).exists():
        bundle = Bundle.load(source)  # checks hashes and operators before anything here reads the graphs
        if (source / WEIGHTS_FILE).exists():
            weights = read_weights(source / WEIGHTS_FILE)
        elif bundle.manifest.precision == "fp32":
            weights = weights_of_graphs(source, bundle.manifest.graphs)
        else:
            raise InputError(f"cannot begin with {source}: it is {bundle.manifest.precision}; begin with an fp32 one")
        origin = {"name": bundle.manifest.name, "sha256": bundle.sha256}
    else:
        config, other = load_model(load_checkpoint(source))
        checkpoint = source / CHECKPOINT if source.is_dir() else source
        weights = other.state_dict()
        origin = {"name": config.name, "sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest()}
    _copy_weights(model, weights, source)
    return origin


def _copy_weights(model: Seq2Seq, weights: dict[str, Tensor], source: Path) -> None:
    """Copy weights in place; where the network has more units, they come after those of the weights."""
    units = weights["feedforward.weight"].shape[1] if "feedforward.weight" in weights else model.units
    wider = model.units > units
    unknown = min(weights.keys() - model.state_dict().keys(), default=None)
    if unknown is not None:
        raise InputError(f"cannot begin with {source}: it has {unknown}, which this network has not")
    with torch.no_grad():
        for name, tensor in model.state_dict().items():
            found = weights.get(name)
            whole = tuple(tensor.shape)
            if wider and "_lstm." in name:
                tensor = tensor.view(4, model.units, *tensor.shape[1:])[:, :units]
                found = None if found is None else found.view(4, units, *found.shape[1:])
            if wider and READS_UNITS.search(name):
                tensor[..., units:] = 0.0
                tensor = tensor[..., :units]
            if name.startswith("output.") and found is not None and len(found) == 2 * model.chunk:
                tensor = tensor[: len(found)]
            if found is None or found.shape != tensor.shape:
                shape = "missing" if name not in weights else f"of shape {tuple(weights[name].shape)}"
                raise InputError(f"cannot begin with {source}: its {name} is {shape}, this network's is {whole}")
            tensor.copy_(found)

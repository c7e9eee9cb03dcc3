"""Weights to begin with: those of another run, or of a bundle's graphs.

A bundle has no covariances (the rows of the output layer beyond 2C), which only the likelihoods of Eqs. 22 and 25
need; these rows stay as they are.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from runtime.bundle import DECODER_STEP, ENCODER, MANIFEST_FILE, Bundle
from runtime.errors import InputError
from train.model import Seq2Seq
from train.trainer import CHECKPOINT, Trainer, load_checkpoint, load_model


def begin_with(trainer: Trainer, source: Path) -> None:
    """Let a new run begin with the weights of another run or of a bundle; raises what `load_weights` raises."""
    trainer.began_with = load_weights(trainer.model, source)
    trainer.average.module.load_state_dict(trainer.model.state_dict())


def load_weights(model: Seq2Seq, source: Path) -> dict[str, str]:
    """Give `model` the weights of a run's folder, a checkpoint or an fp32 bundle, in place.

    Returns:
        Its configuration's or the bundle's `name`, and the `sha256` of the checkpoint or of the bundle's manifest.

    Raises:
        FormatError, BundleError: it is none of these, or damaged.
        InputError: it is a network of another shape, which is named.
    """
    if (source / MANIFEST_FILE).exists():
        bundle = Bundle.load(source)  # checks hashes and operators before anything here reads the graphs
        _load_bundle(model, source)
        return {"name": bundle.manifest.name, "sha256": bundle.sha256}
    config, other = load_model(load_checkpoint(source))
    weights = other.state_dict()
    for name, tensor in model.state_dict().items():
        _check_shape(name, tensor.shape, weights[name].shape if name in weights else None, source)
    model.load_state_dict(weights)
    checkpoint = source / CHECKPOINT if source.is_dir() else source
    return {"name": config.name, "sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest()}


def _load_bundle(model: Seq2Seq, folder: Path) -> None:
    decoder = _constants(folder / f"{DECODER_STEP}.onnx")
    for module, constants in (
        (model.encoder_lstm, _constants(folder / f"{ENCODER}.onnx")),
        (model.decoder_lstm, decoder),
    ):
        _load_lstm(module, constants, folder)
    means = 2 * model.chunk
    for name, layer, rows in (("feedforward", model.feedforward, None), ("output", model.output, means)):
        _copy(layer.weight[:rows], decoder.get(f"{name}.weight"), f"{name}.weight", folder)
        _copy(layer.bias[:rows], decoder.get(f"{name}.bias"), f"{name}.bias", folder)


def _load_lstm(module: nn.LSTM, constants: dict[str, Tensor], folder: Path) -> None:
    for layer, (w_ih, w_hh, b_ih, b_hh) in enumerate(module.all_weights):
        biases = constants.get(f"lstm{layer}.B")
        halves = (None, None) if biases is None else biases[0].chunk(2)
        for weight, name in ((w_ih, "W"), (w_hh, "R")):
            found = constants.get(f"lstm{layer}.{name}")
            _copy(weight, None if found is None else _torch_gates(found[0]), f"lstm{layer}.{name}", folder)
        for bias, half in zip((b_ih, b_hh), halves, strict=True):
            _copy(bias, None if half is None else _torch_gates(half), f"lstm{layer}.B", folder)


def _copy(target: Tensor, found: Tensor | None, name: str, source: Path) -> None:
    _check_shape(name, target.shape, None if found is None else found.shape, source)
    with torch.no_grad():
        target.copy_(found)  # type: ignore[arg-type]


def _check_shape(name: str, wanted: torch.Size, found: torch.Size | None, source: Path) -> None:
    if found != wanted:
        shape = "missing" if found is None else f"of shape {tuple(found)}"
        raise InputError(f"cannot begin with {source}: its {name} is {shape}, this network's is {tuple(wanted)}")


def _constants(graph: Path) -> dict[str, Tensor]:
    return {
        part.name: torch.from_numpy(np.array(numpy_helper.to_array(part)))
        for part in onnx.load(graph).graph.initializer
    }


def _torch_gates(weight: Tensor) -> Tensor:
    """Reorder the gates along the first axis: ONNX has them as i, o, f, c, torch as i, f, g, o (its g is ONNX's c)."""
    i, o, f, c = weight.chunk(4)
    return torch.cat([i, f, c, o])

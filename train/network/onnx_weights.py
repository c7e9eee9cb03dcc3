"""Weights of an LSTM in torch's layout and in ONNX's, both ways."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import Tensor

from runtime.network.manifest import DECODER_STEP, ENCODER


def float32_array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().astype(np.float32)


def onnx_gates(weight: Tensor) -> NDArray[np.float32]:
    """Reorder the gates along the first axis: torch has them as i, f, g, o, ONNX as i, o, f, c (its c is torch's g)."""
    i, f, g, o = np.split(float32_array(weight), 4)
    return np.concatenate([i, o, f, g])


PARTS = {"W": ("weight_ih",), "R": ("weight_hh",), "B": ("bias_ih", "bias_hh")}
"""Torch's names for the inputs of ONNX's LSTM."""


def weights_of_graphs(folder: Path) -> dict[str, Tensor]:
    """Return a bundle's weights by torch's names for them, those of them that its graphs have."""
    decoder = constants_of_graph(folder / f"{DECODER_STEP}.onnx")
    names = ("feedforward.weight", "feedforward.bias", "output.weight", "output.bias")
    weights = {name: decoder[name] for name in names if name in decoder}
    for lstm, constants in (
        ("encoder_lstm", constants_of_graph(folder / f"{ENCODER}.onnx")),
        ("decoder_lstm", decoder),
    ):
        for name, constant in constants.items():
            if match := re.fullmatch(r"lstm(\d+)\.([WRB])", name):
                layer, part = match.groups()
                halves = constant[0].chunk(2) if part == "B" else constant[:1]
                for kind, half in zip(PARTS[part], halves, strict=True):
                    weights[f"{lstm}.{kind}_l{layer}"] = torch_gates(half)
    return weights


def constants_of_graph(graph: Path) -> dict[str, Tensor]:
    return {
        part.name: torch.from_numpy(np.array(numpy_helper.to_array(part)))
        for part in onnx.load(graph).graph.initializer
    }


def torch_gates(weight: Tensor) -> Tensor:
    """Reorder the gates along the first axis: ONNX has them as i, o, f, c, torch as i, f, g, o (its g is ONNX's c)."""
    i, o, f, c = weight.chunk(4)
    return torch.cat([i, f, c, o])

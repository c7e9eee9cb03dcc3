"""Weights of an LSTM in torch's layout and in ONNX's, both ways."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import Tensor

from runtime.network.manifest import DECODER_STEP, ENCODER, GraphFile


def float32_array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().astype(np.float32)


TORCH_GATES, ONNX_GATES = "ifgo", "iofg"
"""The gates in the order in which an LSTM's weights hold them along their first axis; ONNX writes c for g."""


def onnx_gates(weight: Tensor) -> NDArray[np.float32]:
    """Reorder the gates of a weight in torch's layout for ONNX."""
    return float32_array(_reorder(weight, TORCH_GATES, ONNX_GATES))


def torch_gates(weight: Tensor) -> Tensor:
    """Reorder the gates of a weight in ONNX's layout for torch."""
    return _reorder(weight, ONNX_GATES, TORCH_GATES)


def _reorder(weight: Tensor, given: str, wanted: str) -> Tensor:
    parts = dict(zip(given, weight.chunk(len(given)), strict=True))
    return torch.cat([parts[gate] for gate in wanted])


PARTS = {"W": ("weight_ih",), "R": ("weight_hh",), "B": ("bias_ih", "bias_hh")}
"""Torch's names for the inputs of ONNX's LSTM."""


def weights_of_graphs(folder: Path, graphs: Mapping[str, GraphFile]) -> dict[str, Tensor]:
    """Return a bundle's weights by torch's names for them, those of them that its graphs have.

    Args:
        folder: of the bundle.
        graphs: of its manifest.
    """
    encoder, decoder = (_constants(folder / graphs[name].file) for name in (ENCODER, DECODER_STEP))
    names = ("feedforward.weight", "feedforward.bias", "output.weight", "output.bias")
    weights = {name: decoder[name] for name in names if name in decoder}
    for lstm, constants in (("encoder_lstm", encoder), ("decoder_lstm", decoder)):
        for name, constant in constants.items():
            if match := re.fullmatch(r"lstm(\d+)\.([WRB])", name):
                layer, part = match.groups()
                halves = constant[0].chunk(2) if part == "B" else constant[:1]
                for kind, half in zip(PARTS[part], halves, strict=True):
                    weights[f"{lstm}.{kind}_l{layer}"] = torch_gates(half)
    return weights


def _constants(graph: Path) -> dict[str, Tensor]:
    return {
        part.name: torch.from_numpy(np.array(numpy_helper.to_array(part)))
        for part in onnx.load(graph).graph.initializer
    }

"""The same planner on torch eager: what somebody who has trained with torch would run without exporting anything.

Only the network is another: the decode loop, the law of friction and the judging of the plan are the runtime's own,
so the difference in time is that of the engines. The LSTM cells are written by hand, which on a CPU is several times
faster than calling `nn.LSTM` chunk by chunk.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional as F

from runtime.network.bundle import Bundle, Float32Array, bundle_path
from runtime.network.manifest import DECODER_STEP, ENCODER, Manifest
from runtime.planner import DEFAULT_BUNDLE, Planner
from train.network.model import ACCELERATION_SCALE, DecoderState, Seq2Seq, bound_acceleration, lstm_cell
from train.network.onnx_weights import weights_of_graphs


class EagerPlanner(Planner):
    """The runtime's planner with torch eager in the place of onnxruntime.

    The weights are the bundle's where its graphs are fp32. A quantized bundle has none that torch could use: the
    network then has drawn weights and the manifest's sizes, and only its speed means something.

    Args:
        path: the bundle's folder; the shipped one if None.

    Raises:
        BundleError: the bundle cannot be trusted or understood.
    """

    def __init__(self, path: str | PathLike[str] | None = None) -> None:
        super().__init__(path)
        folder = bundle_path(DEFAULT_BUNDLE if path is None else path)
        model = eager_model(folder, self.bundle)
        sessions = {ENCODER: EagerEncoder(model), DECODER_STEP: EagerDecoderStep(model)}
        self.bundle = replace(self.bundle, sessions=sessions)


class EagerEncoder:
    """Stands in for the onnxruntime session of the encoder."""

    def __init__(self, model: Seq2Seq) -> None:
        self.model = model

    def run(self, _outputs: Sequence[str], inputs: Mapping[str, Float32Array]) -> list[Float32Array]:
        """Read commands: `command` (B, chunks, 4C) to hidden and cell (layers, B, units)."""
        with torch.inference_mode():
            state = self.model.encode(torch.from_numpy(inputs["command"]))
        return [part.numpy() for part in state]


class EagerDecoderStep:
    """Stands in for the onnxruntime session of the decoder step."""

    def __init__(self, model: Seq2Seq) -> None:
        self.model = model
        # The rows of the output layer beyond 2C are the covariances, which only training needs.
        self.weight = model.output.weight[: 2 * model.chunk].contiguous()
        self.bias = model.output.bias[: 2 * model.chunk].contiguous()

    def run(self, _outputs: Sequence[str], inputs: Mapping[str, Float32Array]) -> list[Float32Array]:
        """Take one decoder iteration; inputs and outputs are those of the bundle's graph."""
        with torch.inference_mode():
            observation, hidden, cell = (torch.from_numpy(inputs[name]) for name in ("observation", "hidden", "cell"))
            acceleration, state = self.step(observation, DecoderState(hidden, cell))
            return [acceleration.numpy(), state.hidden.numpy(), state.cell.numpy()]

    def step(self, observation: Tensor, state: DecoderState) -> tuple[Tensor, DecoderState]:
        """Turn the observation (B, 8C + 4C command_ahead) into accelerations (B, C, 2) (m/s^2)."""
        model = self.model
        x = observation * model.observation_scale
        hidden, cell = [], []
        for layer, (w_ih, w_hh, b_ih, b_hh) in enumerate(model.decoder_lstm.all_weights):
            x, c = lstm_cell(F.linear(x, w_ih, b_ih), state.hidden[layer], state.cell[layer], w_hh, b_hh)
            hidden.append(x)
            cell.append(c)
        raw = F.linear(torch.tanh(model.feedforward(x)), self.weight, self.bias)
        u = ACCELERATION_SCALE * raw.reshape(-1, model.chunk, 2)
        if model.acceleration_bound is not None:
            u = bound_acceleration(u, model.acceleration_bound)
        return u, DecoderState(torch.stack(hidden), torch.stack(cell))


def eager_model(folder: Path, bundle: Bundle) -> Seq2Seq:
    """Return a bundle's network for torch; see `EagerPlanner` for its weights."""
    manifest = bundle.manifest
    model = untrained_model(manifest)
    if manifest.precision == "fp32":
        weights = weights_of_graphs(folder, manifest.graphs)
        with torch.no_grad():
            for name, tensor in model.state_dict().items():
                # The graph has no rows for the covariances: these are never used.
                tensor[: len(weights[name])] = weights[name]
    return model


def untrained_model(manifest: Manifest) -> Seq2Seq:
    """Return a network of the manifest's sizes with drawn weights, without touching torch's own generator."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return Seq2Seq(
            manifest.units,
            manifest.one_pan.chunk,
            manifest.layers,
            manifest.one_pan.command_ahead,
            manifest.one_pan.acceleration_bound,
        ).eval()

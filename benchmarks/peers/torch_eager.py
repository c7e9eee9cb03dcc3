"""The same planner on torch eager: what somebody who has trained with torch would run without exporting anything.

Only the network is another: the decode loop, the law of friction and the judging of the plan are the runtime's own,
so the difference in time is that of the engines. The LSTM cells are written by hand, which on a CPU is several times
faster than calling `nn.LSTM` chunk by chunk.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike

import torch

from export.float_graphs import DECODER_SCALE, ENCODER_SCALE, seen_once
from runtime.limits import WEIGHT_KEPT
from runtime.network.bundle import Float32Array
from runtime.network.manifest import DECODER_STEP, ENCODER
from runtime.network.units import CONDITIONS, OBSERVED, USUAL_GRAVITY
from runtime.planner import Planner
from train.network.lstm import DecoderState, last_states, step
from train.network.network import OUTPUT_SCALE, Network, Told, bounded

TOLD = OBSERVED - CONDITIONS - 1
"""Column of an observation where the conditions begin: the logarithm of gravity, and then the lift."""


class EagerPlanner(Planner):
    """The runtime's planner with torch eager in the place of onnxruntime.

    Args:
        path: the bundle's folder; the shipped one if None.
        network: what plans. If None, one of the bundle's size with drawn weights, of which only the speed means
            something: a bundle's graphs have none that torch could use.

    Raises:
        BundleError: the bundle cannot be trusted or understood.
    """

    def __init__(self, path: str | PathLike[str] | None = None, network: Network | None = None) -> None:
        super().__init__(path)
        manifest = self.bundle.manifest
        own = drawn_network(manifest.units, manifest.layers) if network is None else network
        sessions = {ENCODER: EagerEncoder(own), DECODER_STEP: EagerDecoderStep(own)}
        self.bundle = replace(self.bundle, sessions=sessions)


class EagerEncoder:
    """Stands in for the onnxruntime session of the encoder."""

    def __init__(self, network: Network) -> None:
        self.lstm = network.encoder_lstm

    def run(self, _outputs: Sequence[str], inputs: Mapping[str, Float32Array]) -> list[Float32Array]:
        """Read commands: `command` (B, chunks, READ) to hidden and cell (layers, B, units)."""
        with torch.inference_mode():
            command = torch.from_numpy(inputs["command"]) * ENCODER_SCALE
            return [part.numpy() for part in last_states(self.lstm, command)]


class EagerDecoderStep:
    """Stands in for the onnxruntime session of the decoder step."""

    def __init__(self, network: Network) -> None:
        self.network = network
        with torch.random.fork_rng():  # building an LSTM draws weights
            self.lstm = seen_once(network.decoder_lstm)

    def run(self, _outputs: Sequence[str], inputs: Mapping[str, Float32Array]) -> list[Float32Array]:
        """Take one decoder iteration; inputs and outputs are those of the bundle's graph."""
        with torch.inference_mode():
            seen, hidden, cell = (torch.from_numpy(inputs[name]) for name in ("observation", "hidden", "cell"))
            top, after = step(self.lstm, seen * DECODER_SCALE, DecoderState(hidden, cell))
            raw = OUTPUT_SCALE * self.network.output(torch.tanh(self.network.feedforward(top)))
            floor = (1.0 - WEIGHT_KEPT) * USUAL_GRAVITY * torch.exp(seen[:, TOLD])
            told = Told(seen[:, TOLD:-1], floor, seen[:, TOLD + 1])
            return [bounded(raw, told).numpy(), after.hidden.numpy(), after.cell.numpy()]


def drawn_network(units: int, layers: int) -> Network:
    """Return a network with drawn weights, without touching torch's own generator."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return Network(units, layers).eval()

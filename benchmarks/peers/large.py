"""A network of the paper's size, for its speed alone: drawn weights, 8-bit, as `slide-export` would write it."""

from __future__ import annotations

from pathlib import Path

import torch

from benchmarks.peers.torch_eager import untrained_model
from export.float_graphs import decoder_step_graph, encoder_graph
from export.graph_builder import OPSET
from export.quantize import integer_graphs
from export.write_bundle import write_graphs, write_manifest
from runtime.friction import Friction
from runtime.network.manifest import DECODER_STEP, ENCODER, GraphFile, Manifest, OnePan
from runtime.physics.law import DT

GAIN = 40.0
"""By which the drawn output weights are multiplied, so that the object slides as under a trained network."""


def write_large(folder: Path, units: int) -> Path:
    """Write the bundle, with two layers of `units`, into an empty folder, and return it."""
    nothing = GraphFile("none", "0" * 64)
    manifest = Manifest(
        name="large",
        precision="int8",
        opset=OPSET,
        graphs={ENCODER: nothing, DECODER_STEP: nothing},
        network=OnePan(chunk=100, command_ahead=2, acceleration_bound=30.0, pan_limit=0.2),
        dt=DT,
        layers=2,
        units=units,
        friction=Friction(),
        trained_on={
            "static": (0.4, 1.5), "kinetic": (0.2, 0.8), "reach": (0.0, 0.15), "speed": (0.0, 0.7),
            "samples": (300.0, 1500.0),
        },
        training={},
        evaluation={},
    )  # fmt: skip
    model = untrained_model(manifest)
    with torch.no_grad():
        model.output.weight *= GAIN
    graphs = {ENCODER: encoder_graph(model), DECODER_STEP: decoder_step_graph(model)}
    files = write_graphs(folder, integer_graphs(graphs, manifest))
    write_manifest(folder, Manifest(**{**vars(manifest), "graphs": files}))
    return folder

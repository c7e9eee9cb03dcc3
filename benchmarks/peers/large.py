"""A network of the paper's size, for its speed alone: drawn weights, 8-bit, as `slide-export` would write it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from benchmarks.peers.torch_eager import drawn_network
from export.float_graphs import decoder_step_graph, encoder_graph
from export.quantize import integer_graphs
from export.write_bundle import write_graphs, write_manifest
from runtime.network.bundle import Bundle
from runtime.network.manifest import DECODER_STEP, ENCODER
from runtime.planner import DEFAULT_BUNDLE

GAIN = 40.0
"""By which the drawn output weights are multiplied, so that the object slides as under a trained network."""


def write_large(folder: Path, units: int) -> Path:
    """Write the bundle, with two layers of `units`, into an empty folder, and return it."""
    manifest = replace(
        Bundle.load(DEFAULT_BUNDLE).manifest, name="large", layers=2, units=units, training={}, evaluation={}
    )
    network = drawn_network(units, manifest.layers)
    with torch.no_grad():
        network.output.weight *= GAIN
    graphs = {ENCODER: encoder_graph(network), DECODER_STEP: decoder_step_graph(network)}
    files = write_graphs(folder, integer_graphs(graphs, manifest))
    write_manifest(folder, replace(manifest, graphs=files))
    return folder

"""A bundle small enough for tests: an untrained network of a few units."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from export.float_graphs import decoder_step_graph, encoder_graph
from export.graph_builder import OPSET
from runtime.network.bundle import Bundle
from runtime.network.manifest import DECODER_STEP, ENCODER, MANIFEST_FILE, GraphFile
from runtime.planner import DEFAULT_BUNDLE
from train.network.network import Network

UNITS = 8


def large_network(units: int = UNITS) -> Network:
    """Return an untrained network, drawn so large that its accelerations break objects away."""
    with torch.random.fork_rng():
        torch.manual_seed(7)
        network = Network(units)
    with torch.no_grad():
        network.output.weight *= 40.0
    return network.eval()


def write_bundle(folder: Path, units: int = UNITS) -> Path:
    """Write a bundle of `large_network`."""
    network = large_network(units)
    graphs = {}
    for name, graph in ((ENCODER, encoder_graph(network)), (DECODER_STEP, decoder_step_graph(network))):
        (folder / f"{name}.onnx").write_bytes(graph)
        graphs[name] = GraphFile(f"{name}.onnx", hashlib.sha256(graph).hexdigest())
    shipped = Bundle.load(DEFAULT_BUNDLE).manifest
    manifest = replace(
        shipped, name="tiny", precision="fp32", opset=OPSET, graphs=graphs, units=units, training={}, evaluation={}
    )
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest.to_dict()), encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def tiny_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bundle of 8 units."""
    return write_bundle(tmp_path_factory.mktemp("tiny"))

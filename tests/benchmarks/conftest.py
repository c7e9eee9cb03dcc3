"""A bundle small enough for tests: an untrained network of a few units."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from export.float_graphs import decoder_step_graph, encoder_graph
from export.graph_builder import OPSET
from runtime.friction import Friction
from runtime.network.manifest import DECODER_STEP, ENCODER, MANIFEST_FILE, GraphFile, Manifest, OnePan
from runtime.physics.law import DT
from train.network.model import Seq2Seq

UNITS = 8
ACCELERATION_BOUND = 30.0


def write_bundle(folder: Path, units: int = UNITS, command_ahead: int = 2) -> Path:
    """Write a bundle with an untrained network, drawn so large that its accelerations break objects away."""
    with torch.random.fork_rng():
        torch.manual_seed(7)
        model = Seq2Seq(units, 100, 2, command_ahead, ACCELERATION_BOUND)
    with torch.no_grad():
        model.output.weight *= 40.0
    graphs = {}
    for name, graph in ((ENCODER, encoder_graph(model)), (DECODER_STEP, decoder_step_graph(model))):
        (folder / f"{name}.onnx").write_bytes(graph)
        graphs[name] = GraphFile(f"{name}.onnx", hashlib.sha256(graph).hexdigest())
    manifest = Manifest(
        name="tiny",
        precision="fp32",
        opset=OPSET,
        graphs=graphs,
        network=OnePan(100, command_ahead, ACCELERATION_BOUND, 0.2),
        dt=DT,
        layers=2,
        units=units,
        friction=Friction(),
        trained_on={
            "static": (0.4, 1.5),
            "kinetic": (0.2, 0.8),
            "reach": (0.0, 0.15),
            "speed": (0.0, 0.7),
            "samples": (500, 1500),
        },
        training={},
        evaluation={},
    )
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest.to_dict()), encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def tiny_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bundle of 8 units."""
    return write_bundle(tmp_path_factory.mktemp("tiny"))


@pytest.fixture
def make_bundle(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a bundle of `units` and `command_ahead` and returns its folder."""
    return lambda **sizes: write_bundle(tmp_path, **sizes)

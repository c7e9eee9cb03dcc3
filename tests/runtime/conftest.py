"""A tiny bundle with random weights, so that these tests do not depend on the trained model."""

from __future__ import annotations

import copy
import hashlib
import json
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from runtime import Plan, Planner
from runtime.network.bundle import Bundle, Float32Array, LstmState
from runtime.network.units import CHUNK, CONDITIONS, OBSERVED, READ, Constants

OPSET = 17
UNITS, LAYERS = 8, 2

LIFT = OBSERVED - CONDITIONS
"""Column of an observation that is 0 for a level pan."""

TRAINED = {
    "static": [0.05, 1.5], "kinetic": [0.02, 1.5], "push": [0.0, 0.88], "pan_reach": [0.02, 0.4], "height": [0.0, 0.2],
    "pan_speed": [0.5, 3.0], "acceleration": [2.0, 40.0], "jerk": [500.0, 20_000.0], "reach": [0.0, 1.5],
    "speed": [0.0, 1.1], "start_speed": [0.0, 1.0], "corner": [0.0, 1.2], "samples": [256, 1536],
}  # fmt: skip


class Graph:
    """Collects the nodes and weights of one ONNX graph."""

    def __init__(self, seed: int) -> None:
        self.nodes: list[Any] = []
        self.weights: list[Any] = []
        self.random = np.random.default_rng(seed)

    def constant(self, name: str, value: NDArray[Any]) -> str:
        self.weights.append(numpy_helper.from_array(value, name))
        return name

    def weight(self, name: str, *shape: int, scale: float) -> str:
        return self.constant(name, (scale * self.random.standard_normal(shape)).astype(np.float32))

    def node(self, operator: str, inputs: list[str], outputs: list[str], **attributes: Any) -> str:
        self.nodes.append(helper.make_node(operator, inputs, outputs, **attributes))
        return outputs[0]

    def lstm(self, x: str, width: int, units: int, layer: int, start: tuple[str, str] = ("", "")) -> str:
        """Add a layer; gives the name of its sequence output, and defines h<layer> and c<layer>."""
        inputs = [
            x,
            self.weight(f"w{layer}", 1, 4 * units, width, scale=width**-0.5),
            self.weight(f"r{layer}", 1, 4 * units, units, scale=units**-0.5),
            self.weight(f"b{layer}", 1, 8 * units, scale=0.3),
            "",
            *start,
        ]
        self.node("LSTM", inputs, [f"y{layer}", f"h{layer}", f"c{layer}"], hidden_size=units)
        return self.node("Squeeze", [f"y{layer}", self.constant(f"one{layer}", np.array([1]))], [f"x{layer + 1}"])

    def model(self, inputs: dict[str, list[int | str]], outputs: dict[str, list[int | str]]) -> bytes:
        def infos(tensors: dict[str, list[int | str]]) -> list[Any]:
            return [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in tensors.items()]

        graph = helper.make_graph(self.nodes, "tiny", infos(inputs), infos(outputs), self.weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
        onnx.checker.check_model(model)
        data: bytes = model.SerializeToString()
        return data


def encoder_bytes(units: int = UNITS, layers: int = LAYERS, batch: int | str = "batch") -> bytes:
    graph = Graph(seed=3)
    x = graph.node("Transpose", ["command"], ["x0"], perm=[1, 0, 2])
    for layer in range(layers):
        x = graph.lstm(x, READ if layer == 0 else units, units, layer)
    for name, letter in (("hidden", "h"), ("cell", "c")):
        graph.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    memory: list[int | str] = [layers, batch, units]
    return graph.model({"command": [batch, "chunks", READ]}, {"hidden": memory, "cell": memory})


def decoder_step_bytes(
    units: int = UNITS, layers: int = LAYERS, observation: str = "observation", scale: float = 7.0
) -> bytes:
    """Return a decoder whose accelerations are waves, so that a chunk leaves the pan where it was, in no bounds."""
    graph = Graph(seed=4)
    graph.constant("zero", np.array([0]))
    x = graph.node("Unsqueeze", [observation, "zero"], ["x0"])
    for name, letter in (("hidden", "h"), ("cell", "c")):
        graph.node("Split", [name], [f"{letter}_{layer}" for layer in range(layers)], axis=0)
    for layer in range(layers):
        x = graph.lstm(x, OBSERVED if layer == 0 else units, units, layer, (f"h_{layer}", f"c_{layer}"))
    top = graph.node("Squeeze", [x, "zero"], ["top"])
    waves = np.cos(2.0 * np.pi * np.arange(1, 4)[:, None] * (np.arange(CHUNK) + 0.5) / CHUNK)
    sizes = scale * graph.random.standard_normal((units, 3, 3))
    out = np.einsum("ukd,kt->utd", sizes, waves).reshape(units, -1)
    raw = graph.node("MatMul", [top, graph.constant("out", out.astype(np.float32))], ["raw"])
    waved = graph.node("Reshape", [raw, graph.constant("triples", np.array([-1, CHUNK, 3]))], ["waved"])
    told = np.zeros((OBSERVED, 3), dtype=np.float32)
    told[LIFT, 2] = 1.0
    lift = graph.node("MatMul", [observation, graph.constant("told", told)], ["lift"])
    lift = graph.node("Add", [lift, graph.constant("plane", np.array([1.0, 1.0, 0.0], dtype=np.float32))], ["axes"])
    lift = graph.node("Unsqueeze", [lift, graph.constant("middle", np.array([1]))], ["each"])
    graph.node("Mul", [waved, lift], ["pan_acceleration"])
    for name, letter in (("hidden_out", "h"), ("cell_out", "c")):
        graph.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    memory: list[int | str] = [layers, "batch", units]
    return graph.model(
        {observation: ["batch", OBSERVED], "hidden": memory, "cell": memory},
        {"pan_acceleration": ["batch", CHUNK, 3], "hidden_out": memory, "cell_out": memory},
    )


def write_bundle(folder: Path, models: dict[str, bytes] | None = None, **changes: Any) -> Path:
    """Write a bundle; `models` replaces graph bytes (with fitting hashes), `changes` replaces manifest keys."""
    folder.mkdir(parents=True, exist_ok=True)
    data = {"encoder": encoder_bytes(), "decoder_step": decoder_step_bytes()} | (models or {})
    for name, model in data.items():
        (folder / f"{name}.onnx").write_bytes(model)
    manifest = {
        "format": "slide-bundle/2",
        "name": "tiny",
        "precision": "fp32",
        "opset": OPSET,
        "graphs": {
            name: {"file": f"{name}.onnx", "sha256": hashlib.sha256(model).hexdigest()} for name, model in data.items()
        },
        "network": asdict(Constants()),
        "units": UNITS,
        "layers": LAYERS,
        "dt": 0.001,
        "friction": {"static": 1.0, "kinetic": 0.5},
        "trained_on": TRAINED,
        "training": {"seed": 0},
        "evaluation": {"tracking_rmse": 0.002},
    }
    manifest = {name: value for name, value in (manifest | changes).items() if value is not ...}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def make_bundle() -> Callable[..., Path]:
    return write_bundle


@pytest.fixture(scope="session")
def make_decoder_step() -> Callable[..., bytes]:
    return decoder_step_bytes


@pytest.fixture(scope="session")
def make_encoder() -> Callable[..., bytes]:
    return encoder_bytes


@pytest.fixture(scope="session")
def bundle_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bundle(tmp_path_factory.mktemp("bundles") / "tiny")


@pytest.fixture(scope="session")
def planner(bundle_path: Path) -> Planner:
    return Planner(bundle_path)


@dataclass(frozen=True, eq=False)
class WatchedBundle(Bundle):
    """A bundle that keeps what its network is shown, and gives no finite number any more once `broken` says so."""

    encoded: list[Float32Array] = field(default_factory=list)
    observed: list[Float32Array] = field(default_factory=list)
    broken: threading.Event = field(default_factory=threading.Event)

    def encode(self, command: Float32Array) -> LstmState:
        self.encoded.append(command)
        return super().encode(command)

    def decode_step(self, observation: Float32Array, state: LstmState) -> tuple[Float32Array, LstmState]:
        self.observed.append(observation)
        acceleration, after = super().decode_step(observation, state)
        return np.full_like(acceleration, np.nan) if self.broken.is_set() else acceleration, after


@pytest.fixture
def watched(planner: Planner) -> tuple[Planner, WatchedBundle]:
    """A planner with a bundle that is watched."""
    other = copy.copy(planner)
    other.bundle = bundle = WatchedBundle(**vars(planner.bundle))
    return other, bundle


def draw_curve(samples: int, seed: int = 0) -> NDArray[np.float64]:
    """Return (samples, 2) positions (m): a few slow sines of random phase, within 0.1 m."""
    random = np.random.default_rng(seed)
    t = np.arange(samples)[:, None, None] * 0.001
    rate, phase = random.uniform(1.0, 8.0, (2, 3)), random.uniform(0.0, 6.28, (2, 3))
    curve: NDArray[np.float64] = (0.02 * np.sin(rate * t + phase)).sum(axis=2)
    return curve


@pytest.fixture(scope="session")
def make_curve() -> Callable[..., NDArray[np.float64]]:
    return draw_curve


@pytest.fixture(scope="session")
def plan(planner: Planner) -> Plan:
    """A plan of 250 samples, to be saved, read and replayed."""
    return planner.plan(draw_curve(250))

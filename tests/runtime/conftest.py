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
from runtime.network.units import CHUNK, OBSERVED, READ, Constants

OPSET = 17
SIZES = {"chunk": 100, "units": 8, "layers": 2, "command_ahead": 2}


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


def normalized(graph: Graph, name: str, rows: int) -> str:
    """Divide rows of (x, y, vx, vy) by 0.1 m and 0.5 m/s."""
    scale = np.tile(np.array([10.0, 10.0, 2.0, 2.0], dtype=np.float32), rows)
    return graph.node("Mul", [name, graph.constant("scale", scale)], ["normalized"])


def encoder_bytes(chunk: int, units: int, layers: int, batch: int | str = "batch") -> bytes:
    graph = Graph(seed=1)
    x = graph.node("Transpose", [normalized(graph, "command", chunk)], ["x0"], perm=[1, 0, 2])
    for layer in range(layers):
        x = graph.lstm(x, 4 * chunk if layer == 0 else units, units, layer)
    for name, letter in (("hidden", "h"), ("cell", "c")):
        graph.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    memory: list[int | str] = [layers, batch, units]
    return graph.model({"command": [batch, "chunks", 4 * chunk]}, {"hidden": memory, "cell": memory})


def decoder_step_bytes(
    chunk: int, units: int, layers: int, command_ahead: int, observation: str = "observation", scale: float = 12.0
) -> bytes:
    graph = Graph(seed=2)
    rows = (2 + command_ahead) * chunk
    graph.constant("zero", np.array([0]))
    x = graph.node("Unsqueeze", [normalized(graph, observation, rows), "zero"], ["x0"])
    for name, letter in (("hidden", "h"), ("cell", "c")):
        graph.node("Split", [name], [f"{letter}_{layer}" for layer in range(layers)], axis=0)
    for layer in range(layers):
        start = (f"h_{layer}", f"c_{layer}")
        x = graph.lstm(x, 4 * rows if layer == 0 else units, units, layer, start)
    top = graph.node("Squeeze", [x, "zero"], ["top"])
    raw = graph.node("MatMul", [top, graph.weight("out", units, 2 * chunk, scale=scale)], ["raw"])
    graph.node("Reshape", [raw, graph.constant("pairs", np.array([-1, chunk, 2]))], ["pan_acceleration"])
    for name, letter in (("hidden_out", "h"), ("cell_out", "c")):
        graph.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    memory: list[int | str] = [layers, "batch", units]
    return graph.model(
        {observation: ["batch", 4 * rows], "hidden": memory, "cell": memory},
        {"pan_acceleration": ["batch", chunk, 2], "hidden_out": memory, "cell_out": memory},
    )


def write_bundle(folder: Path, models: dict[str, bytes] | None = None, **changes: Any) -> Path:
    """Write a bundle; `models` replaces graph bytes (with fitting hashes), `changes` replaces manifest keys."""
    sizes = dict(SIZES)
    folder.mkdir(parents=True, exist_ok=True)
    data = {
        "encoder": encoder_bytes(sizes["chunk"], sizes["units"], sizes["layers"]),
        "decoder_step": decoder_step_bytes(**sizes),
    } | (models or {})
    for name, model in data.items():
        (folder / f"{name}.onnx").write_bytes(model)
    manifest = {
        "format": "slide-bundle/1",
        "name": "tiny",
        "precision": "fp32",
        "opset": OPSET,
        "graphs": {
            name: {"file": f"{name}.onnx", "sha256": hashlib.sha256(model).hexdigest()} for name, model in data.items()
        },
        **sizes,
        "dt": 0.001,
        "acceleration_bound": None,
        "friction": {"static": 1.0, "kinetic": 0.5},
        "pan_limit": 100.0,
        "trained_on": {
            "static": [0.5, 1.4],
            "kinetic": [0.3, 0.7],
            "reach": [0.0, 0.13],
            "speed": [0.0, 0.7],
            "samples": [1, 1500],
        },
        "training": {"seed": 0},
        "evaluation": {"tracking_rmse": 0.002},
    }
    manifest = {name: value for name, value in (manifest | changes).items() if value is not ...}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def general_graphs(units: int = 8, layers: int = 2, scale: float = 8.0) -> dict[str, bytes]:
    """Return the graphs of a network for every pan: accelerations in space, in no bounds."""
    encoder = Graph(seed=3)
    x = encoder.node("Transpose", ["command"], ["x0"], perm=[1, 0, 2])
    for layer in range(layers):
        x = encoder.lstm(x, READ if layer == 0 else units, units, layer)
    for name, letter in (("hidden", "h"), ("cell", "c")):
        encoder.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    memory: list[int | str] = [layers, "batch", units]
    step = Graph(seed=4)
    step.constant("zero", np.array([0]))
    x = step.node("Unsqueeze", ["observation", "zero"], ["x0"])
    for name, letter in (("hidden", "h"), ("cell", "c")):
        step.node("Split", [name], [f"{letter}_{layer}" for layer in range(layers)], axis=0)
    for layer in range(layers):
        x = step.lstm(x, OBSERVED if layer == 0 else units, units, layer, (f"h_{layer}", f"c_{layer}"))
    top = step.node("Squeeze", [x, "zero"], ["top"])
    raw = step.node("MatMul", [top, step.weight("out", units, 3 * CHUNK, scale=scale)], ["raw"])
    step.node("Reshape", [raw, step.constant("triples", np.array([-1, CHUNK, 3]))], ["pan_acceleration"])
    for name, letter in (("hidden_out", "h"), ("cell_out", "c")):
        step.node("Concat", [f"{letter}{layer}" for layer in range(layers)], [name], axis=0)
    return {
        "encoder": encoder.model({"command": ["batch", "chunks", READ]}, {"hidden": memory, "cell": memory}),
        "decoder_step": step.model(
            {"observation": ["batch", OBSERVED], "hidden": memory, "cell": memory},
            {"pan_acceleration": ["batch", CHUNK, 3], "hidden_out": memory, "cell_out": memory},
        ),
    }


TRAINED = {
    "static": [0.05, 1.5], "kinetic": [0.02, 1.5], "push": [0.0, 0.88], "pan_reach": [0.02, 0.4], "height": [0.0, 0.2],
    "pan_speed": [0.5, 3.0], "acceleration": [2.0, 40.0], "jerk": [500.0, 20_000.0], "reach": [0.0, 1.5],
    "speed": [0.0, 1.1], "start_speed": [0.0, 1.0], "corner": [0.0, 1.2], "samples": [256, 1536],
}  # fmt: skip


@pytest.fixture(scope="session")
def general_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a tiny network for every pan."""
    network = {"kind": "general", **asdict(Constants())}
    old = dict.fromkeys(("chunk", "command_ahead", "acceleration_bound", "pan_limit"), ...)
    return write_bundle(
        tmp_path_factory.mktemp("bundles") / "every",
        general_graphs(),
        **old,
        format="slide-bundle/2",
        name="every",
        network=network,
        trained_on=TRAINED,
    )


@pytest.fixture(scope="session")
def general_planner(general_path: Path) -> Planner:
    return Planner(general_path)


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

"""Builds the two ONNX graphs of a bundle from a trained network, operator by operator.

The graphs hold nothing but a handful of standard operators, the LSTM one among them, so that what a bundle may
contain can be listed; normalization is inside. Shapes and layouts are those of `train.network.model`.
"""

from __future__ import annotations

from torch import Tensor

from export.graph_builder import GraphBuilder, add_bound
from train.network.model import ACCELERATION_SCALE, Seq2Seq
from train.network.onnx_weights import float32_array


def encoder_graph(model: Seq2Seq) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    graph = GraphBuilder()
    x = graph.node("Mul", ["command", graph.constant("scale", float32_array(model.command_scale))], "scaled")
    x = graph.node("Transpose", [x], "time_major", perm=[1, 0, 2])
    axis = graph.axes("direction_axis", 1)
    for layer in range(model.layers):
        graph.lstm(model.encoder_lstm, layer, [x], [f"y{layer}", f"h{layer}", f"c{layer}"])
        if layer + 1 < model.layers:
            x = graph.node("Squeeze", [f"y{layer}", axis], f"x{layer + 1}")
    graph.node("Concat", [f"h{layer}" for layer in range(model.layers)], "hidden", axis=0)
    graph.node("Concat", [f"c{layer}" for layer in range(model.layers)], "cell", axis=0)
    state: list[str | int] = [model.layers, "batch", model.units]
    return graph.model("encoder", {"command": ["batch", "chunks", 4 * model.chunk]}, {"hidden": state, "cell": state})


def decoder_step_graph(model: Seq2Seq) -> bytes:
    """Return the serialized decoder iteration: `observation`, `hidden`, `cell` to accelerations and the next state."""
    graph = GraphBuilder()
    width = (8 + 4 * model.command_ahead) * model.chunk
    layers = range(model.layers)
    x = graph.node("Mul", ["observation", graph.constant("scale", float32_array(model.observation_scale))], "scaled")
    x = graph.node("Unsqueeze", [x, graph.axes("time_axis", 0)], "one_step")
    for name in ("hidden", "cell"):
        graph.split(name, [f"{name}{layer}" for layer in layers], axis=0, num_outputs=model.layers)
    for layer in layers:
        graph.lstm(
            model.decoder_lstm,
            layer,
            [x, f"hidden{layer}", f"cell{layer}"],
            ["", f"next_hidden{layer}", f"next_cell{layer}"],
        )
        x = f"next_hidden{layer}"
    graph.node("Concat", [f"next_hidden{layer}" for layer in layers], "hidden_out", axis=0)
    graph.node("Concat", [f"next_cell{layer}" for layer in layers], "cell_out", axis=0)

    x = graph.node("Squeeze", [x, "time_axis"], "top")
    x = _linear(graph, "feedforward", x, model.feedforward.weight, model.feedforward.bias)
    x = graph.node("Tanh", [x], "features")
    # The rows of the output layer beyond 2C are the covariances, which only training needs.
    means = 2 * model.chunk
    x = _linear(graph, "output", x, model.output.weight[:means], model.output.bias[:means])
    x = graph.node("Mul", [x, graph.scalar("acceleration_scale", ACCELERATION_SCALE)], "raw")
    bounded = model.acceleration_bound is not None
    shape = graph.axes("acceleration_shape", 0, model.chunk, 2)
    x = graph.node("Reshape", [x, shape], "unbounded" if bounded else "pan_acceleration")
    if model.acceleration_bound is not None:
        add_bound(graph, x, model.acceleration_bound)

    state: list[str | int] = [model.layers, "batch", model.units]
    return graph.model(
        "decoder_step",
        {"observation": ["batch", width], "hidden": state, "cell": state},
        {"pan_acceleration": ["batch", model.chunk, 2], "hidden_out": state, "cell_out": state},
    )


def _linear(graph: GraphBuilder, name: str, x: str, weight: Tensor, bias: Tensor) -> str:
    w, b = graph.constant(f"{name}.weight", float32_array(weight)), graph.constant(f"{name}.bias", float32_array(bias))
    return graph.node("Gemm", [x, w, b], name, transB=1)

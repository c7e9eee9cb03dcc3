"""Builds the two ONNX graphs of a bundle from a trained network for one pan, operator by operator.

The graphs hold nothing but a handful of standard operators, the LSTM one among them, so that what a bundle may
contain can be listed; normalization is inside. Shapes and layouts are those of `train.network.model`.
"""

from __future__ import annotations

from torch import Tensor, nn

from export.graph_builder import GraphBuilder, add_bound
from train.network.model import ACCELERATION_SCALE, Seq2Seq
from train.network.onnx_weights import float32_array

Shape = list[str | int]


def encoder_graph(model: Seq2Seq) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    return lstm_encoder(model.encoder_lstm, model.command_scale)


def decoder_step_graph(model: Seq2Seq) -> bytes:
    """Return the serialized decoder iteration: `observation`, `hidden`, `cell` to accelerations and the next state."""
    graph = GraphBuilder()
    # The rows of the output layer beyond 2C are the covariances, which only training needs.
    means = 2 * model.chunk
    output = model.output.weight[:means], model.output.bias[:means]
    raw = lstm_decoder(
        graph, model.decoder_lstm, model.observation_scale, model.feedforward, output, ACCELERATION_SCALE
    )
    add_answer(graph, raw, model.chunk, model.acceleration_bound)
    return decoder_model(graph, model.decoder_lstm, [model.chunk, 2])


def lstm_encoder(lstm: nn.LSTM, scale: Tensor) -> bytes:
    """Return the serialized encoder of an LSTM whose inputs (width,) are multiplied by `scale`."""
    graph, layers = GraphBuilder(), lstm.num_layers
    x = graph.node("Mul", ["command", graph.constant("scale", float32_array(scale))], "scaled")
    x = graph.node("Transpose", [x], "time_major", perm=[1, 0, 2])
    axis = graph.axes("direction_axis", 1)
    for layer in range(layers):
        graph.lstm(lstm, layer, [x], [f"y{layer}", f"h{layer}", f"c{layer}"])
        if layer + 1 < layers:
            x = graph.node("Squeeze", [f"y{layer}", axis], f"x{layer + 1}")
    graph.node("Concat", [f"h{layer}" for layer in range(layers)], "hidden", axis=0)
    graph.node("Concat", [f"c{layer}" for layer in range(layers)], "cell", axis=0)
    state: Shape = [layers, "batch", lstm.hidden_size]
    return graph.model("encoder", {"command": ["batch", "chunks", len(scale)]}, {"hidden": state, "cell": state})


def lstm_decoder(
    graph: GraphBuilder,
    lstm: nn.LSTM,
    scale: Tensor,
    feedforward: nn.Linear,
    output: tuple[Tensor, Tensor],
    unit: float,
) -> str:
    """Add one iteration of a decoder, and return the name of what its output layer gives.

    Args:
        graph: what it is added to.
        lstm: its layers.
        scale: (width,) what the inputs are multiplied by.
        feedforward: the tanh layer.
        output: weight and bias of the output layer.
        unit: its unit of acceleration.
    """
    layers = range(lstm.num_layers)
    x = graph.node("Mul", ["observation", graph.constant("scale", float32_array(scale))], "scaled")
    x = graph.node("Unsqueeze", [x, graph.axes("time_axis", 0)], "one_step")
    for name in ("hidden", "cell"):
        graph.split(name, [f"{name}{layer}" for layer in layers], axis=0, num_outputs=lstm.num_layers)
    for layer in layers:
        graph.lstm(
            lstm,
            layer,
            [x, f"hidden{layer}", f"cell{layer}"],
            ["", f"next_hidden{layer}", f"next_cell{layer}"],
        )
        x = f"next_hidden{layer}"
    graph.node("Concat", [f"next_hidden{layer}" for layer in layers], "hidden_out", axis=0)
    graph.node("Concat", [f"next_cell{layer}" for layer in layers], "cell_out", axis=0)
    x = graph.node("Squeeze", [x, "time_axis"], "top")
    x = _linear(graph, "feedforward", x, feedforward.weight, feedforward.bias)
    x = _linear(graph, "output", graph.node("Tanh", [x], "features"), *output)
    return graph.node("Mul", [x, graph.scalar("acceleration_scale", unit)], "raw")


def add_answer(graph: GraphBuilder, raw: str, chunk: int, bound: float | None) -> None:
    """Add what makes accelerations (B, C, 2) of the output layer's (B, 2C), within a bound if there is one (m/s^2)."""
    shape = graph.axes("acceleration_shape", 0, chunk, 2)
    x = graph.node("Reshape", [raw, shape], "pan_acceleration" if bound is None else "unbounded")
    if bound is not None:
        add_bound(graph, x, bound)


def decoder_model(graph: GraphBuilder, lstm: nn.LSTM, answer: list[int]) -> bytes:
    """Serialize a decoder; `answer` is the shape of what it gives for one plan."""
    state: Shape = [lstm.num_layers, "batch", lstm.hidden_size]
    return graph.model(
        "decoder_step",
        {"observation": ["batch", lstm.input_size], "hidden": state, "cell": state},
        {"pan_acceleration": ["batch", *answer], "hidden_out": state, "cell_out": state},
    )


def _linear(graph: GraphBuilder, name: str, x: str, weight: Tensor, bias: Tensor) -> str:
    w, b = graph.constant(f"{name}.weight", float32_array(weight)), graph.constant(f"{name}.bias", float32_array(bias))
    return graph.node("Gemm", [x, w, b], name, transB=1)

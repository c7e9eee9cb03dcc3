"""Builds the two ONNX graphs of a bundle from a trained network, operator by operator.

The graphs hold nothing but a handful of standard operators, the LSTM one among them, so that what a bundle may
contain can be listed. What goes in is in the network's units, before any gain (`runtime.network.units`: READ and
OBSERVED); the gains are in the graphs. The decoder sees its last row of states twice, under two gains: here it is given
once, and the weights are added.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from export.graph_builder import GraphBuilder, float32_array
from runtime.limits import WEIGHT_KEPT
from runtime.network.units import (
    ACCELERATION,
    AHEAD_ROWS,
    CHUNK,
    CONDITIONS,
    ENCODER_ROWS,
    OBSERVED,
    SEEN_ROWS,
    USUAL_GRAVITY,
)
from train.network.network import (
    ACCELERATION_GAIN,
    COMMAND_GAINS,
    ENCODER_GAINS,
    FLOOR_SHARPNESS,
    NOW_GAINS,
    OUTPUT_SCALE,
    SQUARE_FLOOR,
    STATE_GAINS,
    Network,
)

Shape = list[str | int]

ENCODER_SCALE = torch.tensor([*ENCODER_GAINS * len(ENCODER_ROWS), *[1.0] * CONDITIONS])

DECODER_SCALE = torch.tensor(
    [
        *STATE_GAINS * len(SEEN_ROWS),
        *[ACCELERATION_GAIN] * 3,
        *COMMAND_GAINS * len(AHEAD_ROWS),
        *[1.0] * (CONDITIONS + 1),
    ]
)


def encoder_graph(network: Network) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    return lstm_encoder(network.encoder_lstm, ENCODER_SCALE)


def decoder_step_graph(network: Network) -> bytes:
    """Return the serialized decoder iteration: `observation`, `hidden`, `cell` to accelerations and the next state."""
    graph, lstm = GraphBuilder(), seen_once(network.decoder_lstm)
    output = network.output.weight, network.output.bias
    raw = lstm_decoder(graph, lstm, DECODER_SCALE, network.feedforward, output, OUTPUT_SCALE)
    add_answer(graph, raw)
    return decoder_model(graph, lstm)


def seen_once(lstm: nn.LSTM) -> nn.LSTM:
    """Return a decoder's LSTM that is given the last row of states once."""
    once = nn.LSTM(OBSERVED, lstm.hidden_size, lstm.num_layers)
    weights = lstm.state_dict()
    seen = 10 * len(SEEN_ROWS)
    first, now, again, others = torch.split(weights["weight_ih_l0"], [seen - 10, 10, 10, OBSERVED - seen], dim=1)
    both: Tensor = now + again * torch.tensor(NOW_GAINS)
    once.load_state_dict(weights | {"weight_ih_l0": torch.cat([first, both, others], dim=1)})
    return once


def add_answer(graph: GraphBuilder, raw: str) -> None:
    """Add what makes accelerations (B, CHUNK, 3) within the limits of the output layer's (B, 3 CHUNK).

    It is `train.network.network.bounded`, with softplus(t) as relu(t) + log(1 + exp(-|t|)), which cannot overflow.
    Floor and lift are those of the conditions in the observation.
    """
    sizes = graph.axes("condition_sizes", OBSERVED - CONDITIONS - 1, 1, 1, CONDITIONS - 1)
    _, gravity, lift, _ = graph.split("observation", ["moving", "log_gravity", "lift", "others"], sizes, axis=1)
    falling = graph.scalar("falling", (1.0 - WEIGHT_KEPT) * USUAL_GRAVITY)
    floor = graph.node("Mul", [graph.node("Exp", [gravity], "gravity"), falling], "floor")
    x, y, z = graph.split(raw, ["x", "y", "z_raw"], axis=1, num_outputs=3)
    z = graph.node("Mul", [z, lift], "z")
    squares = [graph.node("Mul", [part, part], f"{part}_squared") for part in (x, y, z)]
    total = graph.node("Add", [graph.node("Add", squares[:2], "plane_squared"), squares[2]], "space_squared")
    floored = graph.node("Add", [total, graph.scalar("square_floor", SQUARE_FLOOR)], "size_squared")
    relative = graph.node(
        "Div", [graph.node("Sqrt", [floored], "size"), graph.scalar("limit", ACCELERATION)], "relative"
    )
    share = graph.node("Div", [graph.node("Tanh", [relative], "saturated"), relative], "share")
    x, y, z = (graph.node("Mul", [part, share], f"{part}_bounded") for part in (x, y, z))
    sharpness = graph.scalar("sharpness", FLOOR_SHARPNESS)
    t = graph.node("Mul", [graph.node("Add", [z, floor], "above_floor"), sharpness], "t")
    decay = graph.node("Exp", [graph.node("Neg", [graph.node("Abs", [t], "t_size")], "t_falling")], "decay")
    bend = graph.node("Log", [graph.node("Add", [decay, graph.scalar("one", 1.0)], "one_and_decay")], "bend")
    soft = graph.node("Add", [graph.node("Relu", [t], "t_positive"), bend], "softplus")
    z = graph.node("Sub", [graph.node("Div", [soft, sharpness], "above"), floor], "z_above_floor")
    # A level pan's lift is 0, every other one's far above a millionth.
    scaled = graph.node("Mul", [lift, graph.scalar("steep", 1e6)], "lift_scaled")
    lifts = graph.node("Clip", [scaled, graph.scalar("nothing", 0.0), "one"], "lifts")
    z = graph.node("Mul", [z, lifts], "z_lifting")
    axis = graph.axes("column_axis", -1)
    columns = [graph.node("Unsqueeze", [part, axis], f"{part}_column") for part in (x, y, z)]
    graph.node("Concat", columns, "pan_acceleration", axis=-1)


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


def decoder_model(graph: GraphBuilder, lstm: nn.LSTM) -> bytes:
    """Serialize a decoder."""
    state: Shape = [lstm.num_layers, "batch", lstm.hidden_size]
    return graph.model(
        "decoder_step",
        {"observation": ["batch", lstm.input_size], "hidden": state, "cell": state},
        {"pan_acceleration": ["batch", CHUNK, 3], "hidden_out": state, "cell_out": state},
    )


def _linear(graph: GraphBuilder, name: str, x: str, weight: Tensor, bias: Tensor) -> str:
    w, b = graph.constant(f"{name}.weight", float32_array(weight)), graph.constant(f"{name}.bias", float32_array(bias))
    return graph.node("Gemm", [x, w, b], name, transB=1)

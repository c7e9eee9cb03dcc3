"""Builds the two ONNX graphs of a network for every pan; see `export.float_graphs` and `train.general.network`.

What goes in is in the network's units, by rows, before any gain: the gains are in the graphs.

    encoder        command      (B, chunks, 4 x rows + CONDITIONS)  rows x, y, vx, vy of ENCODER_ROWS, relative to the
                                window's first position, then the conditions
    decoder_step   observation  (B, OBSERVED)  rows of 10 of SEEN_ROWS, the object's position relative to the command's
                                now; the last acceleration (3); rows of 4 of AHEAD_ROWS, the position relative to now's;
                                the conditions; samples executed since the last question, over CHUNK
                   bounds       (B, 2)  floor and lift of the situation
    and out        pan_acceleration (B, CHUNK, 3)
"""

from __future__ import annotations

import numpy as np
from torch import nn

from export.graph_builder import GraphBuilder
from runtime.network.units import (
    ACCELERATION,
    AHEAD_ROWS,
    CHUNK,
    CONDITIONS,
    ENCODER_ROWS,
    SEEN_ROWS,
)
from train.general.network import (
    ACCELERATION_GAIN,
    COMMAND_GAINS,
    ENCODER_GAINS,
    FLOOR_SHARPNESS,
    NOW_GAINS,
    OUTPUT_SCALE,
    STATE_GAINS,
    GeneralNetwork,
)
from train.network.model import SQUARE_FLOOR
from train.network.onnx_weights import float32_array

OBSERVED = 10 * len(SEEN_ROWS) + 3 + 4 * len(AHEAD_ROWS) + CONDITIONS + 1
"""Width of `observation`: that of `train.general.network.OBSERVATION` less the last row's second appearance."""


def general_encoder_graph(network: GeneralNetwork) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    graph = GraphBuilder()
    gains = np.concatenate([np.tile(ENCODER_GAINS, len(ENCODER_ROWS)), np.ones(CONDITIONS)]).astype(np.float32)
    x = graph.node("Mul", ["command", graph.constant("scale", gains)], "scaled")
    x = graph.node("Transpose", [x], "time_major", perm=[1, 0, 2])
    axis = graph.axes("direction_axis", 1)
    for layer in range(network.layers):
        graph.lstm(network.encoder_lstm, layer, [x], [f"y{layer}", f"h{layer}", f"c{layer}"])
        if layer + 1 < network.layers:
            x = graph.node("Squeeze", [f"y{layer}", axis], f"x{layer + 1}")
    graph.node("Concat", [f"h{layer}" for layer in range(network.layers)], "hidden", axis=0)
    graph.node("Concat", [f"c{layer}" for layer in range(network.layers)], "cell", axis=0)
    state: list[str | int] = [network.layers, "batch", network.units]
    width = 4 * len(ENCODER_ROWS) + CONDITIONS
    return graph.model("encoder", {"command": ["batch", "chunks", width]}, {"hidden": state, "cell": state})


def general_decoder_step_graph(network: GeneralNetwork) -> bytes:
    """Return the serialized decoder: `observation`, `bounds`, `hidden`, `cell` to accelerations and the next state."""
    graph = GraphBuilder()
    layers = range(network.layers)
    gains = np.concatenate(
        [
            np.tile(STATE_GAINS, len(SEEN_ROWS)),
            np.full(3, ACCELERATION_GAIN),
            np.tile(COMMAND_GAINS, len(AHEAD_ROWS)),
            np.ones(CONDITIONS + 1),
        ]
    ).astype(np.float32)
    x = graph.node("Mul", ["observation", graph.constant("scale", gains)], "scaled")
    seen = 10 * len(SEEN_ROWS)
    sizes = graph.axes("part_sizes", seen - 10, 10, OBSERVED - seen)
    before, now, others = graph.split(x, ["before", "now", "others"], sizes, axis=1)
    again = graph.node("Mul", [now, graph.constant("now_scale", np.array(NOW_GAINS, np.float32))], "now_again")
    x = graph.node("Concat", [before, now, again, others], "seen", axis=1)
    x = graph.node("Unsqueeze", [x, graph.axes("time_axis", 0)], "one_step")
    for name in ("hidden", "cell"):
        graph.split(name, [f"{name}{layer}" for layer in layers], axis=0, num_outputs=network.layers)
    for layer in layers:
        graph.lstm(
            network.decoder_lstm,
            layer,
            [x, f"hidden{layer}", f"cell{layer}"],
            ["", f"next_hidden{layer}", f"next_cell{layer}"],
        )
        x = f"next_hidden{layer}"
    graph.node("Concat", [f"next_hidden{layer}" for layer in layers], "hidden_out", axis=0)
    graph.node("Concat", [f"next_cell{layer}" for layer in layers], "cell_out", axis=0)

    x = graph.node("Squeeze", [x, "time_axis"], "top")
    x = graph.node("Tanh", [_linear(graph, "feedforward", x, network.feedforward)], "features")
    x = _linear(graph, "output", x, network.output)
    raw = graph.node("Mul", [x, graph.scalar("output_scale", OUTPUT_SCALE)], "raw")
    add_bounds(graph, raw)

    state: list[str | int] = [network.layers, "batch", network.units]
    return graph.model(
        "decoder_step",
        {"observation": ["batch", OBSERVED], "bounds": ["batch", 2], "hidden": state, "cell": state},
        {"pan_acceleration": ["batch", CHUNK, 3], "hidden_out": state, "cell_out": state},
    )


def add_bounds(graph: GraphBuilder, raw: str) -> None:
    """Add `train.general.network.bounded`, with softplus(t) as relu(t) + log(1 + exp(-|t|)), which cannot overflow."""
    x, y, z = graph.split(raw, ["x", "y", "z_raw"], axis=1, num_outputs=3)
    floor, lift = graph.split("bounds", ["floor", "lift"], axis=1, num_outputs=2)
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
    lifts = graph.node("Clip", [scaled, graph.scalar("zero", 0.0), "one"], "lifts")
    z = graph.node("Mul", [z, lifts], "z_lifting")
    axis = graph.axes("column_axis", -1)
    columns = [graph.node("Unsqueeze", [part, axis], f"{part}_column") for part in (x, y, z)]
    graph.node("Concat", columns, "pan_acceleration", axis=-1)


def _linear(graph: GraphBuilder, name: str, x: str, layer: nn.Linear) -> str:
    weight = graph.constant(f"{name}.weight", float32_array(layer.weight))
    bias = graph.constant(f"{name}.bias", float32_array(layer.bias))
    return graph.node("Gemm", [x, weight, bias], name, transB=1)

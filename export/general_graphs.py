"""Builds the two ONNX graphs of a network for every pan; see `export.float_graphs` and `train.general.network`.

What goes in is in the network's units, before any gain (`runtime.network.units`: READ and OBSERVED); the gains are in
the graphs. The decoder sees its last row of states twice, under two gains: here it is given once, and the weights are
added.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from export.float_graphs import decoder_model, lstm_decoder, lstm_encoder
from export.graph_builder import GraphBuilder
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

ENCODER_SCALE = torch.tensor([*ENCODER_GAINS * len(ENCODER_ROWS), *[1.0] * CONDITIONS])

DECODER_SCALE = torch.tensor(
    [
        *STATE_GAINS * len(SEEN_ROWS),
        *[ACCELERATION_GAIN] * 3,
        *COMMAND_GAINS * len(AHEAD_ROWS),
        *[1.0] * (CONDITIONS + 1),
    ]
)


def general_encoder_graph(network: GeneralNetwork) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    return lstm_encoder(network.encoder_lstm, ENCODER_SCALE)


def general_decoder_step_graph(network: GeneralNetwork) -> bytes:
    """Return the serialized decoder iteration: `observation`, `hidden`, `cell` to accelerations and the next state."""
    graph, lstm = GraphBuilder(), seen_once(network.decoder_lstm)
    output = network.output.weight, network.output.bias
    raw = lstm_decoder(graph, lstm, DECODER_SCALE, network.feedforward, output, OUTPUT_SCALE)
    add_answer_in_space(graph, raw)
    return decoder_model(graph, lstm, [CHUNK, 3])


def seen_once(lstm: nn.LSTM) -> nn.LSTM:
    """Return a decoder's LSTM that is given the last row of states once."""
    once = nn.LSTM(OBSERVED, lstm.hidden_size, lstm.num_layers)
    weights = lstm.state_dict()
    seen = 10 * len(SEEN_ROWS)
    first, now, again, others = torch.split(weights["weight_ih_l0"], [seen - 10, 10, 10, OBSERVED - seen], dim=1)
    both: Tensor = now + again * torch.tensor(NOW_GAINS)
    once.load_state_dict(weights | {"weight_ih_l0": torch.cat([first, both, others], dim=1)})
    return once


def add_answer_in_space(graph: GraphBuilder, raw: str) -> None:
    """Add what makes accelerations (B, CHUNK, 3) within the limits of the output layer's (B, 3 CHUNK).

    It is `train.general.network.bounded`, with softplus(t) as relu(t) + log(1 + exp(-|t|)), which cannot overflow.
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

"""Builds a bundle's two graphs in 8-bit integers, from the weights of its fp32 ones.

A product x W of activations and weights becomes a product of integers. The weights are quantized per output and keep
to seven bits: where a processor has no 8-bit dot product, products of full-range weights overflow in pairs. The
activations are quantized by scales that are fixed here: what a unit puts out lies between -1 and 1, and the inputs are
divided by their ranges (`layouts`) and held there. Sums of integers have no rounding, so a command's plan does not
depend on what else is in its batch.

The accelerations of neighbouring samples are rounded independently, which would shake the pan: the last layer has two
digits of 8 bits, of features and of weights. The decoder aims by what it sees, and one digit tells positions apart by 2
mm: these inputs have two as well. They are time series, and smooth: the rounding error of a weight goes into the same
channel's weight of the next sample, so that only what changes from sample to sample is multiplied by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from export.float_graphs import add_answer
from export.graph_builder import GraphBuilder
from runtime.documents.checks import FloatArray
from runtime.network.manifest import Manifest
from runtime.network.units import (
    ACCELERATION,
    AHEAD,
    AHEAD_ROWS,
    CHUNK,
    ENCODER_ROWS,
    LARGEST_HEIGHT,
    LARGEST_SPEED,
    REACH,
    SEEN_ROWS,
)

Weights = Mapping[str, NDArray[Any]]

STEPS = 127
"""Steps of an activation from 0 to 1."""

FINE_STEPS = 2 * STEPS * STEPS
"""Steps of one that has two digits."""

Series = Sequence[tuple[int, int]]
"""What the inputs begin with: for each block of time series, row by row, its channels and its samples."""

MAX_WEIGHT = 63

SHUT, OPEN = -40.0, 40.0
"""What is put into a gate that is to let nothing through, or everything, in float32."""

FULL = 20.0
"""A cell whose tanh is 1 in float32."""

CONTRIBUTED = "com.microsoft"
"""Domain of onnxruntime's own operators."""


def weights_of(graph: bytes) -> Weights:
    """Return the weights of a serialized graph by name."""
    return {weight.name: numpy_helper.to_array(weight) for weight in onnx.load_from_string(graph).graph.initializer}


class Layout(NamedTuple):
    """What a graph is given, laid out in one row.

    Attributes:
        ranges: (n,) how far each number is told apart: beyond, it counts as that far.
        series: what it begins with.
        digits: of the decoder's weights of it.
    """

    ranges: FloatArray
    series: Series
    digits: int = 1


FASTEST = 1.1
"""Largest speed of a command that networks are trained on, in their units."""


def layouts() -> tuple[Layout, Layout]:
    """Return the layouts of a command's chunk and of an observation, positions relative to where the command is now.

    Commands may go half as far again, and half as fast, as those trained on.
    """
    velocity = 1.5 * FASTEST
    told = [2.2, 1.0, 2.0, 1.4, 1.0, 1.0, 2.1, 1.8, 3.0, 3.0]
    pan = [1.25 * REACH] * 2 + [1.1 * LARGEST_HEIGHT] + [1.1 * LARGEST_SPEED] * 3
    states = np.tile(pan + [REACH] * 2 + [2.0 * FASTEST] * 2, len(SEEN_ROWS))
    ahead = np.tile([1e-3 * AHEAD * 1.25 * FASTEST] * 2 + [velocity] * 2, len(AHEAD_ROWS))
    command = np.tile([1.5 * REACH] * 2 + [velocity] * 2, len(ENCODER_ROWS))
    observation = np.concatenate([states, [1.25 * ACCELERATION] * 3, ahead, told, [1.0]])
    series = [(10, len(SEEN_ROWS)), (3, 1), (4, len(AHEAD_ROWS))]
    # The weights of what is seen of now are five times as large as the others, of which one digit would leave little.
    return Layout(np.concatenate([command, told]), [(4, len(ENCODER_ROWS))]), Layout(observation, series, digits=2)


def integer_encoder(weights: Weights, manifest: Manifest) -> bytes:
    """Return the serialized encoder.

    onnxruntime's LSTM in integers takes the smallest and the largest of all its input, and of all that its units put
    out, for the range to be quantized. Two more columns, which are always 1 and -1 and have no weights, and two more
    units, which put out the same and are cut off in the end, make both ranges [-1, 1], whatever is in the batch.
    """
    graph, units, layers = GraphBuilder(), manifest.units, range(manifest.layers)
    scale = weights["scale"].astype(np.float64)
    size, series, _ = layouts()[0]
    low, zero, high = (graph.scalar(name, value) for name, value in (("low", -1.0), ("zero", 0.0), ("high", 1.0)))
    x = graph.node("Mul", ["command", graph.constant("per_range", (1.0 / size).astype(np.float32))], "scaled")
    x = graph.node("Transpose", [graph.node("Clip", [x, low, high], "held")], "time_major", perm=[1, 0, 2])
    begin, end, axis = graph.axes("begin", 0), graph.axes("end", 1), graph.axes("column_axis", 2)
    column = graph.node("Slice", [x, begin, end, axis], "column")
    ends = [graph.node("Clip", [column, value, value], f"always_{value}") for value in (high, low)]
    x = graph.node("Concat", [x, *ends], "padded", axis=2)
    nothing = graph.node("Clip", [graph.node("Slice", [column, begin, end, begin], "first"), zero, zero], "nothing")
    cells = np.zeros((1, 1, units + 2), dtype=np.float32)
    cells[..., units:] = FULL, -FULL
    cells_before = graph.node("Add", [nothing, graph.constant("cells", cells)], "cells_before")

    width, size = len(size), scale * size
    for layer in layers:
        w, r, b = _lstm(weights, layer)
        names = [f"lstm{layer}.{name}" for name in ("W", "W_scale", "W_zero", "R", "R_scale", "R_zero")]
        for matrix, (integers, scales, zeros), smooth in (
            (w * size, names[:3], series),
            (r, names[3:], []),
        ):
            value, step = to_integers(_two_more_units(np.pad(matrix.T, ((0, 2), (0, 0)))), smooth)
            graph.constant(integers, value[None])
            graph.constant(scales, step[None])
            graph.constant(zeros, np.zeros((1, len(step)), dtype=np.int8))
        gates = _two_more_units(b, (SHUT, OPEN, OPEN, 0.0))
        bias = graph.constant(f"lstm{layer}.B", np.concatenate([gates, 0.0 * gates])[None].astype(np.float32))
        inputs = [x, names[0], names[3], bias, "", "", cells_before, "", *names[1:3], *names[4:]]
        outputs = [f"y{layer}", f"h{layer}", f"c{layer}"]
        graph.nodes.append(
            helper.make_node(
                "DynamicQuantizeLSTM", inputs, outputs, f"lstm{layer}", domain=CONTRIBUTED, hidden_size=units + 2
            )
        )
        if layer + 1 < manifest.layers:
            x = graph.node("Squeeze", [f"y{layer}", end], f"x{layer + 1}")
            size, series = np.ones(units), []
    first = graph.axes("units", units)
    for name in ("hidden", "cell"):
        every = graph.node("Concat", [f"{name[0]}{layer}" for layer in layers], f"{name}_padded", axis=0)
        graph.node("Slice", [every, begin, first, axis], name)
    state: list[str | int] = [manifest.layers, "batch", units]
    return graph.model(
        "encoder",
        {"command": ["batch", "chunks", width]},
        {"hidden": state, "cell": state},
        (CONTRIBUTED,),
    )


def integer_decoder_step(weights: Weights, manifest: Manifest) -> bytes:
    """Return the serialized decoder iteration, its LSTM layers written out."""
    graph, units, layers = GraphBuilder(), manifest.units, range(manifest.layers)
    graph.scalar("step", 1.0 / STEPS)
    graph.constant("middle", np.array(128, dtype=np.uint8))
    size, series, digits = layouts()[1]
    width = len(size)
    graph.scalar("fine_step", 1.0 / FINE_STEPS)
    scaled = graph.node("Mul", ["observation", graph.constant("per_range", (1.0 / size).astype(np.float32))], "scaled")
    axis = graph.axes("layer_axis", 0)
    before = {
        name: [
            graph.node("Squeeze", [part, axis], f"{part}_before")
            for part in graph.split(name, [f"{name}{n}" for n in layers], axis=0, num_outputs=manifest.layers)
        ]
        for name in ("hidden", "cell")
    }
    after: dict[str, list[str]] = {"hidden": [], "cell": []}
    thirds = graph.axes("gates_and_cell", 3 * units, units)
    size = weights["scale"].astype(np.float64) * size
    x = ""
    for layer in layers:
        w, r, b = _lstm(weights, layer)
        remembered = _quantize(graph, before["hidden"][layer])
        if layer == 0:  # its weights of what it sees are much larger than those of its memory: they have other scales
            seen = _precise_linear(graph, "seen", scaled, w * size, series, digits)
            x = graph.node("Add", [seen, _linear(graph, "remembered", remembered, r, b)], "lstm0")
        else:
            x = graph.node("Concat", [x, remembered], f"seen{layer}", axis=1)
            x = _linear(graph, f"lstm{layer}", x, np.concatenate([w, r], axis=1), b)
        gates, new = graph.split(x, [f"gates{layer}", f"new{layer}"], thirds, axis=1)
        gates = graph.node("Sigmoid", [gates], f"open{layer}")
        i, o, f = graph.split(gates, [f"{name}{layer}" for name in "iof"], axis=1, num_outputs=3)
        kept = graph.node("Mul", [f, before["cell"][layer]], f"kept{layer}")
        added = graph.node("Mul", [i, graph.node("Tanh", [new], f"c{layer}")], f"added{layer}")
        cell = graph.node("Add", [kept, added], f"next_cell{layer}")
        hidden = graph.node("Mul", [o, graph.node("Tanh", [cell], f"shown{layer}")], f"next_hidden{layer}")
        for name, value in (("hidden", hidden), ("cell", cell)):
            after[name].append(graph.node("Unsqueeze", [value, axis], f"{value}_after"))
        x = _quantize(graph, hidden)
    for name, values in after.items():
        graph.node("Concat", values, f"{name}_out", axis=0)

    x = _linear(graph, "feedforward", x, weights["feedforward.weight"], weights["feedforward.bias"])
    x = graph.node("Tanh", [x], "features")
    unit = weights["acceleration_scale"].item()
    w, b = (unit * weights[f"output.{name}"].astype(np.float64) for name in ("weight", "bias"))
    x = _precise_linear(graph, "output", x, w, digits=2)
    x = graph.node("Add", [x, graph.constant("output.bias", b.astype(np.float32))], "output")
    add_answer(graph, x)
    state: list[str | int] = [manifest.layers, "batch", units]
    return graph.model(
        "decoder_step",
        {"observation": ["batch", width], "hidden": state, "cell": state},
        {"pan_acceleration": ["batch", CHUNK, 3], "hidden_out": state, "cell_out": state},
    )


def _lstm(weights: Weights, layer: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a layer's weights of its input and of its memory, (4 units, ...), and its bias (4 units,)."""
    w, r, b = (weights[f"lstm{layer}.{name}"][0].astype(np.float64) for name in "WRB")
    half = len(b) // 2
    return w, r, b[:half] + b[half:]


def _quantize(graph: GraphBuilder, x: str) -> str:
    """Add the activations in integers, from values in [-1, 1]; what is beyond is held there."""
    return graph.node("QuantizeLinear", [x, "step", "middle"], f"{x}_integers")


def _linear(graph: GraphBuilder, name: str, x: str, weight: FloatArray, bias: FloatArray) -> str:
    """Add weight x + bias (outputs, inputs) of activations in integers."""
    integers, scale = to_integers(weight.T)
    total = graph.node("MatMulInteger", [x, graph.constant(f"{name}.weight", integers), "middle"], f"{name}_total")
    total = graph.node("Cast", [total], f"{name}_float", to=TensorProto.FLOAT)
    scaled = graph.node("Mul", [total, graph.constant(f"{name}.scale", scale / np.float32(STEPS))], f"{name}_scaled")
    return graph.node("Add", [scaled, graph.constant(f"{name}.bias", bias.astype(np.float32))], name)


def _precise_linear(
    graph: GraphBuilder, name: str, x: str, weight: FloatArray, series: Series = (), digits: int = 1
) -> str:
    """Add weight x (outputs, inputs) of values in [-1, 1] by their two digits, which are rows multiplied at once.

    Args:
        graph, name, x: what it is added to, its name and that of the values.
        weight: (outputs, inputs).
        series: see `to_integers`.
        digits: of the weights; the second ones are what the first have left.
    """
    high = _quantize(graph, x)
    rest = graph.node("Sub", [x, graph.node("DequantizeLinear", [high, "step", "middle"], f"{x}_high")], f"{x}_rest")
    low = graph.node("QuantizeLinear", [rest, "fine_step", "middle"], f"{rest}_integers")
    rows = graph.node("Concat", [high, low], f"{x}_digits", axis=0)
    left, terms = weight.T, []
    for digit in range(digits):
        integers, scale = to_integers(left, series)
        left = left - integers * scale
        product = f"{name}_{digit}"
        total = graph.node("MatMulInteger", [rows, graph.constant(f"{product}.weight", integers), "middle"], product)
        total = graph.node("Cast", [total], f"{product}_float", to=TensorProto.FLOAT)
        parts = graph.split(total, [f"{product}_high", f"{product}_low"], axis=0, num_outputs=2)
        for part, steps in zip(parts, (STEPS, FINE_STEPS), strict=True):
            worth = graph.constant(f"{part}.scale", scale / np.float32(steps))
            terms.append(graph.node("Mul", [part, worth], f"{part}_scaled"))
    while len(terms) > 1:
        terms = [graph.node("Add", terms[:2], f"{name}_sum{len(terms)}"), *terms[2:]]
    return terms[0]


def to_integers(weight: FloatArray, series: Series = ()) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Return weights (inputs, outputs) in integers, and what one is worth in each output.

    Where the inputs are time series, what rounding takes from a weight is given to the next sample's.
    """
    largest = np.abs(weight).max(axis=0)
    scale = np.where(largest > 0.0, largest, 1.0) / MAX_WEIGHT
    wanted = np.ascontiguousarray(weight / scale)
    begin = 0
    for channels, samples in series:
        rows = wanted[begin : begin + channels * samples].reshape(samples, channels, wanted.shape[1])
        owed = np.zeros((channels, wanted.shape[1]))
        for k in range(samples):
            rounded = np.clip(np.round(rows[k] + owed), -MAX_WEIGHT, MAX_WEIGHT)
            owed = rows[k] + owed - rounded
            rows[k] = rounded
        begin += channels * samples
    return np.round(wanted).astype(np.int8), scale.astype(np.float32)


def _two_more_units(gates: FloatArray, fill: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> FloatArray:
    """Return the gates i, o, f, c along the last axis with two more units in each, which have the value `fill`."""
    parts = np.split(gates, 4, axis=-1)
    width = [(0, 0)] * (gates.ndim - 1) + [(0, 2)]
    return np.concatenate(
        [np.pad(part, width, constant_values=value) for part, value in zip(parts, fill, strict=True)], axis=-1
    )

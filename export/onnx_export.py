"""Builds the two ONNX graphs of a bundle from a trained network, operator by operator.

The graphs hold nothing but a handful of standard operators, the LSTM one among them, so that what a bundle may
contain can be listed; normalization is inside. Shapes and layouts are those of `train.model`.
"""

from __future__ import annotations

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from train.model import ACCELERATION_SCALE, SQUARE_FLOOR, Seq2Seq

OPSET = 18
"""Operator set of the graphs: the first whose Split takes `num_outputs`."""

IR_VERSION = 9
"""File format version: old enough for every onnxruntime that the runtime supports."""


class GraphBuilder:
    """Collects the nodes and weights of one graph; every method returns the name of its output."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []

    def constant(self, name: str, value: NDArray[np.generic]) -> str:
        self.weights.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def scalar(self, name: str, value: float) -> str:
        return self.constant(name, np.array(value, dtype=np.float32))

    def axes(self, name: str, *values: int) -> str:
        return self.constant(name, np.array(values, dtype=np.int64))

    def node(self, operator: str, inputs: list[str], output: str, **attributes: object) -> str:
        self.nodes.append(helper.make_node(operator, inputs, [output], name=output, **attributes))
        return output

    def lstm(self, module: nn.LSTM, layer: int, inputs: list[str], outputs: list[str]) -> None:
        """Add one layer of `module`: `inputs` are X and, if carried, initial h and c; `outputs` are Y, Y_h, Y_c."""
        w_ih, w_hh, b_ih, b_hh = (_onnx_gates(weight) for weight in module.all_weights[layer])
        names = [
            self.constant(f"lstm{layer}.W", w_ih[None]),
            self.constant(f"lstm{layer}.R", w_hh[None]),
            self.constant(f"lstm{layer}.B", np.concatenate([b_ih, b_hh])[None]),
        ]
        carried = ["", *inputs[1:]] if len(inputs) > 1 else []
        self.nodes.append(
            helper.make_node(
                "LSTM",
                [inputs[0], *names, *carried],
                outputs,
                name=f"lstm{layer}",
                hidden_size=module.hidden_size,
            )
        )

    def split(self, x: str, outputs: list[str], *sizes: str, **attributes: object) -> list[str]:
        self.nodes.append(helper.make_node("Split", [x, *sizes], outputs, name=f"{x}_split", **attributes))
        return outputs

    def model(
        self,
        name: str,
        inputs: dict[str, list[str | int]],
        outputs: dict[str, list[str | int]],
        domains: tuple[str, ...] = (),
    ) -> bytes:
        """Serialize the graph, checked; dimensions given as text are dynamic, `domains` are those of more operators."""
        graph = helper.make_graph(
            self.nodes,
            name,
            [helper.make_tensor_value_info(key, TensorProto.FLOAT, shape) for key, shape in inputs.items()],
            [helper.make_tensor_value_info(key, TensorProto.FLOAT, shape) for key, shape in outputs.items()],
            self.weights,
        )
        operators = [helper.make_opsetid("", OPSET), *(helper.make_opsetid(domain, 1) for domain in domains)]
        model = helper.make_model(graph, producer_name="slide-planner", opset_imports=operators)
        model.ir_version = IR_VERSION
        onnx.checker.check_model(model, full_check=True)
        return bytes(model.SerializeToString(deterministic=True))


def encoder_graph(model: Seq2Seq) -> bytes:
    """Return the serialized encoder: `command` to `hidden`, `cell`."""
    graph = GraphBuilder()
    x = graph.node("Mul", ["command", graph.constant("scale", _array(model.command_scale))], "scaled")
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
    x = graph.node("Mul", ["observation", graph.constant("scale", _array(model.observation_scale))], "scaled")
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


def add_bound(graph: GraphBuilder, u: str, limit: float) -> None:
    """Add `train.model.bound_acceleration`: limit tanh(|u|/limit) u/|u|."""
    squared = graph.node("Mul", [u, u], "squared")
    total = graph.node("ReduceSum", [squared, graph.axes("coordinate_axis", -1)], "size_squared", keepdims=1)
    floored = graph.node("Add", [total, graph.scalar("square_floor", SQUARE_FLOOR)], "size_floored")
    size = graph.node("Sqrt", [floored], "size")
    relative = graph.node("Div", [size, graph.scalar("limit", limit)], "relative")
    factor = graph.node("Div", [graph.node("Tanh", [relative], "saturated"), relative], "factor")
    graph.node("Mul", [u, factor], "pan_acceleration")


def _linear(graph: GraphBuilder, name: str, x: str, weight: Tensor, bias: Tensor) -> str:
    w, b = graph.constant(f"{name}.weight", _array(weight)), graph.constant(f"{name}.bias", _array(bias))
    return graph.node("Gemm", [x, w, b], name, transB=1)


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().astype(np.float32)


def _onnx_gates(weight: Tensor) -> NDArray[np.float32]:
    """Reorder the gates along the first axis: torch has them as i, f, g, o, ONNX as i, o, f, c (its c is torch's g)."""
    i, f, g, o = np.split(_array(weight), 4)
    return np.concatenate([i, o, f, g])

"""Builds ONNX graphs node by node."""

from __future__ import annotations

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

OPSET = 18
"""Operator set of the graphs: the first whose Split takes `num_outputs`."""

IR_VERSION = 9
"""File format version: old enough for every onnxruntime that the runtime supports."""


def float32_array(tensor: Tensor) -> NDArray[np.float32]:
    """Return a tensor as an array."""
    return tensor.detach().cpu().numpy().astype(np.float32)


def onnx_gates(weight: Tensor) -> NDArray[np.float32]:
    """Reorder a weight's gates along its first axis: i, f, g, o in torch; i, o, f, g, which it calls c, in ONNX."""
    i, f, g, o = weight.chunk(4)
    return np.concatenate([float32_array(gate) for gate in (i, o, f, g)])


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
        w_ih, w_hh, b_ih, b_hh = (onnx_gates(weight) for weight in module.all_weights[layer])
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

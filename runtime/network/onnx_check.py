"""Looks through an ONNX file before onnxruntime sees it: what stands in it, and how much it would unpack to.

A file that passes has one flat graph of known operators, and carries its own weights, as many as their shapes say. It
is read as protobuf (https://protobuf.dev/programming-guides/encoding/), field by field of onnx.proto; a field that
graphs of ours have no use for is refused. What a graph of harmless operators computes is not looked into: a bundle of
somebody else's is trusted by its sha256 or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import prod

from runtime.errors import InputError

OPERATORS = {
    "": frozenset(
        [
            "Abs",
            "Add",
            "Cast",
            "Clip",
            "Concat",
            "Constant",
            "DequantizeLinear",
            "Div",
            "DynamicQuantizeLinear",
            "Exp",
            "Flatten",
            "Gather",
            "Gemm",
            "Identity",
            "LSTM",
            "Log",
            "MatMul",
            "MatMulInteger",
            "Max",
            "Min",
            "Mul",
            "Neg",
            "Pow",
            "QuantizeLinear",
            "ReduceMean",
            "ReduceSum",
            "Relu",
            "Reshape",
            "Shape",
            "Sigmoid",
            "Slice",
            "Split",
            "Sqrt",
            "Squeeze",
            "Sub",
            "Tanh",
            "Transpose",
            "Unsqueeze",
        ]
    ),
    "com.microsoft": frozenset(["DynamicQuantizeLSTM", "DynamicQuantizeMatMul"]),
}
"""Operators by domain. None that makes much of little (Expand, Tile, Pad, Range, ConstantOfShape, Resize), none that
holds graphs of its own."""

MAX_NODES = 1000
MAX_DIMENSION = 1 << 24
MAX_ELEMENTS = 1 << 26
"""Most elements of one tensor: the weights of 4096 LSTM units."""

MAX_RANK = 8

ITEM_SIZES = {1: 4, 2: 1, 3: 1, 6: 4, 7: 8, 9: 1, 11: 8}
"""Bytes of an element by ONNX data type: float, uint8, int8, int32, int64, bool, double."""

RAW_DATA = 9
TYPED_DATA = {4: 4, 5: 1, 7: 1, 10: 8}
"""Fields with elements and the fewest bytes that one takes: float_data, int32_data, int64_data, double_data."""

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
FIXED = {FIXED64: 8, FIXED32: 4}

Value = int | memoryview
Check = Callable[[Value], None]


def check_graph(model: bytes) -> None:
    """Check a file's bytes.

    Raises:
        InputError: it is no ONNX file, keeps weights elsewhere, has functions, graphs within graphs, operators that
            are not known here, or shapes that are too large or say more than the file carries.
    """
    graphs = 0

    def graph(value: Value) -> None:
        nonlocal graphs
        graphs += 1
        _check_graph(_message(value))

    _walk(memoryview(model), "model", dict.fromkeys((1, 2, 3, 4, 5, 6, 8, 14)) | {7: graph})
    if graphs != 1:
        raise InputError(f"not a graph onnxruntime can load: it holds {graphs} graphs")


def _check_graph(data: memoryview) -> None:
    nodes = 0

    def node(value: Value) -> None:
        nonlocal nodes
        nodes += 1
        if nodes > MAX_NODES:
            raise InputError(f"has more than {MAX_NODES} operators")
        _check_node(_message(value))

    tensor, value_info = _nested(_check_tensor), _nested(_check_value_info)
    _walk(data, "graph", {1: node, 2: None, 5: tensor, 10: None, 11: value_info, 12: value_info, 13: value_info})


def _check_node(data: memoryview) -> None:
    texts = {4: "", 7: ""}

    def text(field: int) -> Check:
        def keep(value: Value) -> None:
            texts[field] = bytes(_message(value)).decode("utf-8", "replace")

        return keep

    _walk(data, "node", {1: None, 2: None, 3: None, 4: text(4), 5: _nested(_check_attribute), 6: None, 7: text(7)})
    operator, domain = texts[4], "" if texts[7] == "ai.onnx" else texts[7]
    if operator not in OPERATORS.get(domain, ()):
        raise InputError(f"has an operator that is not known here: {domain[:40]!r}.{operator[:40]!r}")


def _check_attribute(data: memoryview) -> None:
    _walk(data, "attribute", dict.fromkeys((1, 2, 3, 4, 7, 8, 9, 13, 20)) | {5: _nested(_check_tensor)})


def _check_tensor(data: memoryview) -> None:
    shape: list[int] = []
    kind, carried, raw_bytes = 0, 0, 0

    def dims(value: Value) -> None:
        shape.extend([value] if isinstance(value, int) else _varints(value))
        if len(shape) > MAX_RANK:
            raise InputError(f"has a tensor of more than {MAX_RANK} axes")

    def data_type(value: Value) -> None:
        nonlocal kind
        kind = value if isinstance(value, int) else 0

    def elements(smallest: int) -> Check:
        def count(value: Value) -> None:
            nonlocal carried
            carried += 1 if isinstance(value, int) else len(value) // smallest

        return count

    def raw(value: Value) -> None:
        nonlocal raw_bytes
        raw_bytes += len(_message(value))

    def elsewhere(value: Value) -> None:
        if value != 0:
            raise InputError("keeps weights in another file, which a bundle must not")

    typed = {field: elements(smallest) for field, smallest in TYPED_DATA.items()}
    known: dict[int, Check | None] = {1: dims, 2: data_type, 8: None, 12: None, RAW_DATA: raw}
    _walk(data, "tensor", known | typed | {13: elsewhere, 14: elsewhere})
    if kind not in ITEM_SIZES:
        raise InputError(f"has a tensor of the data type {kind}")
    carried += raw_bytes // ITEM_SIZES[kind]
    if any(size > MAX_DIMENSION for size in shape) or prod(shape) > MAX_ELEMENTS:
        raise InputError(f"has a tensor of the shape {shape}, more than {MAX_ELEMENTS} elements")
    if prod(shape) > carried:
        raise InputError(f"has a tensor of the shape {shape} that carries {carried} elements")


def _check_value_info(data: memoryview) -> None:
    def dimension(value: Value) -> None:
        if isinstance(value, int) and value > MAX_DIMENSION:
            raise InputError(f"has an axis of the size {value}, at most {MAX_DIMENSION} is taken")

    def dim(data: memoryview) -> None:
        _walk(data, "dimension", {1: dimension, 2: None, 3: None})

    def shape(data: memoryview) -> None:
        _walk(data, "shape", {1: _nested(dim)})

    def tensor_type(data: memoryview) -> None:
        _walk(data, "tensor type", {1: None, 2: _nested(shape)})

    def kind(data: memoryview) -> None:
        _walk(data, "type", {1: _nested(tensor_type), 6: None})

    _walk(data, "value", {1: None, 2: _nested(kind), 3: None})


def _nested(check: Callable[[memoryview], None]) -> Check:
    return lambda value: check(_message(value))


def _message(value: Value) -> memoryview:
    if isinstance(value, int):
        raise _broken()
    return value


def _walk(data: memoryview, name: str, known: Mapping[int, Check | None]) -> None:
    """Hand each field of a message to its check; None is a field that needs none.

    Raises:
        InputError: the bytes are no message, or have a field that is not known.
    """
    for field, value in _fields(data):
        if field not in known:
            raise InputError(f"has a part that is not known here: field {field} of a {name}")
        check = known[field]
        if check is not None:
            check(value)


def _fields(data: memoryview) -> Iterator[tuple[int, Value]]:
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        field, wire = key >> 3, key & 7
        if wire == VARINT:
            value, at = _varint(data, at)
            yield field, value
            continue
        if wire == BYTES:
            size, at = _varint(data, at)
        elif wire in FIXED:
            size = FIXED[wire]
        else:
            raise _broken()
        if field == 0 or size > len(data) - at:
            raise _broken()
        # A fixed number is handed on as one, whatever it is: none of ours is looked at.
        yield field, data[at : at + size] if wire == BYTES else 0
        at += size


def _varints(data: memoryview) -> Iterator[int]:
    at = 0
    while at < len(data):
        value, at = _varint(data, at)
        yield value


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            raise _broken()
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise _broken()


def _broken() -> InputError:
    return InputError("not a graph onnxruntime can load: it is no protobuf")

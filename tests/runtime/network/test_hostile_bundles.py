"""Bundles made to harm: each is refused before onnxruntime sees it, in one line, quickly and in little memory."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.quantization import quantize_dynamic

from runtime import BundleError, Planner
from runtime.network.bundle import Bundle
from runtime.network.onnx_check import check_graph

MakeBundle = Callable[..., Path]
Change = Callable[[Any], None]


def node(*args: Any, **kwargs: Any) -> Change:
    return lambda model: model.graph.node.append(helper.make_node(*args, **kwargs))


def tensor(**fields: Any) -> Change:
    def change(model: Any) -> None:
        added = model.graph.initializer.add()
        added.name, added.data_type = "more", TensorProto.FLOAT
        for name, value in fields.items():
            getattr(added, name).extend(value) if isinstance(value, list) else setattr(added, name, value)

    return change


def external(location: str) -> Change:
    def change(model: Any) -> None:
        weight = model.graph.initializer[0]
        weight.ClearField("raw_data")
        weight.data_location = TensorProto.EXTERNAL
        weight.external_data.add(key="location", value=location)

    return change


def external_key_only(model: Any) -> None:
    model.graph.initializer[0].external_data.add(key="offset", value="0")


def inner_graph(model: Any) -> None:
    inner = helper.make_graph([], "inner", [], [])
    model.graph.node[0].attribute.append(helper.make_attribute("body", inner))


def functions(model: Any) -> None:
    for index in range(3000):
        calls = [helper.make_node(f"f{index + 1}", ["x"], ["y"], domain="here")]
        opsets = [helper.make_opsetid("here", 1)]
        model.functions.append(helper.make_function("here", f"f{index}", ["x"], ["y"], calls, opsets))


def training(model: Any) -> None:
    model.training_info.add()


def sparse(model: Any) -> None:
    model.graph.sparse_initializer.add().dims.extend([1 << 40])


def many_nodes(model: Any) -> None:
    model.graph.node.extend(helper.make_node("Identity", ["command"], [f"copy{index}"]) for index in range(2000))


def huge_input(model: Any) -> None:
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 1 << 40


def sequence_input(model: Any) -> None:
    model.graph.input[0].type.sequence_type.elem_type.tensor_type.elem_type = 1


def huge_constant(model: Any) -> None:
    value = TensorProto(dims=[1 << 20, 1 << 20], data_type=TensorProto.FLOAT)
    model.graph.node.append(helper.make_node("Constant", [], ["c"], value=value))


def string_tensor(model: Any) -> None:
    model.graph.initializer.add(name="s", dims=[1], data_type=TensorProto.STRING, string_data=[b"x"])


HOSTILE: dict[str, tuple[Change, str]] = {
    "weights in a file beside": (external("weights.bin"), "another file"),
    "weights in /etc/passwd": (external("/etc/passwd"), "another file"),
    "weights above the folder": (external("../../secret"), "another file"),
    "a key of weights elsewhere alone": (external_key_only, "another file"),
    "a tensor of a terabyte in a few bytes": (tensor(dims=[1 << 20, 1 << 18]), "has a tensor of the shape"),
    "a tensor that carries less than it says": (tensor(dims=[1000], raw_data=b"1234"), "that carries 1 elements"),
    "a tensor of 32 MiB, typed": (tensor(dims=[1 << 23], float_data=[1.0]), "that carries 1 elements"),
    "an axis below zero": (tensor(dims=[-1]), "has a tensor of the shape"),
    "a product that overflows": (tensor(dims=[1 << 32, 1 << 32]), "has a tensor of the shape"),
    "a hundred axes": (tensor(dims=[1] * 100), "more than 8 axes"),
    "a segment of a tensor": (
        lambda model: model.graph.initializer[0].segment.SetInParent(),
        "not known here: field 3",
    ),
    "texts": (string_tensor, "not known here: field 6"),
    "ConstantOfShape": (node("ConstantOfShape", ["command"], ["c"]), "'ConstantOfShape'"),
    "Expand": (node("Expand", ["command", "zero"], ["c"]), "'Expand'"),
    "Tile": (node("Tile", ["command", "zero"], ["c"]), "'Tile'"),
    "Range": (node("Range", ["a", "b", "c"], ["d"]), "'Range'"),
    "Loop": (node("Loop", ["", ""], ["c"]), "'Loop'"),
    "If": (node("If", ["c"], ["d"]), "'If'"),
    "an operator of another domain": (node("Add", ["a", "b"], ["c"], domain="evil"), "'evil'.'Add'"),
    "Microsoft's file reader": (node("ReadFile", ["a"], ["b"], domain="com.microsoft"), "'ReadFile'"),
    "a custom operator": (node("PyOp", ["a"], ["b"], domain="ai.onnx.contrib"), "'PyOp'"),
    "a graph within an operator": (inner_graph, "field 6 of a attribute"),
    "3,000 functions that call each other": (functions, "field 25 of a model"),
    "training": (training, "field 20 of a model"),
    "a sparse weight": (sparse, "field 15 of a graph"),
    "2,000 operators": (many_nodes, "more than 1000 operators"),
    "an input of a terabyte": (huge_input, "has an axis of the size"),
    "a sequence for an input": (sequence_input, "field 4 of a type"),
    "a constant of a terabyte": (huge_constant, "has a tensor of the shape"),
    "no graph": (lambda model: model.ClearField("graph"), "it holds 0 graphs"),
}


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the test fail if onnxruntime gets to see anything."""
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *_, **__: pytest.fail("onnxruntime saw it"))


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_graph_is_refused_before_onnxruntime_sees_it(
    make_bundle: MakeBundle, make_encoder: Callable[..., bytes], tmp_path: Path, name: str
) -> None:
    change, message = HOSTILE[name]
    model = onnx.load_from_string(make_encoder())
    change(model)
    path = make_bundle(tmp_path, models={"encoder": model.SerializeToString()})
    with pytest.raises(BundleError, match=rf"encoder.onnx: .*{message}") as caught:
        Bundle.load(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize(
    "data",
    [
        b"\x00",
        b"\xff" * 100,
        b"\x3a\xff\xff\xff\xff\x7f",
        b"\x3a" + b"\x80" * 20,
        b"\x38\x01",
        b"\x0b" * 1000,
        b"\x07\x02",
    ],
    ids=[
        "zero",
        "ones",
        "a length past the end",
        "a number without an end",
        "a number for a graph",
        "groups",
        "wire type 7",
    ],
)
def test_bytes_that_are_no_protobuf_are_refused(make_bundle: MakeBundle, tmp_path: Path, data: bytes) -> None:
    with pytest.raises(BundleError, match=r"encoder.onnx: not a graph onnxruntime can load"):
        Bundle.load(make_bundle(tmp_path, models={"encoder": data}))


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize(("key", "value"), [("units", 10**9), ("layers", 10**6)])
def test_manifest_that_asks_for_all_memory_is_refused(
    make_bundle: MakeBundle, tmp_path: Path, key: str, value: int
) -> None:
    with pytest.raises(BundleError, match=f"{key} must be at most"):
        Bundle.load(make_bundle(tmp_path, **{key: value}))


def test_pipe_and_device_in_the_place_of_a_file_are_refused(make_bundle: MakeBundle, tmp_path: Path) -> None:
    path = make_bundle(tmp_path)
    (path / "encoder.onnx").unlink()
    os.mkfifo(path / "encoder.onnx")
    with pytest.raises(BundleError, match=r"encoder.onnx: cannot be read: is no file"):
        Bundle.load(path)
    (path / "manifest.json").unlink()
    (path / "manifest.json").symlink_to("/dev/zero")
    with pytest.raises(BundleError, match=r"manifest.json: cannot be read: is no file"):
        Bundle.load(path)


def test_other_sha256_than_asked_for_is_refused(bundle_path: Path) -> None:
    sha256 = Bundle.load(bundle_path).sha256
    assert Planner(bundle_path, sha256=sha256).bundle.sha256 == sha256
    with pytest.raises(BundleError, match=rf"manifest.json: sha256 is {sha256}, it must be 0{{64}}"):
        Planner(bundle_path, sha256="0" * 64)


def test_graphs_of_ours_pass(make_encoder: Callable[..., bytes], make_decoder_step: Callable[..., bytes]) -> None:
    for model in (make_encoder(), make_decoder_step()):
        check_graph(model)


def test_quantized_graph_passes(make_decoder_step: Callable[..., bytes], tmp_path: Path) -> None:
    (tmp_path / "fp32.onnx").write_bytes(make_decoder_step())
    quantize_dynamic(tmp_path / "fp32.onnx", tmp_path / "int8.onnx", per_channel=True, reduce_range=True)
    check_graph((tmp_path / "int8.onnx").read_bytes())


def test_typed_data_passes() -> None:
    model = helper.make_model(
        helper.make_graph([], "g", [], [], [helper.make_tensor("a", TensorProto.INT64, [3], [1, 300, 7])])
    )
    check_graph(model.SerializeToString())
    array = numpy_helper.from_array(np.arange(6, dtype=np.float32).reshape(2, 3), "b")
    check_graph(helper.make_model(helper.make_graph([], "g", [], [], [array])).SerializeToString())


def test_manifest_that_is_deep_is_refused(make_bundle: MakeBundle, tmp_path: Path) -> None:
    path = make_bundle(tmp_path)
    (path / "manifest.json").write_text('{"training":' * 100_000)
    with pytest.raises(BundleError, match=r"manifest.json: "):
        Bundle.load(path)

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

from runtime import BundleError, Friction, Limits
from runtime.network.bundle import SHIPPED, Bundle
from runtime.network.manifest import BUNDLE_FORMAT, Manifest

MakeBundle = Callable[..., Path]


def manifest_of(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((path / "manifest.json").read_text())
    return document


def test_bundle_says_what_its_manifest_says(bundle_path: Path) -> None:
    bundle = Bundle.load(bundle_path)
    manifest = bundle.manifest
    assert (manifest.name, manifest.network.chunk, manifest.units, manifest.layers) == ("tiny", 64, 8, 2)
    assert manifest.friction == Friction(1.0, 0.5)
    assert manifest.trained_on["reach"] == (0.0, 1.5)
    assert bundle.sha256 == hashlib.sha256((bundle_path / "manifest.json").read_bytes()).hexdigest()
    assert bundle.sizes == {name: (bundle_path / f"{name}.onnx").stat().st_size for name in ("encoder", "decoder_step")}


def test_shipped_bundle_is_known_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = Bundle.load(SHIPPED / "default")
    assert Bundle.load("default").sha256 == shipped.sha256
    assert (shipped.manifest.name, shipped.manifest.precision) == ("default", "int8")
    (tmp_path / "default").mkdir()  # a folder of that name comes first
    with pytest.raises(BundleError, match=r"default/manifest.json: cannot be read: No such file"):
        Bundle.load("default")


def test_manifest_comes_back_the_same(bundle_path: Path) -> None:
    document = manifest_of(bundle_path)
    manifest = Manifest.from_dict(document)
    absent = {
        "limits": {"pan_reach": 0.2, "height": 0.0, "speed": None, "acceleration": 30.0, "jerk": 10_000.0},
        "sizes": {"pan_radius": 0.18, "object_radius": 0.03},
    }
    assert json.loads(json.dumps(manifest.to_dict())) == document | absent
    tight = document | {
        "limits": {"pan_reach": 0.1, "height": 0.05, "speed": 1.5, "acceleration": 20.0, "jerk": 5000.0},
        "sizes": {"pan_radius": 0.14, "object_radius": 0.02},
        "trained_on": document["trained_on"] | {"start_speed": [0.0, 0.1], "corner": [0.0, 0.5]},
    }
    assert json.loads(json.dumps(Manifest.from_dict(tight).to_dict())) == tight
    older = manifest_of(bundle_path) | {"limits": {"pan_reach": 0.1, "acceleration": 20.0, "jerk": 5000.0}}
    assert Manifest.from_dict(older).limits == Limits(0.1, acceleration=20.0, jerk=5000.0)
    assert Manifest.from_dict(json.loads(json.dumps(manifest.to_dict()))) == manifest
    assert document["format"] == BUNDLE_FORMAT == "slide-bundle/2"


def test_constants_that_are_not_this_versions_are_refused(bundle_path: Path) -> None:
    document = manifest_of(bundle_path)
    for network, message in [
        (document["network"] | {"chunk": 100}, "network.chunk must be 64, which this version works with, got 100"),
        (document["network"] | {"seen_rows": [1, 2]}, "network.seen_rows must be"),
        (document["network"] | {"colour": 1}, "network: unknown key 'colour'"),
        ({}, "network: missing key 'chunk'"),
        (None, "network: must be an object"),
    ]:
        with pytest.raises(BundleError, match=message):
            Manifest.from_dict(document | {"network": network})


def test_manifest_that_could_not_be_read_is_not_written(bundle_path: Path) -> None:
    manifest = Manifest.from_dict(manifest_of(bundle_path))
    for changes, message in [
        ({"units": 0}, "units must be a whole number of at least 1"),
        ({"name": "a\nb"}, "name must be printable text"),
        ({"trained_on": {"reach": (0.0, 0.1)}}, "trained_on: missing key 'static'"),
    ]:
        with pytest.raises(BundleError, match=message):
            dataclasses.replace(manifest, **changes).to_dict()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format", "slide-bundle/3", "format must be 'slide-bundle/2', got 'slide-bundle/3': train a network with"),
        ("format", "slide-bundle/1", "got 'slide-bundle/1': train .* and export it with  slide-export RUN -o BUNDLE"),
        ("format", ..., "format must be"),
        ("name", ..., "missing key 'name'"),
        ("name", "a\nb", "name must be printable text"),
        ("colour", "red", "unknown key 'colour'"),
        ("precision", "fp64", "precision must be one of fp32, int8, got 'fp64'"),
        ("opset", "17", "opset must be a whole number"),
        ("graphs", {"encoder": {}}, "graphs: missing key 'decoder_step'"),
        ("units", 0, "units must be a whole number of at least 1, got 0"),
        ("units", 8.0, "units must be a whole number"),
        ("layers", True, "layers must be a whole number"),
        ("dt", 0.002, "dt must be 0.001 s"),
        ("units", 9, r"input hidden must be tensor\(float\) \[2, batch, 9\], got .*\[2, batch, 8\]"),
        ("layers", 1, r"input hidden must be tensor\(float\) \[1, batch, 8\]"),
        ("friction", {"static": 0.3, "kinetic": 0.5}, "kinetic friction 0.5 must not exceed static friction 0.3"),
        ("friction", [1.0, 0.5], "friction: must be an object"),
        ("trained_on", {}, "trained_on: missing key 'static'"),
        ("training", [], "training must be an object"),
        ("evaluation", None, "evaluation must be an object"),
    ],
)
def test_manifest_that_does_not_fit_is_refused(
    make_bundle: MakeBundle, tmp_path: Path, key: str, value: Any, message: str
) -> None:
    path = make_bundle(tmp_path / "bundle", **{key: value})
    with pytest.raises(BundleError, match=message) as caught:
        Bundle.load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("limits", "message"),
    [([0.5], r"must be \[lowest, highest\]"), ([1.4, 0.5], "exceeds the highest"), (["0", 1], "must be a number")],
)
def test_trained_range_that_is_none_is_refused(
    make_bundle: MakeBundle, bundle_path: Path, tmp_path: Path, limits: Any, message: str
) -> None:
    trained_on = manifest_of(bundle_path)["trained_on"] | {"static": limits}
    with pytest.raises(BundleError, match=f"trained_on.static.*{message}"):
        Bundle.load(make_bundle(tmp_path, trained_on=trained_on))


@pytest.mark.parametrize("file", ["../encoder.onnx", "/etc/passwd", "a\\b.onnx", "", ".", "..", ".hidden"])
def test_graph_outside_the_folder_is_refused(
    make_bundle: MakeBundle, bundle_path: Path, tmp_path: Path, file: str
) -> None:
    graphs = manifest_of(bundle_path)["graphs"]
    graphs["encoder"]["file"] = file
    with pytest.raises(BundleError, match=r"graphs.encoder.file must be a plain file name"):
        Bundle.load(make_bundle(tmp_path, graphs=graphs))


def test_changed_graph_is_refused_before_onnxruntime_sees_it(
    make_bundle: MakeBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make_bundle(tmp_path)
    data = bytearray((path / "encoder.onnx").read_bytes())
    data[len(data) // 2] ^= 1
    (path / "encoder.onnx").write_bytes(data)
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *_, **__: pytest.fail("loaded an unchecked graph"))
    with pytest.raises(BundleError, match=r"encoder.onnx: sha256 is [0-9a-f]{64}, the manifest says"):
        Bundle.load(path)


def test_missing_files_are_refused(make_bundle: MakeBundle, tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=r"nowhere: there is no such bundle: .* a shipped one's name: default"):
        Bundle.load(tmp_path / "nowhere")
    path = make_bundle(tmp_path)
    (path / "decoder_step.onnx").unlink()
    with pytest.raises(BundleError, match=r"decoder_step.onnx: cannot be read: No such file"):
        Bundle.load(path)
    (path / "manifest.json").write_text('{"format": "slide-bundle/1", ')
    with pytest.raises(BundleError, match=r"manifest.json: truncated or not JSON"):
        Bundle.load(path)
    (path / "manifest.json").write_text("")
    with pytest.raises(BundleError, match=r"manifest.json: the file is empty"):
        Bundle.load(path)


def test_what_is_no_graph_is_refused_quietly(
    make_bundle: MakeBundle, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BundleError, match=r"encoder.onnx: not a graph onnxruntime can load"):
        Bundle.load(make_bundle(tmp_path, models={"encoder": b"this is no protobuf"}))
    assert capfd.readouterr() == ("", "")


def test_graph_with_other_names_is_refused(
    make_bundle: MakeBundle, make_encoder: Callable[..., bytes], make_decoder_step: Callable[..., bytes], tmp_path: Path
) -> None:
    renamed = make_decoder_step(observation="state")
    with pytest.raises(BundleError, match=r"decoder_step.onnx: inputs must be observation, hidden, cell, got state"):
        Bundle.load(make_bundle(tmp_path, models={"decoder_step": renamed}))
    model = onnx.load_from_string(make_encoder())
    del model.graph.output[1]
    with pytest.raises(BundleError, match=r"encoder.onnx: outputs must be hidden, cell, got hidden"):
        Bundle.load(make_bundle(tmp_path, models={"encoder": model.SerializeToString()}))


def test_graph_with_a_fixed_batch_is_refused(
    make_bundle: MakeBundle, make_encoder: Callable[..., bytes], tmp_path: Path
) -> None:
    frozen = make_encoder(batch=1)
    with pytest.raises(
        BundleError, match=r"input command must be tensor\(float\) \[batch, chunks, 74\], got .*\[1, ch"
    ):
        Bundle.load(make_bundle(tmp_path, models={"encoder": frozen}))


def test_graph_that_gives_another_shape_is_refused(
    make_bundle: MakeBundle, make_decoder_step: Callable[..., bytes], tmp_path: Path
) -> None:
    model = onnx.load_from_string(make_decoder_step())
    model.graph.node[-3].output[0] = "upright"
    model.graph.node.append(onnx.helper.make_node("Transpose", ["upright"], ["pan_acceleration"], perm=[0, 2, 1]))
    model.graph.output[0].type.tensor_type.ClearField("shape")
    with pytest.raises(BundleError, match=r"output pan_acceleration has the shape \(2, 3, 64\), must be \(2, 64, 3\)"):
        Bundle.load(make_bundle(tmp_path, models={"decoder_step": model.SerializeToString()}))


def test_graph_that_does_not_run_is_refused_quietly(
    make_bundle: MakeBundle,
    make_decoder_step: Callable[..., bytes],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    model = onnx.load_from_string(make_decoder_step())
    triples = next(weight for weight in model.graph.initializer if weight.name == "triples")
    triples.CopyFrom(onnx.numpy_helper.from_array(np.array([-1, 7, 3]), "triples"))
    model.graph.output[0].type.tensor_type.ClearField("shape")
    with pytest.raises(BundleError, match="a graph does not run: ") as caught:
        Bundle.load(make_bundle(tmp_path, models={"decoder_step": model.SerializeToString()}))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_graph_with_weights_in_another_file_is_refused(
    make_bundle: MakeBundle, make_encoder: Callable[..., bytes], tmp_path: Path
) -> None:
    path = make_bundle(tmp_path)
    model = onnx.load_from_string(make_encoder())
    onnx.save_model(model, path / "encoder.onnx", save_as_external_data=True, location="weights", size_threshold=0)
    model = (path / "encoder.onnx").read_bytes()
    with pytest.raises(BundleError, match="keeps weights in another file"):
        Bundle.load(make_bundle(path, models={"encoder": model}))


def test_session_runs_on_one_thread_that_does_not_spin(bundle_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    session = onnxruntime.InferenceSession

    def record(model: bytes, options: Any, **others: Any) -> Any:
        seen.append(options)
        return session(model, options, **others)

    monkeypatch.setattr(onnxruntime, "InferenceSession", record)
    Bundle.load(bundle_path)
    assert len(seen) == 2
    for options in seen:
        assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)
        for pool in ("intra_op", "inter_op"):
            assert options.get_session_config_entry(f"session.{pool}.allow_spinning") == "0"

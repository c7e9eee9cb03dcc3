"""The export: a bundle does what its network does, or it is not written."""

from __future__ import annotations

import json
import sys

import numpy as np
import onnx
import pytest

from export.cli import export_main
from export.float_graphs import decoder_step_graph, encoder_graph
from export.integer_graphs import to_integers
from export.quantize import QuantizationError, quantize_bundle
from export.verify import VerificationError
from export.write_bundle import bundle_folder, export_bundle
from runtime import Planner
from runtime.errors import FormatError, OutputError
from runtime.network.bundle import Bundle
from runtime.network.units import OBSERVED, READ, SEEN_ROWS
from train.config import load_config
from train.learn.checkpoint import load_checkpoint
from train.learn.trainer import Trainer
from train.network.recipe import load_network

OPERATORS = {
    "Abs", "Add", "Clip", "Concat", "Div", "Exp", "Gemm", "LSTM", "Log", "Mul", "Neg", "Relu", "Split", "Sqrt",
    "Squeeze", "Sub", "Tanh", "Transpose", "Unsqueeze",
}  # fmt: skip
"""All that a bundle's graphs are made of."""


@pytest.mark.parametrize("changes", [{"features": 24}, {"layers": 1}, {"layers": 3}])
def test_other_architectures_export_alike(tmp_path, changes):
    config = load_config("smoke").model_copy(update=changes)
    trainer = Trainer(config, tmp_path / "run")
    trainer.save()
    assert export_bundle(tmp_path / "run", tmp_path / "bundle").agreement.acceleration <= 1e-4


def test_graphs_hold_standard_operators_and_no_outside_data(run):
    _, network = load_network(load_checkpoint(run))
    for data in (encoder_graph(network), decoder_step_graph(network)):
        graph = onnx.load_from_string(data)
        assert {node.op_type for node in graph.graph.node} <= OPERATORS
        assert [node.op_type for node in graph.graph.node].count("LSTM") == network.layers
        assert {opset.domain for opset in graph.opset_import} == {""}
        assert not any(weight.external_data for weight in graph.graph.initializer)


def test_export_is_the_same_to_the_last_byte_each_time(run):
    _, network = load_network(load_checkpoint(run))
    assert encoder_graph(network) == encoder_graph(network)
    assert decoder_step_graph(network) == decoder_step_graph(network)


def test_refused_bundle_is_not_written(tmp_path):
    def write():
        with bundle_folder(tmp_path / "bundle") as folder:
            (folder / "encoder.onnx").write_bytes(b"a graph")
            raise VerificationError("it differs")

    with pytest.raises(VerificationError):
        write()
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_no_bundle_is_left_alone(run, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(OutputError, match="is not a bundle"):
        export_bundle(run, tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.txt").read_text() == "years of work"


def test_bundle_is_replaced_by_a_new_one_and_nothing_else_is_left(run, tmp_path):
    for _ in range(2):
        export_bundle(run, tmp_path / "bundle")
    assert [path.name for path in tmp_path.iterdir()] == ["bundle"]
    assert sorted(path.name for path in (tmp_path / "bundle").iterdir()) == [
        "decoder_step.onnx",
        "encoder.onnx",
        "manifest.json",
    ]
    assert json.loads((tmp_path / "bundle" / "manifest.json").read_text())["format"] == "slide-bundle/2"


def test_a_link_to_a_bundle_stays_a_link(tmp_path):
    (tmp_path / "latest").symlink_to("bundle")
    for text in ("one", "two"):
        with bundle_folder(tmp_path / "latest") as folder:
            (folder / "manifest.json").write_text(text)
    assert (tmp_path / "latest").is_symlink()
    assert (tmp_path / "bundle" / "manifest.json").read_text() == "two"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bundle", "latest"]


def test_absent_checkpoint_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no such checkpoint"):
        export_bundle(tmp_path / "nowhere", tmp_path / "bundle")


def test_int8_bundle_plans_nearly_as_well_in_half_of_the_bytes(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    quantized = quantize_bundle(tmp_path / "fp32", tmp_path / "int8")
    assert quantized.comparison.growth < 0.05
    assert quantized.comparison.commands == 336
    fp32, int8 = Planner(tmp_path / "fp32"), Planner(tmp_path / "int8")
    manifest = int8.bundle.manifest
    assert (manifest.precision, manifest.units) == ("int8", fp32.bundle.manifest.units)
    assert manifest.evaluation["int8_growth"] == pytest.approx(quantized.comparison.growth, abs=1e-4)
    assert sum(int8.bundle.sizes.values()) < 0.55 * sum(fp32.bundle.sizes.values())
    position = 0.05 * np.sin(np.arange(300) / 100.0)[:, None] * [1.0, 0.5]
    asked = [planner.plan(position, candidates=1).pan_acceleration[:58] for planner in (fp32, int8)]
    difference = asked[0] - asked[1]
    assert 0.0 < np.abs(difference).max() < 0.1 * np.abs(asked[0]).max()


def test_rounding_of_weights_does_not_show_where_a_time_series_is_smooth():
    """A channel that stays where it is: at most half a step of one weight is left of its hundred rounding errors."""
    weight = np.random.default_rng(0).normal(size=(3 * 100 + 5, 7))
    values, step = to_integers(weight, [(3, 100), (4, 0)])  # as of a decoder that sees no command ahead
    assert np.abs(values).max() <= 63
    error = values * step.astype(np.float64) - weight
    held = error[:300].reshape(100, 3, 7).sum(axis=0)
    assert (np.abs(held) <= 0.5001 * step).all()
    assert (np.abs(error[300:]) <= 0.5001 * step).all()
    plainly, _ = to_integers(weight)
    assert (np.abs((plainly * step - weight)[:300].reshape(100, 3, 7).sum(axis=0)) > 0.5001 * step).any()


def test_int8_decoder_tells_apart_what_differs_by_half_a_millimetre(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    quantize_bundle(tmp_path / "fp32", tmp_path / "int8")
    fp32, int8 = (Planner(tmp_path / name).bundle for name in ("fp32", "int8"))
    state = fp32.encode(np.zeros((1, 3, READ), dtype=np.float32))
    observation = np.zeros((2, 1, OBSERVED), dtype=np.float32)
    observation[1, 0, np.arange(6, 10 * len(SEEN_ROWS), 10)] = 5e-4  # the object's x
    told = [[bundle.decode_step(seen, state)[1].hidden[0] for seen in observation] for bundle in (fp32, int8)]
    wanted, found = (after - before for before, after in told)
    assert np.abs(found - wanted).max() < 0.1 * np.abs(wanted).max()


def test_int8_plan_is_the_same_to_the_last_bit_whatever_is_planned_with_it(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    quantize_bundle(tmp_path / "fp32", tmp_path / "int8")
    planner = Planner(tmp_path / "int8")
    wave = np.sin(np.arange(300) / 100.0)[:, None] * [1.0, 0.5]
    commands = [size * wave for size in (0.05, 0.001, 0.14, 0.3)]
    for command, together in zip(commands, planner.plan_batch(commands), strict=True):
        alone = planner.plan(command, candidates=1)
        np.testing.assert_array_equal(together.pan_acceleration, alone.pan_acceleration)
        np.testing.assert_array_equal(together.object_position, alone.object_position)


def test_int8_of_a_bundle_trained_on_nothing_that_moves_is_refused(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    path = tmp_path / "fp32" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["trained_on"]["speed"] = [0.0, 0.0]
    path.write_text(json.dumps(manifest))
    with pytest.raises(QuantizationError, match="trained on a speed of 0"):
        quantize_bundle(tmp_path / "fp32", tmp_path / "int8")
    assert [path.name for path in tmp_path.iterdir()] == ["fp32"]


def test_int8_bundle_that_plans_worse_is_refused_and_not_written(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    with pytest.raises(QuantizationError, match=r"mean tracking RMSE grows by .* over 336 commands"):
        quantize_bundle(tmp_path / "fp32", tmp_path / "int8", max_growth=-1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["fp32"]


def test_int8_bundle_is_no_source_of_another(run, tmp_path):
    export_bundle(run, tmp_path / "fp32")
    quantize_bundle(tmp_path / "fp32", tmp_path / "int8")
    with pytest.raises(QuantizationError, match="is int8 already"):
        quantize_bundle(tmp_path / "int8", tmp_path / "again")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["default"], "models/default is a bundle already: --precision int8"),
        (["default", "--precision", "int8"], "models/default is int8 already"),
        (["absent"], "absent: no such checkpoint"),
    ],
)
def test_program_refuses_in_one_line_what_it_cannot_export(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.setattr(sys, "argv", ["slide-export", *arguments, "-o", str(tmp_path / "x")])
    with pytest.raises(SystemExit) as caught:
        export_main()
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("from_bundle", [False, True])
def test_program_writes_int8_from_a_run_or_a_bundle(run, tmp_path, monkeypatch, capsys, from_bundle):
    source = run
    if from_bundle:
        source = tmp_path / "fp32"
        export_bundle(run, source)
    arguments = ["slide-export", str(source), "-o", str(tmp_path / "int8"), "--precision", "int8", "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as caught:
        export_main()
    assert not caught.value.code
    document = json.loads(capsys.readouterr().out)
    assert (document["agreement"] is None) == from_bundle
    assert document["comparison"]["growth"] < 0.05
    assert Bundle.load(tmp_path / "int8").manifest.precision == "int8"

"""`slide-bench`: its JSON, its tables, its exit codes."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import cli
from benchmarks.harness.targets import TARGETS, Target, judge
from benchmarks.peers import large
from benchmarks.sections import accuracy, control, speed, training
from benchmarks.sections import long as endurance
from benchmarks.sections import refine as refinement
from benchmarks.suite.families import FRICTION_GRID
from runtime.network.reader import Window
from train.config import CONFIGURATIONS

FIGURES = {
    "commands",
    "tracking_mean",
    "tracking_median",
    "tracking_p95",
    "tracking_max",
    "worst",
    "pan_reach_mean",
    "pan_reach_max",
    "pan_reach_share",
    "acceleration_max",
    "acceleration_mean",
    "change_mean",
    "no_better_than_unmoved",
    "samples_per_second",
}


@pytest.fixture(autouse=True)
def few_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time little, and train a small network: here only the form of the results counts."""
    for name in ("SINGLE_ROUNDS", "BATCH_ROUNDS", "LAW_ROUNDS", "PROCESS_ROUNDS", "LARGE_ROUNDS"):
        monkeypatch.setattr(speed, name, 1)
    for name, count in (("STEPS", 30), ("SHARE_ROUNDS", 2), ("START_ROUNDS", 1)):
        monkeypatch.setattr(control, name, count)
    monkeypatch.setattr(large, "UNITS", 16)
    monkeypatch.setattr(refinement, "COMMANDS", 1)
    for name, value in (
        ("SECONDS", 3.6),
        ("COMMANDS", 1),
        ("SHORT", 1),
        ("SEEDS", 1),
        ("WINDOWS", (Window(unread=3), Window(5, 2))),
    ):
        monkeypatch.setattr(endurance, name, value)
    measure = training.measure
    smoke = CONFIGURATIONS["smoke"]
    monkeypatch.setattr(training, "measure", lambda: measure(smoke, rounds=1, projected={"smoke": smoke}))


@pytest.fixture
def one_family(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measure one family only."""
    measure_suite = accuracy.measure_suite
    monkeypatch.setattr(accuracy, "measure_suite", lambda plan: measure_suite(plan, ["spline"]))


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Run `slide-bench` in this process; returns its exit code."""
    monkeypatch.setattr(sys, "argv", ["slide-bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.bench_main()
    return int(caught.value.code or 0)


def ask(monkeypatch: pytest.MonkeyPatch, limit: float) -> None:
    target = Target("accuracy.families.spline.tracking_mean", "spline, mean RMSE", "mm", "<=", limit, "{:.2f}", 1e3)
    monkeypatch.setattr("benchmarks.harness.targets.TARGETS", (target,))


def test_accuracy_as_json_is_one_object_with_every_family(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path
) -> None:
    code = bench(monkeypatch, "--model", tiny_bundle, "--only", "accuracy", "--json")
    captured = capsys.readouterr()
    results = json.loads(captured.out)
    assert code == 1  # an untrained network is no good
    assert set(results) == {"format", "model", "machine", "versions", "accuracy", "notes", "targets"}
    assert results["format"] == "slide-bench/1"
    families = results["accuracy"]["families"]
    assert set(families) == {"spline", "shapes", "stops", "long", "short", "odd", "friction"}
    assert all(set(figures) == FIGURES for figures in [*families.values(), results["accuracy"]["total"]])
    assert len(results["accuracy"]["friction"]) == len(FRICTION_GRID)
    assert [target["figure"] for target in results["targets"]] == [
        target.figure for target in TARGETS if target.figure.startswith("accuracy")
    ]
    assert captured.err.startswith("slide-bench: missed ")
    assert captured.err.count("\n") == 1


def test_speed_and_training_as_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path
) -> None:
    bench(monkeypatch, "--model", tiny_bundle, "--only", "speed", "--only", "control", "--only", "training", "--json")
    results = json.loads(capsys.readouterr().out)
    assert "accuracy" not in results
    assert set(results["speed"]) == {"single", "compiled", "batch", "network", "large", "law", "slide_plan"}
    for name, commands in (("single", 1), ("compiled", 1), ("large", 1), ("batch", 64)):
        planning = results["speed"][name]
        assert planning["commands"] == commands
        assert planning["ratio_to_torch"] > 0.0
        assert set(planning["samples_per_second"]) == {"median", "p10", "p90", "count"}
    assert all(results["speed"]["network"][name] > 0.0 for name in ("step_ratio_to_torch", "ratio_to_torch"))
    assert results["control"]["step"]["count"] == 30
    assert results["control"]["step"]["p50"] <= results["control"]["step"]["p99"] <= results["control"]["step"]["p999"]
    assert 10e6 < results["control"]["memory"] < 1e9
    assert 0.0 < results["training"]["friction_share"] < 1.0
    assert results["training"]["samples"] == 1000
    (projection,) = results["training"]["projections"]
    assert (projection["configuration"], projection["samples"], projection["steps"]) == ("smoke", 300, 20)
    assert projection["epoch"] == pytest.approx(2 * projection["step"])
    assert projection["duration"] == pytest.approx(20 * projection["step"])
    sections = ("speed", "control", "training")
    assert [target["figure"] for target in results["targets"]] == [
        target.figure for target in TARGETS if target.figure.startswith(sections)
    ]


def test_refinement_and_long_commands_as_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path
) -> None:
    monkeypatch.setattr(cli, "_optimizer", lambda: lambda positions, _: [0.0 * position for position in positions])
    bench(monkeypatch, "--model", tiny_bundle, "--only", "refine", "--only", "long", "--json")
    results = json.loads(capsys.readouterr().out)
    refined = results["refine"]["families"]
    assert set(refined) == {"spline", "shapes", "stops", "long", "short", "odd"}
    # On a busy machine the time may be up before a step is done.
    assert all(0.0 < each["after"] <= each["before"] and each["optimizer"] > 0.0 for each in refined.values())
    assert results["refine"]["worse"] == 0
    assert 0.0 <= results["refine"]["reduction"] < 1.0
    windows = results["long"]["windows"]
    assert [(each["chunks"], each["unread"]) for each in windows] == [(None, 3), (5, 2)]
    assert windows[0]["families"] != windows[1]["families"]
    assert 0.0 < results["long"]["memory_third"] < results["long"]["memory"]
    assert results["long"]["recovery"]["ratio"] > 0.0


@pytest.mark.usefixtures("one_family")
@pytest.mark.parametrize(("limit", "code"), [(1.0, 0), (1e-3, 1)])
def test_the_exit_code_says_whether_the_figures_are_met(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path, limit: float, code: int
) -> None:
    ask(monkeypatch, limit)
    assert bench(monkeypatch, "--model", tiny_bundle, "--only", "accuracy") == code
    captured = capsys.readouterr()
    assert ("MISSED" in captured.out) == bool(code)
    assert bool(captured.err) == bool(code)


@pytest.mark.usefixtures("one_family")
def test_tables_fit_into_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path
) -> None:
    monkeypatch.setattr(cli, "_optimizer", lambda: lambda positions, _: [0.0 * position for position in positions])
    bench(monkeypatch, "--model", tiny_bundle)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    for target in TARGETS:
        measured = not target.figure.startswith(("accuracy.families.shapes", "accuracy.friction"))
        assert (target.what in text) == measured
        assert not measured or target.asked in text


@pytest.mark.usefixtures("one_family")
def test_the_results_are_written_to_a_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path, tmp_path: Path
) -> None:
    output = tmp_path / "bench.json"
    bench(monkeypatch, "--model", tiny_bundle, "--only", "accuracy", "--json", "-o", output)
    assert json.loads(output.read_text(encoding="utf-8")) == json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--model", "no-such-folder"], "no-such-folder"),
        (["-o", "no-such-folder/bench.json"], "no-such-folder"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert bench(monkeypatch, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("slide-bench: error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err


def test_an_unknown_section_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(monkeypatch, "--only", "luck") == 2
    assert "luck" in capsys.readouterr().err


@pytest.mark.usefixtures("one_family")
def test_without_torch_its_rows_are_left_out_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)  # importing it now fails as if it were not there
    bench(monkeypatch, "--model", tiny_bundle, "--json")
    captured = capsys.readouterr()
    results = json.loads(captured.out)
    assert "training" not in results
    assert results["speed"]["single"]["torch_samples_per_second"] is None
    lines = [note for note in results["notes"] if "pip install './[train]' in a checkout" in note]
    assert [line.split(" is left out: ")[0] for line in lines] == ["torch eager", "the optimizer", "training"]
    assert all(f"slide-bench: note: {line}" in captured.err for line in lines)


def test_a_figure_is_judged_only_where_it_was_measured() -> None:
    results: dict[str, Any] = {"training": {"step": {"median": 0.4}, "friction_share": 0.1}, "speed": None}
    assert [(verdict.target.figure, verdict.met) for verdict in judge(results)] == [
        ("training.step.median", True),
        ("training.friction_share", False),
    ]

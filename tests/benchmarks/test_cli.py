"""`slide-bench`: its options, its JSON, its tables, its exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.cli import SECTIONS, USUAL, Results, bench_main, measure_sections, settings_of
from benchmarks.harness.section import Subject
from benchmarks.harness.tables import WIDTH, print_tables
from benchmarks.sections.training import Variation
from benchmarks.suite.families import FRICTION_GRID
from runtime.errors import MissingExtraError

SHORT: dict[str, dict[str, Any]] = {
    "accuracy": {"family": ("spline", "friction"), "commands": 2},
    "speed": {
        "single_rounds": 1,
        "batch": 2,
        "batch_rounds": 1,
        "law_rounds": 1,
        "law_batches": (8, 16),
        "process_rounds": 1,
        "large_rounds": 1,
        "large_units": 16,
    },
    "control": {"steps": 30, "share_rounds": 2, "start_rounds": 1, "sight_commands": 1, "false_readings": 1},
    "refine": {"commands": 1, "off_budget": 20.0, "candidates": 8, "iterations": 1},
    "long": {
        "seconds": 3.6,
        "commands": 1,
        "short": 1,
        "seeds": 1,
    },
    "training": {
        "configuration": "smoke",
        "batch": 8,
        "samples": 256,
        "rounds": 1,
        "projected": (Variation("smoke", {"units": 8}),),
        "projection_rounds": 1,
    },
}
"""Settings with which little is measured: here only the form of the results counts."""


@pytest.fixture(scope="module")
def subject(tiny_bundle: Path) -> Subject:
    return Subject.load(tiny_bundle)


@pytest.fixture(scope="module")
def usual(subject: Subject) -> Results:
    """The sections that are measured where none is named."""
    return measure(subject, USUAL)


def measure(subject: Subject, names: Sequence[str]) -> Results:
    return measure_sections(subject, {name: replace(SECTIONS[name].settings, **SHORT[name]) for name in names})


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Run `slide-bench` in this process; returns its exit code."""
    monkeypatch.setattr(sys, "argv", ["slide-bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        bench_main()
    return int(caught.value.code or 0)


def test_every_file_of_sections_is_a_section() -> None:
    folder = Path(__file__).parents[2] / "benchmarks" / "sections"
    sections = [path.stem for path in folder.glob("[a-z]*.py") if "\nSECTION = " in path.read_text(encoding="utf-8")]
    assert sorted(SECTIONS) == sorted(sections)
    assert set(SHORT) == set(USUAL)


def test_every_target_is_a_figure_that_is_measured(usual: Results) -> None:
    left_out = {"families.shapes.tracking_mean", "families.shapes.tracking_max"}
    left_out |= {target.figure for target in SECTIONS["accuracy"].targets if target.figure.startswith("pans.")}
    left_out |= {"step_float32.median"} if usual.figures["training"].step_float32 is None else set()
    for name in USUAL:
        measured = [verdict.target.figure for verdict in usual.verdicts[name]]
        assert measured == [target.figure for target in SECTIONS[name].targets if target.figure not in left_out]


def test_document_is_json_with_a_part_for_each_section(usual: Results) -> None:
    document = json.loads(json.dumps(usual.to_dict(), allow_nan=False))
    assert set(document) == {"format", "model", "machine", "versions", "notes", "targets", *USUAL}
    assert document["format"] == "slide-bench/2"
    assert document["model"]["name"] == "tiny"
    for target in document["targets"]:
        found: Any = document
        for key in target["figure"].split("."):
            found = found[int(key)] if isinstance(found, list) else found[key]
        assert found == target["value"]
        assert isinstance(target["met"], bool)


def test_speed_is_measured_on_both_engines(usual: Results) -> None:
    speed = usual.figures["speed"]
    for planning, commands in ((speed.single, 1), (speed.compiled, 1), (speed.large, 1), (speed.batch, 2)):
        assert planning.commands == commands
        assert planning.ratio_to_torch > 0.0
    assert min(speed.network.step_ratio_to_torch, speed.network.ratio_to_torch) > 0.0


def test_a_controller_s_figures_are_ordered(usual: Results) -> None:
    control = usual.figures["control"]
    assert control.step.count == 30
    assert control.step.median <= control.step.p99 <= control.step.p999
    assert 10e6 < control.memory < 1e9


def test_refinement_makes_no_plan_worse(usual: Results) -> None:
    refined = usual.figures["refine"]
    assert set(refined.families) == {"spline", "shapes", "stops", "long", "short", "odd"}
    # On a busy machine the time may be up before a step is done.
    assert all(0.0 < each.after <= each.before and each.optimizer > 0.0 for each in refined.families.values())
    assert refined.worse == 0
    assert set(refined.off) == {"spline", "shapes"}
    assert all(each.robust > 0.0 and each.nominal > 0.0 for each in refined.off.values())


def test_long_commands_are_held_against_short_ones(usual: Results) -> None:
    endurance = usual.figures["long"]
    assert endurance.pieces.keys() == endurance.short.keys()
    assert endurance.ratio == pytest.approx(
        max(error / endurance.short[name] for name, error in endurance.pieces.items())
    )
    assert 0.0 < endurance.memory_third < endurance.memory
    assert endurance.recovery.ratio > 0.0


def test_cost_of_a_training_is_that_of_all_its_steps(usual: Results) -> None:
    training = usual.figures["training"]
    assert 0.0 < training.friction_share < 1.0
    assert (training.configuration, training.batch, training.samples) == ("smoke", 8, 256)
    (projection,) = training.projections
    assert (projection.units, projection.samples, projection.steps) == (8, 256, 20)
    assert projection.epoch == pytest.approx(2 * projection.step)
    assert projection.duration == pytest.approx(20 * projection.step)


def test_tables_fit_into_80_columns(usual: Results, capsys: pytest.CaptureFixture[str]) -> None:
    for name, figures in usual.figures.items():
        print_tables(SECTIONS[name].tables(figures, usual.verdicts[name]))
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= WIDTH
    for verdicts in usual.verdicts.values():
        assert all(verdict.target.what in text and verdict.target.text in text for verdict in verdicts)


def test_accuracy_as_json_is_one_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tiny_bundle: Path, tmp_path: Path
) -> None:
    output = tmp_path / "bench.json"
    arguments = ["accuracy", "--model", tiny_bundle, "--commands", 2, "--json", "-o", output]
    assert bench(monkeypatch, *arguments) == 1  # an untrained network is no good
    captured = capsys.readouterr()
    results = json.loads(captured.out)
    assert results == json.loads(output.read_text(encoding="utf-8"))
    families = results["accuracy"]["families"]
    assert set(families) == {"spline", "shapes", "stops", "long", "short", "odd", "friction"}
    assert {name: each["commands"] for name, each in families.items()}["friction"] == 2 * len(FRICTION_GRID)
    assert len(results["accuracy"]["friction"]) == len(FRICTION_GRID)
    unmet = [target for target in results["targets"] if not target["met"]]
    assert captured.err.startswith(f"slide-bench: {len(unmet)} of {len(results['targets'])} targets are not met: ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(("arguments", "code"), [([], 0), (["--model", "tiny"], 1)])
def test_exit_code_says_whether_the_targets_are_met(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tiny_bundle: Path,
    arguments: list[str],
    code: int,
) -> None:
    given = [tiny_bundle if each == "tiny" else each for each in arguments]
    assert bench(monkeypatch, "accuracy", "--limits", "slow", "--commands", 1, *given) == code
    captured = capsys.readouterr()
    assert ("NO" in captured.out.split()) == bool(code)
    assert ("are not met" in captured.err) == bool(code)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["accuracy", "--model", "no-such-folder"], "no-such-folder"),
        (["accuracy", "-o", "no-such-folder/bench.json"], "no-such-folder"),
        (["luck"], "unknown section 'luck': known are accuracy, speed, "),
        (["accuracy", "--family", "luck"], "unknown family 'luck': known are spline, "),
        (["accuracy", "--commands", "0"], "--commands must be at least 1, got 0"),
        (["accuracy", "--soak"], "--soak is an option of server: name it, or leave the option out"),
        (["server", "--minutes", "nan"], "--minutes must be at least 1, got nan"),
        (["refine", "--budget", "inf"], "--budget must be at least 1, got inf"),
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


def test_an_option_goes_to_every_section_that_has_it() -> None:
    from benchmarks.cli import Options

    settings = settings_of(["accuracy", "peers", "speed"], Options(commands=3, no_mppi=True))
    assert (settings["accuracy"].commands, settings["peers"].commands) == (3, 3)
    assert settings["peers"].no_mppi
    assert settings["speed"] == SECTIONS["speed"].settings


def test_without_torch_its_rows_are_left_out_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, subject: Subject
) -> None:
    for module in [name for name in sys.modules if name.startswith(("train.", "benchmarks.peers."))]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "torch", None)  # importing it now fails as if it were not there
    results = measure(subject, ["speed", "training"])
    assert set(results.figures) == {"speed"}
    assert results.figures["speed"].single.torch_samples_per_second is None
    line = "torch is not installed: pip install './[train]'"
    lines = [note.partition(" is left out: ") for note in results.notes if line in note]
    assert [what for what, *_ in lines] == ["torch eager", "training"]
    with pytest.raises(MissingExtraError, match="training is left out: torch is not installed: pip install"):
        measure(subject, ["training"])


def test_python_m_benchmarks_is_the_same_program(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--help"], cwd=root, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert all(f"  {name} " in done.stdout for name in SECTIONS)

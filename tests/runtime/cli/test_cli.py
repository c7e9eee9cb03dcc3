from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, Limits, Plan, Planner, Sizes
from runtime.cli.info import info_main
from runtime.cli.plan import PAPER_SAMPLES_PER_SECOND, plan_main
from runtime.cli.run import run_main

ROOT = Path(__file__).parents[3]
DATA = ROOT / "tests" / "data" / "commands"
EXAMPLE = ROOT / "examples" / "figure_eight.csv"
PROGRAMS = {"slide-plan": plan_main, "slide-run": run_main, "slide-info": info_main}

Slide = Callable[..., tuple[int, str, str]]


@pytest.fixture
def slide(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Slide:
    """Run a program in this process; gives its exit code, standard output and standard error."""

    def call(program: str, *arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", [program, *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "80")
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            PROGRAMS[program]()
        code = ended.value.code
        return (code if isinstance(code, int) else 0, *capfd.readouterr())

    return call


@pytest.fixture(scope="module")
def plan(make_curve: Callable[..., NDArray[np.float64]]) -> Plan:
    """A plan that does what it should, by the shipped network."""
    return Planner().plan(make_curve(400))


@pytest.fixture
def plan_file(plan: Plan, tmp_path: Path) -> Path:
    path = tmp_path / "plan.json"
    plan.save(path)
    return path


def test_slide_plan_writes_the_plan_and_a_table(slide: Slide, tmp_path: Path) -> None:
    code, out, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json")
    assert (code, err) == (0, "")
    plan = Plan.load(tmp_path / "plan.json")
    assert len(plan) == 1200
    for words in ("tracking RMSE", f"{plan.quality.tracking_rmse * 1e3:.2f} mm", "pan reach", "sliding", "paper's 622"):
        assert words in out
    assert max(map(len, out.splitlines())) <= 80
    assert [entry.name for entry in tmp_path.iterdir()] == ["plan.json"]


def test_slide_plan_json_is_one_object_and_nothing_else(slide: Slide, tmp_path: Path) -> None:
    code, out, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.npz", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    plan = Plan.load(tmp_path / "plan.npz")
    assert result["quality"] == plan.quality.to_dict()
    assert result["samples"] == 1200
    assert result["samples_per_second"] == pytest.approx(1200 / result["planning_time"])
    assert result["ratio_to_paper"] == pytest.approx(result["samples_per_second"] / PAPER_SAMPLES_PER_SECOND)


def test_slide_plan_takes_friction(slide: Slide, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    code, *_ = slide("slide-plan", EXAMPLE, "-o", path, "--static", "0.7", "--kinetic", "0.4")
    assert code == 0
    assert Plan.load(path).friction == Friction(0.7, 0.4)
    code, *_ = slide("slide-plan", EXAMPLE, "-o", path, "--static", "0.8")
    assert code == 0
    assert Plan.load(path).friction == Friction(0.8, 0.5)


def test_missed_tolerance_exits_1_in_one_line_with_the_plan_written(
    slide: Slide, bundle_path: Path, tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    code, out, err = slide("slide-plan", EXAMPLE, "-o", path, "--model", bundle_path, "--tolerance", "1e-6", "--json")
    assert code == 1
    assert err.startswith("slide-plan: tolerance missed: tracking RMSE ")
    assert err.count("\n") == 1
    assert json.loads(out)["quality"]["status"] == "tolerance_missed"
    code, _, err = slide("slide-run", path)
    assert code == 1
    assert err.startswith("slide-run: tolerance missed: tracking RMSE ")


def test_limits_can_be_tightened(slide: Slide, tmp_path: Path) -> None:
    options = ["--reach", "0.18", "--acceleration", "28", "--jerk", "9000"]
    code, out, _ = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json", "--json", *options)
    quality = json.loads(out)["quality"]
    assert code == 0
    assert quality["limits"] == {"pan_reach": 0.18, "height": 0.0, "speed": None, "acceleration": 28.0, "jerk": 9000.0}
    assert all(margin > -1e-9 for name, margin in quality["margins"].items() if name != "speed")
    assert quality["status"] in ("ok", "governed", "limited")
    code, _, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json", "--jerk", "0")
    assert (code, err) == (2, "slide-plan: error: limit jerk must be greater than 0 m/s^3, got 0 m/s^3\n")


def test_limits_have_names_a_height_and_a_speed(slide: Slide, tmp_path: Path) -> None:
    rough = ["--static", "0.5", "--kinetic", "0.3", "--json"]
    for options, limits in (
        (["--limits", "panda"], Limits.named("panda")),
        (["--limits", "panda", "--level"], replace(Limits.named("panda"), height=0.0)),
        (
            ["--limits", "fr3", "--height", "0.02", "--reach", "0.15"],
            replace(Limits.named("fr3"), pan_reach=0.15, height=0.02),
        ),
        (["--height", "0.1", "--speed-limit", "1.5"], Limits(height=0.1, speed=1.5)),
        (["--level"], Limits()),
    ):
        _, out, _ = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json", *rough, *options)
        quality = json.loads(out)["quality"]
        assert quality["limits"] == limits.to_dict()
        assert quality["speed_max"] <= limits.speed + 1e-9
    for options, message in (
        (["--limits", "pandas"], "there are no limits named 'pandas': known are default, panda, fr3"),
        (["--level", "--height", "0.1"], "--level and --height 0.1 contradict each other"),
        (["--height", "-0.1"], "limit height must be at least 0 m, which is a level pan, got -0.1 m"),
        (["--speed-limit", "nan"], "limit speed must be greater than 0 m/s, got nan m/s"),
    ):
        code, _, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / "none.json", *options)
        assert code == 2
        assert err.startswith(f"slide-plan: error: {message}")
        assert not (tmp_path / "none.json").exists()
    code, out, _ = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json", "--limits", "panda", "--static", "0.6")
    assert "m/s of 1.7 m/s" in out
    assert re.search(r"height [1-9]\d*\.\d mm of 100 mm", out)
    code, out, _ = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json")
    assert "height" not in out


def test_friction_beyond_the_training_is_a_warning(slide: Slide, tmp_path: Path) -> None:
    code, _, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / "plan.json", "--static", "1.6")
    assert code == 0
    assert err.startswith("slide-plan: warning: beyond training range: static 1.6 is outside the range trained on, ")
    assert err.count("\n") == 1
    assert Plan.load(tmp_path / "plan.json").quality.status == "beyond_training_range"


@pytest.mark.parametrize(
    ("options", "status", "line"),
    [
        (["--reach", "0.01"], "poor", "poor: tracking RMSE "),
        (
            ["--acceleration", "9"],
            "cannot_slide",
            "warning: the object cannot slide: the pan may accelerate by 9 m/s^2, and static friction 1 holds the "
            "object up to 9.8 m/s^2\n",
        ),
        (["--pan-radius", "0.08"], "off_pan", "off pan: the command leaves the pan at sample "),
        (["--object-radius", "0.14"], "off_pan", "off pan: the command leaves the pan at sample "),
    ],
)
def test_plan_that_does_not_do_what_it_should_is_written_and_exits_1_with_one_line(
    slide: Slide, tmp_path: Path, options: list[str], status: str, line: str
) -> None:
    path = tmp_path / "plan.json"
    code, out, err = slide("slide-plan", EXAMPLE, "-o", path, "--json", *options)
    assert code == 1
    assert err.startswith(f"slide-plan: {line}")
    assert err.count("\n") == 1
    assert json.loads(out)["quality"]["status"] == status == Plan.load(path).quality.status
    assert slide("slide-run", path)[0] == 1


def test_sizes_are_the_plans_and_bad_ones_are_refused(slide: Slide, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    assert slide("slide-plan", EXAMPLE, "-o", path, "--pan-radius", "0.14")[0] == 0
    assert Plan.load(path).sizes == Sizes(0.14, 0.03)
    code, _, err = slide("slide-plan", EXAMPLE, "-o", path, "--pan-radius", "140")
    assert (code, err) == (2, "slide-plan: error: pan_radius must be above 0 and at most 10 m, got 140 m\n")


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("", [], "the file is empty"),
        ("t,x\n0,0\n", [], "line 1: missing column 'y'"),
        ("a,b\n0,0\n", [], "line 1: missing column 'x' among 'a', 'b': say which are meant by --columns T,X,Y"),
        ("x,y\n0,0\n", [], "1 sample, at least 2 are needed"),
        ("x,y\n0,0\n0,nan\n", [], "line 3, column y: nan is not a finite number"),
        ("x,y\n0,0\n0,0.06\n", [], "there are no times, and at 1 kHz the command moves at 60 m/s"),
        ("t,x,y\n0,0,0\n0.001,0,0.06\n", [], "jumps by 0.06 m from waypoint 0 (line 2) at 0 s to waypoint 1 (line 3)"),
        ("t,x,y\n0,0,0\n1,0,60\n", [], "are these millimetres (--scale 0.001)?"),
        ("t,x,y\n0,0,0\n1,0,0\n", ["--scale", "0"], "scale must be greater than 0, got 0"),
        ("t,x,y\n0,0,0\n1,0,0\n", ["--origin", "left"], "origin must be pan, first or X,Y in metres, got 'left'"),
        ("t,x,y\n0,0,0\n0,0,0\n", [], "t must increase"),
        (None, [], "cannot be read: No such file"),
        ("x,y\n0,0\n0,0\n", ["--static", "-1"], "friction static must be between 0 and 10, got -1"),
        ("x,y\n0,0\n0,0\n", ["--static", "nan"], "friction static must be finite"),
        ("x,y\n0,0\n0,0\n", ["--kinetic", "1.5"], "kinetic friction 1.5 must not exceed static friction 1"),
        (
            "x,y\n0,0\n0,0\n",
            ["--model", "nowhere"],
            "nowhere: there is no such bundle: give its folder, or a shipped one's name: default",
        ),
        ("x,y\n0,0\n0,0\n", ["-o", "absent/plan.json"], "absent/plan.json: cannot be written: there is no folder"),
        ("x,y\n0,0\n0,0\n", ["-o", "folder.json"], "folder.json: cannot be written: is a directory"),
        ("x,y\n0,0\n0,0\n", ["-o", "command.csv/plan.json"], "cannot be written"),
        ("x,y\n0,0\n0,0\n", ["-o", "plan.yaml"], "written as .json, .npz, .csv or .parquet"),
    ],
)
def test_bad_input_is_one_line_exit_2_and_nothing_written(
    slide: Slide,
    bundle_path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str | None,
    options: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.json").mkdir()
    if command is not None:
        Path("command.csv").write_text(command)
    before = sorted(tmp_path.rglob("*"))
    code, out, err = slide("slide-plan", "command.csv", "-o", "plan.json", "--model", bundle_path, *options)
    assert (code, out) == (2, "")
    assert err.startswith("slide-plan: error: ")
    assert message in err
    assert err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_options_say_what_the_numbers_mean(slide: Slide, tmp_path: Path) -> None:
    options = ["-o", tmp_path / "plan.json"]
    code, _, err = slide("slide-plan", DATA / "millimetres.csv", "--scale", "0.0004", "--smooth", "5", *options)
    assert code == 0
    assert re.fullmatch(r"slide-plan: note: scaled by 0.0004; smoothing moved it by [\d.e-]+ mm at most\n", err)
    code, out, err = slide("slide-plan", DATA / "drawing.svg", "--speed", "0.2", "--size", "0.1", *options, "--json")
    assert code == 0
    assert "laid its middle on the pan's centre" in json.loads(out)["reading"]
    code, _, err = slide("slide-plan", DATA / "bare_order.csv", "--columns", "x,y,n,t", "--origin", "0.01,0", *options)
    assert code == 0
    np.testing.assert_allclose(Plan.load(tmp_path / "plan.json").command_position[0], [-0.01, 0.0])


def test_standard_input_is_a_command_file(tmp_path: Path) -> None:
    with start("slide-plan", "-", "-o", tmp_path / "plan.json", stdin=(DATA / "names.csv").open()) as process:
        _, err = process.communicate()
    assert process.returncode == 0
    assert err == "slide-plan: note: took t, x, y from the columns 'Time', 'Position_X', 'Position_Y'\n"
    assert len(Plan.load(tmp_path / "plan.json")) == 1001


def test_many_commands_are_planned_and_what_failed_is_said(slide: Slide, tmp_path: Path) -> None:
    names = ("plain.csv", "bare.csv", "names.csv", "inches.csv", "savetxt.dat")
    arguments = [*(DATA / name for name in names), "-o", tmp_path / "plans"]
    code, out, err = slide("slide-plan", *arguments)
    assert code == 2
    assert sorted(path.name for path in (tmp_path / "plans").iterdir()) == ["names.json", "plain.json", "savetxt.json"]
    assert all(name in out for name in ("plain.csv", "names.csv", "savetxt.dat", "RMSE (mm)"))
    assert max(map(len, out.splitlines())) <= 80
    failed = [line for line in err.splitlines() if line.startswith("slide-plan: error: ")]
    assert [line.split(": ")[2] for line in failed] == [str(DATA / "bare.csv"), str(DATA / "inches.csv")]

    code, out, err = slide("slide-plan", *arguments, "--json")
    document = json.loads(out)
    assert [Path(each["plan"]).name for each in document["plans"]] == ["plain.json", "names.json", "savetxt.json"]
    assert [Path(each["command"]).name for each in document["failed"]] == ["bare.csv", "inches.csv"]

    good = [DATA / "plain.csv", DATA / "names.csv", "-o", tmp_path / "plans"]
    assert slide("slide-plan", *good)[0] == 0
    code, _, err = slide("slide-plan", *good, "--tolerance", "1e-9")
    assert code == 1
    assert f"slide-plan: {DATA / 'names.csv'}: tolerance missed: tracking RMSE " in err


def test_many_commands_need_a_folder_and_names_of_their_own(slide: Slide, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    twice = [DATA / "plain.csv", DATA / "drawing.svg", DATA / "plain.csv"]
    for commands, output, message in (
        (twice, "plans", "would both be written to"),
        (twice[:2], "file", "cannot be written: 2 plans need a folder"),
        (twice[:2], "plans.json", "cannot be written: 2 plans need a folder"),
        (twice[:2], "absent/plans", "cannot be made: No such file"),
    ):
        code, _, err = slide("slide-plan", *commands, "-o", tmp_path / output)
        assert code == 2
        assert message in err
        assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_output_is_checked_before_a_model_is_loaded(slide: Slide, tmp_path: Path) -> None:
    for name in ("plan.txt", "absent/plan.json"):
        code, _, err = slide("slide-plan", EXAMPLE, "-o", tmp_path / name, "--model", tmp_path / "no-model")
        assert code == 2
        assert str(tmp_path / name) in err
        assert "no-model" not in err


def test_usage_errors_exit_2(slide: Slide) -> None:
    for arguments in (
        ["slide-plan"],
        ["slide-plan", EXAMPLE],
        ["slide-run", "a", "--static", "x"],
        ["slide-info", "--x"],
    ):
        code, out, err = slide(*arguments)
        assert (code, out) == (2, "")
        assert err.splitlines()[-1].startswith("Error: ")


def test_slide_run_replays_the_plan(slide: Slide, plan: Plan, plan_file: Path) -> None:
    code, out, err = slide("slide-run", plan_file)
    assert (code, err) == (0, "")
    for words in ("1/0.5", f"{plan.quality.tracking_max * 1e3:.2f} mm", "object to command at the end", "0.00 mm"):
        assert words in out
    assert max(map(len, out.splitlines())) <= 80
    result = json.loads(slide("slide-run", plan_file, "--json")[1])
    assert result["tracking_rmse"] == plan.quality.tracking_rmse
    assert result["sliding_share"] == plan.quality.sliding_share
    assert result["difference_to_plan"] == 0.0
    assert result["rest_error"] == pytest.approx(plan.quality.rest_error, abs=1e-12)
    assert result["distance_at_end"] == np.hypot(*(plan.object_position[-1] - plan.command_position[-1]))


def test_slide_run_replays_under_another_friction(slide: Slide, plan: Plan, plan_file: Path) -> None:
    result = json.loads(slide("slide-run", plan_file, "--static", "10", "--json")[1])
    assert result["friction"] == {"static": 10.0, "kinetic": 0.5}
    assert result["sliding_share"] == 0.0
    moved = np.hypot(*(plan.object_position - plan.object_position[0]).T).max()
    assert result["difference_to_plan"] == pytest.approx(moved)


def test_slide_run_tells_that_the_object_leaves_the_pan_under_another_friction(slide: Slide, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    u = np.tile([6.0, 0.0], (400, 1))
    Plan.of_accelerations(u, Friction(1.0, 0.5), "away").save(path)
    assert slide("slide-run", path)[0] == 0
    code, _, err = slide("slide-run", path, "--static", "0.1", "--kinetic", "0.1")
    assert (code, err) == (1, "slide-run: under this friction the object leaves the pan at 0.245 s\n")


def test_slide_plan_notes_that_the_stop_carries_the_object_away(slide: Slide, tmp_path: Path) -> None:
    t = np.arange(300) * 1e-3
    position = np.stack([0.8 * t * t, np.zeros_like(t)], axis=1)  # ends at 0.5 m/s
    np.save(tmp_path / "dash.npy", position)
    code, out, err = slide("slide-plan", tmp_path / "dash.npy", "-o", tmp_path / "plan.json")
    plan = Plan.load(tmp_path / "plan.json")
    assert plan.quality.rest_error is not None
    assert f"{plan.quality.rest_error * 1e3:.2f} mm" in out
    assert code == 0
    assert "slide-plan: note: after the stop the object rests 0." in err


def test_slide_run_writes_the_report(slide: Slide, plan_file: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    code, out, _ = slide("slide-run", plan_file, "--report", page)
    assert code == 0
    assert "report.html" in out.replace("\n", "").replace(" ", "")
    plain = page.read_text(encoding="utf-8")
    assert "<html" in plain
    assert slide("slide-run", plan_file, "--report", page, "--static", "0.6")[0] == 0
    assert "friction 0.6/0.5" in page.read_text(encoding="utf-8")
    assert "friction 0.6/0.5" not in plain


def test_slide_run_refuses_bad_input(slide: Slide, plan: Plan, plan_file: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.json"
    other.write_text(json.dumps(plan.to_dict() | {"format": "slide-plan/9"}))
    cut = tmp_path / "cut.json"
    cut.write_bytes(plan_file.read_bytes()[:1000])
    for arguments, message in [
        ([other], "other.json: format must be 'slide-plan/2', got 'slide-plan/9'"),
        ([cut], "cut.json: truncated or not JSON"),
        ([tmp_path / "absent.json"], "cannot be read"),
        ([plan_file, "--kinetic", "2"], "kinetic friction 2 must not exceed"),
        ([plan_file, "--report", tmp_path / "absent" / "report.html"], "there is no folder"),
    ]:
        code, out, err = slide("slide-run", *arguments)
        assert (code, out) == (2, "")
        assert err.startswith("slide-run: error: ")
        assert message in err
        assert err.count("\n") == 1


def test_slide_info_says_what_the_bundle_is(slide: Slide, planner: Planner, bundle_path: Path) -> None:
    code, out, err = slide("slide-info", bundle_path)
    assert (code, err) == (0, "")
    for words in ("tiny", "2 x 8 LSTM units, fp32, opset 17", "0.05 to 1.5", "0.2 m", "none", "tracking rmse", "0.002"):
        assert words in out
    assert "0.18 m, 0.03 m" in out
    shipped = slide("slide-info", "default")[1]
    assert re.search(r"30 level tracking +0\.00[0-9]+ m\n", re.sub(" +\n", "\n", shipped))
    assert planner.bundle.sha256 in out.replace("\n", "").replace(" ", "")
    assert max(map(len, out.splitlines())) <= 80
    result = json.loads(slide("slide-info", bundle_path, "--json")[1])
    assert result["sha256"] == planner.bundle.sha256
    assert result["units"] == 8
    assert slide("slide-info", bundle_path / "absent")[0] == 2


def start(program: str, *arguments: object, **options: Any) -> subprocess.Popen[str]:
    verb = program.removeprefix("slide-")
    code = f"import sys; sys.argv[0] = {program!r}; from runtime.cli.{verb} import {verb}_main; {verb}_main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=ROOT, text=True, preexec_fn=obey_interrupts, **pipes, **options)


def obey_interrupts() -> None:
    """Undo what a shell does to what it starts in the background, or Python would not listen to SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_program_works_in_a_process_of_its_own_under_an_ascii_locale(tmp_path: Path) -> None:
    environment = os.environ | {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    with start("slide-plan", EXAMPLE, "-o", tmp_path / "p.json", env=environment) as process:
        out, err = process.communicate()
    assert (process.returncode, err) == (0, "")
    assert "tracking RMSE" in out


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_reader_that_goes_away_makes_no_traceback(bundle_path: Path, options: list[str]) -> None:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with start("slide-info", bundle_path, *options, env=buffered) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""


def test_interrupted_program_exits_130_without_a_traceback(bundle_path: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "command.csv")  # reading it waits until somebody writes
    with start("slide-plan", tmp_path / "command.csv", "-o", tmp_path / "p.json", "--model", bundle_path) as process:
        with (tmp_path / "command.csv").open("w"):  # opens once the program reads
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 130
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert not (tmp_path / "p.json").exists()

"""`slide-run PLAN --simulator` as a person types it; what is the program's alone is asked of pybullet."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")

from runtime import Friction, Limits, Plan, Planner, Sizes
from runtime.arm.options import ArmOptions
from runtime.arm.program import run_on_arm
from runtime.arm.run import Hook
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SimulatedArm
from runtime.documents.checks import FloatArray

from .conftest import SlideRun, save_shake


def test_three_short_plans_run_and_are_told_in_a_table(slide_run: SlideRun, tmp_path: Path) -> None:
    for peak in (6.0, 8.0, 10.0):
        code, out, err = slide_run(save_shake(tmp_path / "plan.json", peak), "--pybullet")
        assert (code, err) == (0, "")
        for words in ("pan tracking", "object to command", "law of friction", "torques", "real-time factor", "yes"):
            assert words in out
        assert max(map(len, out.splitlines())) <= 80


def test_mujoco_tells_the_same(slide_run: SlideRun, shake_file: Path) -> None:
    pytest.importorskip("mujoco")
    code, out, err = slide_run(shake_file, "--simulator", "mujoco", "--json")
    assert (code, err) == (0, "")
    mujoco = json.loads(out)
    assert (mujoco["simulator"], mujoco["results"]["samples"]) == ("mujoco", 300)
    code, out, _ = slide_run(shake_file, "--simulator", "pybullet", "--json")
    assert code == 0
    pybullet = json.loads(out)
    assert pybullet.keys() == mujoco.keys()
    assert mujoco["results"]["object_rms"] == pytest.approx(pybullet["results"]["object_rms"], abs=1e-3)
    assert mujoco["results"]["torque_peaks"] == pytest.approx(pybullet["results"]["torque_peaks"], rel=0.05, abs=0.5)


def test_a_named_arm_executes_the_plan_within_its_limits(slide_run: SlideRun, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    plan = save_shake(tmp_path / "plan.json", 6.0)
    code, out, err = slide_run(plan, "--arm", "ur5e", "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert (document["arm"], document["simulator"]) == ("ur5e", "mujoco")
    assert document["results"]["pan_rms"] < 1e-4
    assert document["results"]["law_rms"] < 1.5e-3
    assert 0.1 < document["limits"]["torque"] < 1.0
    assert 0.1 < document["limits"]["speed"] < 1.0
    code, out, _ = slide_run(plan, "--arm", "ur5e", "--pybullet")
    assert code == 0
    assert "arm ur5e in pybullet" in out
    assert "of the joints' limits" in out


def test_an_arm_that_is_not_known_is_refused_in_a_line(slide_run: SlideRun, shake_file: Path) -> None:
    pytest.importorskip("mujoco")
    code, out, err = slide_run(shake_file, "--arm", "scara")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "there is no arm named 'scara': known are fr3" in err


def test_mujoco_films_in_720p(shake_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    film = tmp_path / "film.mp4"
    options = ArmOptions(simulator=Simulator.MUJOCO, video=film)
    run_on_arm(shake_file, options, hooks=[_interrupt_at(41)])
    assert imageio_ffmpeg.count_frames_and_secs(str(film))[0] == 5
    assert next(imageio_ffmpeg.read_frames(str(film)))["size"] == (1280, 720)


def test_a_film_where_nothing_renders_is_refused_before_the_arm_moves(
    slide_run: SlideRun, shake_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    film = tmp_path / "film.mp4"
    code, out, err = slide_run(shake_file, "--simulator", "mujoco", "--video", film)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "pictures need EGL or OSMesa, to render without a screen (Debian: apt install libegl1" in err
    assert not film.exists()


def test_mujoco_films_what_moves() -> None:
    pytest.importorskip("mujoco")
    arm, other = (
        SimulatedArm(Simulated(simulator=Simulator.MUJOCO)),
        SimulatedArm(Simulated(simulator=Simulator.MUJOCO)),
    )
    circle = 0.1 * np.stack([np.cos(np.arange(200) / 30), np.sin(np.arange(200) / 30)], axis=1)
    arm.reset(np.zeros(2))
    other.reset(np.array([0.05, 0.0]))
    camera, plain = arm.camera(circle, (320, 180)), arm.camera(None, (320, 180))
    elsewhere = other.camera(circle, (320, 180))
    first, again = camera.picture(0), camera.picture(0)
    assert first.shape == (180, 320, 3)
    assert np.array_equal(first, again)
    differing = [(first != each.picture(0)).any(axis=2).mean() for each in (plain, elsewhere)]
    assert all(0.0003 < share < 0.03 for share in differing), "the path; the object and its shadow"
    assert first.std() > 20, "not one colour"


def test_json_is_one_object_with_every_figure(slide_run: SlideRun, shake_file: Path) -> None:
    code, out, err = slide_run(shake_file, "--pybullet", "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert (document["loop"], document["control"], document["friction"]) == ("open loop", "feed-forward", 0.5)
    results = document["results"]
    assert results["samples"] == 300
    assert results["pan_rms"] < 1e-4
    assert results["law_rms"] < 1.5e-3
    assert (results["lost"], results["limits"]) == (None, {})
    code, out, _ = slide_run(shake_file, "--pybullet", "--json", "--paper-control")
    assert code == 0
    paper = json.loads(out)
    assert paper["control"] == "paper"
    assert paper["results"]["pan_rms"] > 10 * results["pan_rms"]


def test_closed_loop_decodes_with_what_is_measured(
    slide_run: SlideRun, planner: Planner, bundle_path: Path, make_curve: Callable[..., FloatArray], tmp_path: Path
) -> None:
    plan, path = planner.plan(make_curve(250)), tmp_path / "plan.json"
    plan.save(path)
    code, out, err = slide_run(path, "--pybullet", "--closed-loop", "--model", bundle_path, "--json")
    assert code in (0, 1), err
    assert json.loads(out)["loop"] == "closed loop"
    assert "was made by" not in err


def test_closed_loop_keeps_to_the_limits_of_the_plan(
    planner: Planner, bundle_path: Path, make_curve: Callable[..., FloatArray], tmp_path: Path
) -> None:
    path, reach = tmp_path / "plan.json", 0.02
    planner.plan(make_curve(600), limits=Limits(pan_reach=reach)).save(path)
    away: list[float] = []
    options = ArmOptions(closed_loop=True, model=bundle_path)
    run_on_arm(path, options, hooks=[lambda k, measured: away.append(float(np.hypot(*measured.pan[:2])))])
    assert 0.5 * reach < max(away) < 1.01 * reach


def test_a_plan_for_another_pan_than_the_simulated_one_is_noted(slide_run: SlideRun, tmp_path: Path) -> None:
    plan: Plan = Plan.of_accelerations(np.zeros((300, 2)), Friction(1.0, 0.5), "still")
    replace(plan, sizes=Sizes(0.14, 0.02)).save(tmp_path / "plan.json")
    code, _, err = slide_run(tmp_path / "plan.json", "--pybullet")
    assert code == 0
    assert err == (
        "slide-run: note: the plan is for a pan and an object of radius 0.14 and 0.02 m, the simulated ones have 0.18 "
        "and 0.03 m\n"
    )


def test_closed_loop_with_another_model_is_noted(slide_run: SlideRun, shake_file: Path, bundle_path: Path) -> None:
    _, _, err = slide_run(shake_file, "--pybullet", "--closed-loop", "--model", bundle_path)
    assert err.startswith("slide-run: note: closed loop with model 'tiny', the plan was made by 'shake'\n")


def test_report_and_film_are_written(slide_run: SlideRun, shake_file: Path, tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    film, report = tmp_path / "film.mp4", tmp_path / "report.html"
    code, out, err = slide_run(shake_file, "--pybullet", "--video", film, "--report", report)
    assert (code, err) == (0, "")
    assert "film.mp4" in out
    assert "arm, open loop" in report.read_text(encoding="utf-8")
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(film))
    assert 25 * seconds == pytest.approx(frames, abs=1)
    assert frames > 60, "the plan and the tail, a picture every 10 ms"


def test_the_simulators_friction_is_the_plans_unless_another_is_given(slide_run: SlideRun, shake_file: Path) -> None:
    Plan.of_accelerations(np.zeros((50, 2)), Friction(0.3, 0.25), "still").save(shake_file)
    for options, friction in (((), 0.25), (("--friction", "0.4"), 0.4)):
        code, out, err = slide_run(shake_file, "--pybullet", "--json", *options)
        assert (code, err) == (0, "")
        assert json.loads(out)["friction"] == friction


def test_friction_and_mass_are_the_simulators(slide_run: SlideRun, shake_file: Path) -> None:
    moved = {}
    for friction in ("0.2", "2.0"):
        options = ["--friction", friction, "--object-mass", "0.2", "--noise", "0.0001", "--seed", "3", "--json"]
        code, out, _ = slide_run(shake_file, "--pybullet", *options)
        assert code == 0
        moved[friction] = json.loads(out)["results"]["object_rms"]
    assert moved["0.2"] != moved["2.0"]


def test_an_object_that_topples_is_said_with_its_time(slide_run: SlideRun, tmp_path: Path) -> None:
    shake = save_shake(tmp_path / "plan.json", 25.0)
    code, out, err = slide_run(shake, "--pybullet", "--friction", "3", "--disturb", "push@0.05=5,0")
    assert (code, err.count("\n")) == (1, 1)
    assert re.match(r"slide-run: the object (toppled|left the pan) at 0\.[0-9]{3} s", err)
    assert "no, " in out
    assert "not known" in out, "the law does not know of the push"


def test_a_plan_beyond_reach_runs_within_limits_and_says_so(slide_run: SlideRun, tmp_path: Path) -> None:
    path = tmp_path / "away.json"
    Plan.of_accelerations(np.tile([6.0, 0.0], (600, 1)), Friction(1.0, 0.5), "away").save(path)
    code, out, err = slide_run(path, "--pybullet", "--json")
    assert (code, err.count("\n")) == (1, 1)
    assert "the arm was held back for " in err
    assert "reach" in err
    assert max(json.loads(out)["results"]["torque_peaks"]) <= 200.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dt": 0.002}, "dt is 0.002 s"),
        ({"samples": 60_001}, "the plan lasts 60.001 s, at most 60 s are executed"),
        ({"nan": True}, "NaN is not a finite number"),
    ],
)
def test_plans_that_cannot_be_executed_exit_2(
    slide_run: SlideRun, shake_file: Path, changes: dict[str, object], message: str
) -> None:
    if "samples" in changes:
        Plan.of_accelerations(np.zeros((60_001, 2)), Friction(), "long").save(shake_file)
    else:
        document = json.loads(shake_file.read_text())
        if "dt" in changes:
            document["dt"] = changes["dt"]
        else:
            document["pan"]["position"][3][1] = float("nan")
        shake_file.write_text(json.dumps(document))
    code, out, err = slide_run(shake_file, "--pybullet")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_an_interrupt_keeps_film_and_report(shake_file: Path, tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    film, report = tmp_path / "film.mp4", tmp_path / "report.html"
    outcome = run_on_arm(shake_file, ArmOptions(video=film), report, hooks=[_interrupt_at(150)])
    assert outcome.interrupted
    assert outcome.document["results"]["samples"] == 150
    assert imageio_ffmpeg.count_frames_and_secs(str(film))[0] == 15
    assert report.exists()


def _interrupt_at(sample: int) -> Hook:
    """A hook that presses Ctrl-C."""

    def hook(k: int, measured: object) -> None:
        if k == sample:
            raise KeyboardInterrupt

    return hook

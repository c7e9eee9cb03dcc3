"""The simulated camera and the late arm."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.suite.world import LawArm
from runtime import Friction, InputError, Planner
from runtime.arm.eyes import Camera, Eyes, LateArm, watching
from runtime.arm.interface import Measured, ObjectStatus, PanCommand
from runtime.arm.run import execute

from .conftest import SlideRun, save_shake


def measured(x: float, status: ObjectStatus = ObjectStatus.ON_PAN) -> Measured:
    return Measured(np.zeros(6), 0.0, np.array([x, 0.0, 0.0, 0.0]), status, np.zeros(0), np.zeros(0))


def test_frames_come_late_at_the_cameras_rate() -> None:
    camera = Camera(Eyes(30.0, latency=0.05))
    told = {k: camera.look(k, measured(1e-3 * k)) for k in range(400)}
    frames = [(k, frame) for k, each in told.items() for frame in each]
    assert [frame.taken for _, frame in frames[:4]] == [0, 33, 67, 100]
    assert all(k == frame.taken + 50 for k, frame in frames)
    assert all(frame.position[0] == pytest.approx(1e-3 * frame.taken) for _, frame in frames)


def test_noise_and_losses_are_as_told_and_repeat_with_the_seed() -> None:
    def frames(seed: int) -> list[tuple[int, float]]:
        camera = Camera(Eyes(1000.0, noise=2e-3, dropout=0.3, seed=seed))
        return [(f.taken, float(f.position[0])) for k in range(3000) for f in camera.look(k, measured(0.0))]

    assert frames(1) == frames(1)
    assert frames(1) != frames(2)
    assert len(frames(1)) == pytest.approx(2100, abs=100)
    assert np.std([x for _, x in frames(1)]) == pytest.approx(2e-3, rel=0.1)


def test_object_off_the_pan_is_not_seen() -> None:
    camera = Camera(Eyes(1000.0))
    assert camera.look(0, measured(0.3, ObjectStatus.OFF_PAN)) == []


def test_late_arm_executes_what_it_was_told_before() -> None:
    arm = LateArm(LawArm(Friction()), 0.003)
    arm.reset(np.zeros(2))
    moved = []
    for k in range(8):
        command = PanCommand(np.zeros(3), np.zeros(3), np.array([1.0 if k == 2 else 0.0, 0.0, 0.0]))
        moved.append(arm.step(command).pan[3])
    np.testing.assert_allclose(moved, [0.0] * 5 + [1e-3] * 3)
    arm.close()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"camera_rate": 0.0}, "camera rate must be between 5 and 1000 frames a second, got 0"),
        ({"latency": 0.2}, r"latency must be between 0 and 0.1 s, got 0.2"),
        ({"dropout": float("nan")}, "dropout must be between 0 and 0.9, got nan"),
        ({"command_delay": -1.0}, "command delay must be between 0 and 0.1 s, got -1"),
        ({"seed": -1}, "seed must be 0 or more, got -1"),
    ],
)
def test_eyes_out_of_range_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Eyes(**values)  # type: ignore[arg-type]


def test_stream_that_watches_follows_and_rests() -> None:
    planner = Planner()
    t = np.linspace(0.0, 1.0, 800)[:, None]
    position = t**3 * (10.0 - 15.0 * t + 6.0 * t * t) * np.array([0.08, 0.0])
    plan = planner.plan(position)
    stream = planner.stream(position)
    source = watching(stream, Camera(Eyes(60.0, 0.02)), stream.chunk, len(position))
    recording = execute(plan, LawArm(Friction(0.6, 0.5)), source)
    error = recording.sliding[:800, :2] - position
    assert np.sqrt(np.mean(np.sum(error * error, axis=1))) < 0.003
    np.testing.assert_allclose(recording.pan[-1, 3:], 0.0, atol=1e-9)


def test_eyes_and_late_arm_on_the_command_line(slide_run: SlideRun, tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    plan, log = save_shake(tmp_path / "plan.json", 6.0), tmp_path / "log.csv"
    options = ["--closed-loop", "--camera-rate", "30", "--latency", "0.03", "--noise", "0.001", "--dropout", "0.1"]
    options += ["--command-delay", "0.005", "--identify", "--seed", "3", "--json"]
    code, out, _ = slide_run(plan, "--pybullet", *options, "--log", log)
    assert code == 0
    document = json.loads(out)
    assert document["eyes"] == {
        "camera_rate": 30.0,
        "latency": 0.03,
        "noise": 0.001,
        "dropout": 0.1,
        "command_delay": 0.005,
        "seed": 3,
    }
    assert document["found"]["friction"].keys() == {"static", "kinetic"}
    rows = log.read_text().splitlines()
    assert rows[0] == "t,pan_x,pan_y,object_x,object_y"
    assert 5 < sum(not row.endswith(",,") for row in rows[1:]) < 60
    again = json.loads(slide_run(plan, "--pybullet", *options)[1])
    for name in ("found", "eyes"):
        assert again[name] == document[name]
    assert again["results"]["object_rms"] == document["results"]["object_rms"]


@pytest.mark.parametrize("options", [["--camera-rate", "30"], ["--closed-loop", "--server", "http://x", "--identify"]])
def test_eyes_without_a_loop_of_our_own_are_refused(slide_run: SlideRun, tmp_path: Path, options: list[str]) -> None:
    pytest.importorskip("pybullet")
    code, out, err = slide_run(save_shake(tmp_path / "plan.json", 6.0), "--pybullet", *options)
    assert (code, out) == (2, "")
    assert "need --closed-loop without --server" in err

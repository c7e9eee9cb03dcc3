"""Joints along a plan: they hold the pan where the plan has it, from rest to rest, and tell what passes a limit."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime import Friction, Limits, Plan
from runtime.arms.description import Frame
from runtime.arms.files import to_csv, to_json, to_mcap
from runtime.arms.load import arm_names, load_arm
from runtime.arms.model import ArmModel
from runtime.arms.motion import JointMotion, follow, follow_plan
from runtime.arms.place import find_place, level, share
from runtime.cli.joints import joints_main
from runtime.errors import InputError
from runtime.physics.law import DT

mujoco = pytest.importorskip("mujoco")

SlideJoints = Callable[..., tuple[int, str, str]]


def wave(peak: float = 3.0, samples: int = 400) -> Plan:
    """A plan in which the pan swings along both axes, smoothly from rest to rest."""
    t = np.arange(samples) / samples
    shape = peak * np.sin(2.0 * np.pi * t) * np.sin(np.pi * t) ** 2
    u = np.stack([shape, -0.5 * shape], axis=1)
    return Plan.of_accelerations(u - u.mean(axis=0), Friction(0.3, 0.25), "wave")


@pytest.fixture(scope="module")
def fr3() -> JointMotion:
    model = ArmModel(load_arm("fr3"))
    return follow_plan(model, find_place(model), wave())


@pytest.fixture
def slide_joints(program: Callable[..., SlideJoints]) -> SlideJoints:
    return program(joints_main, "slide-joints", 100)


@pytest.mark.parametrize("name", arm_names())
def test_the_joints_hold_the_pan_where_the_plan_has_it(name: str) -> None:
    model, plan = ArmModel(load_arm(name)), wave()
    place = find_place(model)
    motion = follow_plan(model, place, plan)
    wanted = np.zeros((len(plan), 3))
    wanted[:, :2] = plan.pan_position[:, :2]
    for k in range(0, len(plan), 25):
        position, rotation, _ = model.pan(motion.angle[k])
        np.testing.assert_allclose(position, place.position + place.rotation @ wanted[k], atol=1e-7)
        np.testing.assert_allclose(rotation, place.rotation, atol=1e-7)
    assert max(motion.position_error, motion.tilt_error) < 1e-7
    assert math.isclose(place.rotation[2, 2], 1.0, abs_tol=1e-9)


def test_speeds_and_accelerations_lead_from_sample_to_sample(fr3: JointMotion) -> None:
    led_to = fr3.angle + fr3.speed * DT + 0.5 * fr3.acceleration * DT**2
    np.testing.assert_allclose(led_to[:-1], fr3.angle[1:], atol=1e-6)
    np.testing.assert_allclose((fr3.speed + fr3.acceleration * DT)[:-1], fr3.speed[1:], atol=1e-12)


def test_joints_begin_and_end_at_rest(fr3: JointMotion) -> None:
    assert not fr3.speed[0].any()
    np.testing.assert_allclose(fr3.speed[-1], 0.0, atol=1e-9)
    np.testing.assert_array_equal(fr3.angle[0], fr3.place.home)
    assert np.abs(fr3.jerk).max() < 5_000.0


def test_torques_are_those_that_mujoco_moves_the_arm_with(fr3: JointMotion) -> None:
    model = ArmModel(fr3.arm)
    data = model.data
    k = 120
    data.qpos[:], data.qvel[:] = fr3.angle[k], fr3.speed[k]
    data.qfrc_applied[:] = fr3.torque[k]
    mujoco.mj_forward(model.model, data)
    np.testing.assert_allclose(data.qacc, fr3.acceleration[k], atol=1e-6)


def test_a_redundant_arm_comes_back_to_its_home(fr3: JointMotion) -> None:
    model, radius, t = ArmModel(fr3.arm), 0.08, np.linspace(0.0, 1.0, 3000)
    phase = 6.0 * np.pi * (10 * t**3 - 15 * t**4 + 6 * t**5)
    place = fr3.place
    path = np.stack([radius * np.sin(phase), radius * (1.0 - np.cos(phase)), 0.0 * t], axis=1)
    motion = follow(model, place, place.position + path, np.gradient(path, DT, axis=0))
    # Three rounds of the same circle: without a pull the joints would drift from one to the next.
    assert np.abs(motion.angle[-1] - place.home).max() < 0.02


def test_every_known_limit_is_checked_and_the_worst_is_told(fr3: JointMotion) -> None:
    known = {(peak.part, peak.quantity) for peak in fr3.peaks if peak.share is not None}
    assert {("fr3_joint1", name) for name in ("angle", "speed", "acceleration", "jerk", "torque")} <= known
    assert ("hand", "acceleration") in known
    assert fr3.worst is not None
    assert fr3.worst.share == max(peak.share for peak in fr3.peaks if peak.share is not None)
    index = 3
    peak = next(each for each in fr3.peaks if (each.part, each.quantity) == ("fr3_joint4", "speed"))
    assert peak.value == np.abs(fr3.speed[:, index]).max()
    assert peak.value == abs(fr3.speed[round(peak.time / DT), index])


def test_a_place_that_is_asked_for_is_kept_and_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    model = ArmModel(load_arm("ur5e"))
    place = find_place(model, (0.45, 0.1, 0.35))
    np.testing.assert_allclose(place.position, [0.45, 0.1, 0.35], atol=1e-8)
    assert math.isfinite(place.share)
    kept = list(tmp_path.rglob("*.json"))
    assert len(kept) == 1
    np.testing.assert_array_equal(find_place(model, (0.45, 0.1, 0.35)).home, place.home)


def test_a_place_out_of_reach_is_told() -> None:
    with pytest.raises(InputError, match=r"arm xarm6 cannot hold the pan level at 2, 0, 0\.3 m"):
        find_place(ArmModel(load_arm("xarm6")), (2.0, 0.0, 0.3), cached=False)


def test_a_path_beyond_the_reach_is_told_with_place_and_time() -> None:
    model = ArmModel(load_arm("xarm6"))
    place, t = find_place(model), np.linspace(0.0, 1.0, 2000)
    path = np.zeros((len(t), 3))
    path[:, 0] = 2.0 * (10 * t**3 - 15 * t**4 + 6 * t**5)
    with pytest.raises(InputError, match=r"arm xarm6 does not reach \(.*\) m in its world at t = "):
        follow(model, place, place.position + path, np.gradient(path, DT, axis=0))


def test_the_home_of_a_shipped_arm_is_as_easy_as_the_search_finds() -> None:
    arm = load_arm("ur5e")
    found = find_place(ArmModel(replace(arm, home=None)), cached=False)
    assert find_place(ArmModel(arm)).share <= 1.02 * found.share


@pytest.mark.parametrize("name", arm_names())
def test_the_joints_of_a_shipped_arm_keep_their_ranges_wherever_the_pan_goes(name: str) -> None:
    model = ArmModel(load_arm(name))
    place, farthest = find_place(model), Limits().pan_reach
    out, angle = (10 * t**3 - 15 * t**4 + 6 * t**5 for t in np.ogrid[0:1:1000j, 0:1:3000j])
    radius = farthest * np.concatenate([out.ravel(), np.ones(3000), out.ravel()[::-1]])
    turn = 2.0 * math.pi * np.concatenate([np.zeros(1000), angle.ravel(), np.ones(1000)])
    path = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros_like(turn)], axis=1) @ place.rotation.T
    motion = follow(model, place, place.position + path, np.gradient(path, DT, axis=0))
    lower, upper = model.arm.range
    assert (motion.angle > lower + 0.05).all()
    assert (motion.angle < upper - 0.05).all()


def test_a_posture_in_which_the_arm_is_stretched_is_no_share() -> None:
    model = ArmModel(replace(load_arm("iiwa14"), mount=Frame()))
    straight = level(model, np.zeros(7))
    assert straight is not None
    assert share(model, straight) == math.inf


def test_joints_as_csv_are_the_motion(fr3: JointMotion) -> None:
    sliding = np.zeros((len(fr3), 2))
    rows = list(csv.DictReader(io.StringIO(to_csv(fr3, sliding).decode())))
    assert list(rows[0]) == ["t", *(f"{kind}{i}" for kind in ("q", "qd", "qdd") for i in range(1, 8))]
    assert len(rows) == len(fr3)
    k = 77
    assert float(rows[k]["t"]) == k * DT
    assert [float(rows[k][f"qdd{i}"]) for i in range(1, 8)] == fr3.acceleration[k].tolist()


def test_joints_as_json_have_the_fields_of_a_joint_trajectory(fr3: JointMotion) -> None:
    document = json.loads(to_json(fr3, np.zeros((len(fr3), 2))))
    assert set(document) == {"header", "joint_names", "points"}
    assert document["joint_names"] == list(fr3.arm.joint_names)
    point = document["points"][250]
    assert set(point) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    assert point["time_from_start"] == {"sec": 0, "nanosec": 250_000_000}
    assert point["positions"] == fr3.angle[250].tolist()


def test_joints_as_mcap_are_read_by_another_library(fr3: JointMotion, tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros2")
    highlevel = pytest.importorskip("rosbags.highlevel")
    path = tmp_path / "joints.mcap"
    sliding = np.tile([0.03, -0.01], (len(fr3), 1))
    path.write_bytes(to_mcap(fr3, sliding))
    found: dict[str, list[tuple[int, object]]] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    (_, trajectory) = found["/joint_trajectory"][0]
    np.testing.assert_array_equal([point.positions for point in trajectory.points], fr3.angle)
    assert trajectory.points[5].time_from_start.nanosec == 5_000_000
    assert [time for time, _ in found["/pan"]] == [k * 1_000_000 for k in range(len(fr3))]
    pan, obj = (found[topic][100][1].pose for topic in ("/pan", "/object"))
    np.testing.assert_allclose([pan.position.x, pan.position.y, pan.position.z], fr3.pan[100])
    step = np.array([obj.position.x - pan.position.x, obj.position.y - pan.position.y, obj.position.z - pan.position.z])
    np.testing.assert_allclose(step, fr3.place.rotation @ [0.03, -0.01, 0.0], atol=1e-12)
    assert math.isclose(2.0 * math.atan2(pan.orientation.z, pan.orientation.w), fr3.place.heading, abs_tol=1e-9)


def test_slide_joints_shows_writes_and_exits_with_one_where_a_limit_is_passed(
    slide_joints: SlideJoints, tmp_path: Path
) -> None:
    gentle, wild, out = tmp_path / "gentle.json", tmp_path / "wild.json", tmp_path / "joints.csv"
    wave(2.0).save(gentle)
    wave(20.0).save(wild)
    code, shown, said = slide_joints(gentle, "--arm", "fr3", "-o", out)
    assert (code, said) == (0, "")
    assert "nearest singularity" in shown
    assert out.read_text().startswith("t,q1,")
    code, shown, said = slide_joints(wild, "--arm", "fr3", "--json")
    assert code == 1
    assert said.startswith("slide-joints: limit exceeded: ")
    assert "fr3_joint" in said
    assert json.loads(shown)["holds"] is False


def test_slide_joints_says_which_limits_are_unknown(slide_joints: SlideJoints, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    wave(1.0).save(plan)
    code, _, said = slide_joints(plan, "--arm", "ur5e")
    assert code == 0
    assert said == "slide-joints: note: limits on acceleration, jerk are not known for ur5e: not checked\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--arm is needed: fr3, iiwa14"),
        (["--arm", "ur6"], "there is no arm named 'ur6'"),
        (["--arm", "ur5e", "--at", "1,2"], "--at must be 3 numbers with commas between them, got '1,2'"),
        (["--arm", "ur5e", "--at", "450,0,300"], "is it in millimetres?"),
        (["--arm", "ur5e", "--at", "nan,0,0"], "--at must be 3 numbers"),
        (["--arm", "ur5e", "--tip", "tool0"], "the tip of ur5e is known"),
        (["--arm", "ur5e", "-o", "joints.txt"], "joints are written as .csv, .json, .mcap"),
        (["--arm", "nowhere.urdf"], "nowhere.urdf: cannot be read"),
    ],
)
def test_slide_joints_tells_bad_usage_in_one_line(
    arguments: list[str], message: str, slide_joints: SlideJoints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wave(1.0).save("plan.json")
    code, shown, said = slide_joints("plan.json", *arguments)
    assert (code, shown) == (2, "")
    assert message in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]

"""Arms by name and from files: what is shipped agrees with what is published, what is wrong is said in one line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.arms.description import LIMITS, Body, Frame, disc
from runtime.arms.load import arm_names, load_arm
from runtime.arms.model import ArmModel
from runtime.errors import FormatError, InputError

pytest.importorskip("mujoco")

QUARTER = math.pi / 2
CRAIG = "Craig"
PUBLISHED = {
    "fr3": [
        (0.0, 0.333, 0.0, 0.0), (0.0, 0.0, -QUARTER, 0.0), (0.0, 0.316, QUARTER, 0.0), (0.0825, 0.0, QUARTER, 0.0),
        (-0.0825, 0.384, -QUARTER, 0.0), (0.0, 0.0, QUARTER, 0.0), (0.088, 0.107, QUARTER, 0.0),
    ],
    "ur5e": [
        (0.0, 0.1625, QUARTER, 0.0), (-0.425, 0.0, 0.0, 0.0), (-0.3922, 0.0, 0.0, 0.0), (0.0, 0.1333, QUARTER, 0.0),
        (0.0, 0.0997, -QUARTER, 0.0), (0.0, 0.0996, 0.0, 0.0),
    ],
    "ur10e": [
        (0.0, 0.1807, QUARTER, 0.0), (-0.6127, 0.0, 0.0, 0.0), (-0.57155, 0.0, 0.0, 0.0),
        (0.0, 0.17415, QUARTER, 0.0), (0.0, 0.11985, -QUARTER, 0.0), (0.0, 0.11655, 0.0, 0.0),
    ],
    "iiwa14": [
        (0.0, 0.36, -QUARTER, 0.0), (0.0, 0.0, QUARTER, 0.0), (0.0, 0.42, QUARTER, 0.0), (0.0, 0.0, -QUARTER, 0.0),
        (0.0, 0.4, -QUARTER, 0.0), (0.0, 0.0, QUARTER, 0.0), (0.0, 0.126, 0.0, 0.0),
    ],
    "xarm6": [
        (0.0, 0.267, -QUARTER, 0.0), (0.28948866, 0.0, 0.0, -1.3849179), (0.0775, 0.0, -QUARTER, 1.3849179),
        (0.0, 0.3425, QUARTER, 0.0), (0.076, 0.0, -QUARTER, 0.0), (0.0, 0.097, 0.0, 0.0),
    ],
}  # fmt: skip
"""Denavit-Hartenberg parameters a, d (m), alpha, offset of theta (rad), as their makers publish them."""

THREE_JOINTS = """
  <joint name="{0}1" type="revolute"><parent link="{1}"/><child link="{0}a"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="3" effort="100"/></joint>
  <joint name="{0}2" type="revolute"><parent link="{0}a"/><child link="{0}b"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="100"/></joint>
  <joint name="{0}3" type="continuous"><parent link="{0}b"/><child link="{0}c"/><origin xyz="0 0 0.2"/>
    <axis xyz="1 0 0"/></joint>
"""
LINK = """<link name="{}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://nowhere/{}.stl"/></geometry></visual></link>"""


INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def urdf(extra: str = "", without: str = "") -> str:
    """Return the URDF of an arm of six joints whose meshes are nowhere, a gripper's two fingers at its end."""
    links = "\n".join(LINK.format(name, name) for name in ("base", "pa", "pb", "pc", "qa", "qb", "qc", "f1", "f2"))
    fingers = "".join(
        f'<joint name="f{i}" type="prismatic"><parent link="qc"/><child link="f{i}"/>'
        '<limit lower="0" upper="0.1"/></joint>'
        for i in (1, 2)
    )
    text = f'<robot name="six">{links}{THREE_JOINTS.format("p", "base")}{THREE_JOINTS.format("q", "pc")}{fingers}'
    assert without in text
    return f"{text.replace(without, '') if without else text}{extra}</robot>"


def transform(a: float, d: float, alpha: float, theta: float, convention: str) -> NDArray[np.float64]:
    c, s = np.cos(theta), np.sin(theta)
    turn, lift, along, roll = np.eye(4), np.eye(4), np.eye(4), np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    lift[2, 3], along[0, 3] = d, a
    roll[1:3, 1:3] = [[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]]
    return roll @ along @ turn @ lift if convention == CRAIG else turn @ lift @ along @ roll


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_a_shipped_arm_moves_as_its_published_table_says(name: str) -> None:
    arm = replace(load_arm(name), mount=Frame())
    q = np.random.default_rng(1).uniform(-2.0, 2.0, len(arm))
    wanted = np.eye(4)
    for (a, d, alpha, offset), theta in zip(PUBLISHED[name], q, strict=True):
        convention = CRAIG if name == "fr3" else "classic"
        wanted = wanted @ transform(a, d, alpha, theta + offset, convention)
    position, rotation, _ = ArmModel(arm).pan(q)
    np.testing.assert_allclose(position, wanted[:3, 3], atol=2e-6)
    np.testing.assert_allclose(rotation, wanted[:3, :3], atol=1e-8)


def test_the_paper_arm_begins_where_equation_29_does() -> None:
    ours = load_arm("paper")
    assert ours.home is not None
    position, rotation, _ = ArmModel(ours).pan(np.array(ours.home))
    np.testing.assert_allclose(position, (0.65, 0.0, 0.3), atol=1e-8)
    np.testing.assert_allclose(rotation, np.eye(3), atol=1e-8)


@pytest.mark.parametrize("name", arm_names())
def test_every_number_of_a_shipped_arm_has_a_source(name: str) -> None:
    arm = load_arm(name)
    assert {"kinematics", "inertia", "range", *LIMITS} <= set(arm.sources)
    for limit in arm.unknown:
        assert "not published" in arm.sources[limit] or arm.sources[limit] == "none"
    hand = (arm.hand.speed, arm.hand.acceleration, arm.hand.jerk)
    assert ("hand" in arm.sources) == any(value is not None for value in hand)


def test_a_urdf_is_read_without_its_meshes_and_to_before_its_fingers(tmp_path: Path) -> None:
    path = tmp_path / "six.urdf"
    path.write_text(urdf())
    arm = load_arm(path)
    assert arm.joint_names == ("p1", "p2", "p3", "q1", "q2", "q3")
    assert arm.joints[-1].body.mass == 3.0  # the fingers hang on it
    assert (arm.joints[0].speed, arm.joints[0].torque, arm.joints[2].lower) == (3.0, 100.0, None)
    assert arm.unknown == ("acceleration", "jerk")
    assert load_arm(path, tip="f1").joint_names[-1] == "f1"


def test_a_finger_that_another_follows_is_no_joint_of_the_arm(tmp_path: Path) -> None:
    turning = 'name="f1" type="prismatic"', 'name="f1" type="revolute"'
    follows = '<limit lower="0" upper="0.1"/></joint></robot>', '<mimic joint="f1"/></joint></robot>'
    path = tmp_path / "six.urdf"
    path.write_text(urdf().replace(*turning).replace(*follows))
    assert load_arm(path).joint_names == ("p1", "p2", "p3", "q1", "q2", "q3")
    assert load_arm(path, tip="f1").joint_names[-1] == "f1"


def test_a_urdf_is_read_with_prefixes_that_nothing_declares(tmp_path: Path) -> None:
    path = tmp_path / "six.urdf"
    path.write_text(urdf('<gazebo><sensor:camera name="eye"/></gazebo>'))
    assert len(load_arm(path)) == 6


def test_a_base_that_is_fixed_to_a_world_stands_where_that_says(tmp_path: Path) -> None:
    path = tmp_path / "six.urdf"
    path.write_text(
        urdf(
            '<link name="world"/><joint name="w" type="fixed"><parent link="world"/><child link="base"/>'
            '<origin xyz="0 0 1"/></joint>'
        )
    )
    np.testing.assert_allclose(load_arm(path).joints[0].frame.position, (0.0, 0.0, 1.2))


def test_an_mjcf_is_read_without_its_meshes(tmp_path: Path) -> None:
    body = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/><geom type="mesh" mesh="nowhere"/>'
    text, ends = "", ""
    for index, axis in enumerate(("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")):
        anchor = "0 0 0.05" if index == 1 else "0 0 0"
        text += f'<body name="b{index}" pos="0 0 0.2"><joint name="j{index}" axis="{axis}" pos="{anchor}"/>{body}'
        ends += "</body>"
    text = f'{text}<site name="flange" pos="0 0 0.1"/>{ends}'
    motor = '<actuator><motor joint="j0" gear="2" forcerange="-30 30"/></actuator>'
    asset = '<asset><mesh name="nowhere" file="nowhere.stl"/></asset>'
    path = tmp_path / "six.xml"
    free = f'<body name="cup" pos="0.5 0 0"><freejoint/>{INERTIAL}</body>'
    sliding = f'<body name="goal"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>{INERTIAL}</body>'
    path.write_text(f'<mujoco model="six">{asset}<worldbody>{text}{free}{sliding}</worldbody>{motor}</mujoco>')
    assert load_arm(path).joint_names[-1] == "j5", "what stands beside the arm is not of it"
    arm = replace(load_arm(path, tip="flange"), mount=Frame())
    assert (len(arm), arm.joints[0].torque, arm.joints[1].torque) == (6, 60.0, None)
    position = ArmModel(arm).pan(np.array([0.0, QUARTER, 0.0, 0.0, 0.0, 0.0]))[0]
    # From 0.4 m, b1's origin, the second joint's anchor is 0.05 m up, and the flange 0.9 - 0.05 m beyond it.
    np.testing.assert_allclose(position, [0.85, 0.0, 0.45], atol=1e-9)


BODY = f'<body name="b"><joint name="j" type="hinge"/>{INERTIAL}</body>'
BAD_MJCF = {
    "is NaN": BODY.replace('type="hinge"', 'type="hinge" range="nan 1"'),
    "not a model that mujoco reads": BODY.replace('mass="1"', 'mass="-1"'),
    "joint j neither turns nor slides": BODY.replace('"hinge"', '"ball"'),
    "Error opening file 'nowhere.xml'": '<include file="nowhere.xml"/>',
    "nesting is too deep": "<body>" * 10_000,
    "at least 6": BODY,
}


@pytest.mark.parametrize("message", sorted(BAD_MJCF))
def test_a_bad_mjcf_is_told_in_one_line_and_nothing_is_written(
    message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)  # where mujoco writes its log
    path = tmp_path / "bad.xml"
    path.write_text(f"<mujoco><worldbody>{BAD_MJCF[message]}</worldbody></mujoco>")
    with pytest.raises(FormatError, match=message) as caught:
        load_arm(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == [path]


BAD_URDF = {
    "'wrist'": (urdf(), "wrist"),
    "is of the type 'floating'": (
        urdf('<joint name="x" type="floating"><parent link="qc"/><child link="base"/></joint>'), None,
    ),
    "the links form a circle": (
        urdf('<joint name="x" type="fixed"><parent link="qc"/><child link="base"/></joint>'), None,
    ),
    "hangs on two joints": (
        urdf('<joint name="x" type="fixed"><parent link="qc"/><child link="pa"/></joint>'), None,
    ),
    "2 have no parent": (urdf('<link name="lost"/>'), None),
    "its child link 'nobody' is not there": (
        urdf('<joint name="x" type="fixed"><parent link="qc"/><child link="nobody"/></joint>'), None,
    ),
    "the links form a circle: base -> base": (
        urdf('<joint name="x" type="fixed"><parent link="base"/><child link="base"/></joint>'), None,
    ),
    "two links are named pa": (urdf(LINK.format("pa", "pa")), None),
    "its axis has no direction": (urdf().replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), None),
    "its child link None is not there": (urdf().replace('<child link="pb"/>', ""), None),
    "'${d1}' is no finite number: expand the xacro file first": (urdf().replace('"0 0 0.2"', '"0 0 ${d1}"', 1), None),
    "'inf' is no finite number": (urdf().replace('velocity="3"', 'velocity="inf"', 1), None),
    "ixx: 'nan' is no finite number": (urdf().replace('ixx="0.01"', 'ixx="nan"'), None),
    "'1e300' is larger than 1e+30": (urdf().replace('mass value="1"', 'mass value="1e300"'), None),
    "which is less than 0": (urdf().replace('mass value="1"', 'mass value="-1"'), None),
    "more than 10000 kg: is it in grams?": (urdf().replace('mass value="1"', 'mass value="100000"'), None),
    "200 m away, more than 10 m: is it in millimetres?": (urdf().replace('"0 0 0.2"', '"0 0 200"'), None),
    "turned by 90 rad, more than two turns: is it in degrees?": (
        urdf().replace('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0 0.2" rpy="90 0 0"/>'), None,
    ),
    "has 5 joints between its base and its tip": (
        urdf().replace('<axis xyz="1 0 0"/></joint>', '<axis xyz="1 0 0"/><mimic joint="p1"/></joint>', 1), None,
    ),
    "a <joint> has a name of 100000 letters": (urdf().replace('name="p1"', f'name="{"p" * 100_000}"'), None),
    "is of the type 'xxx": (urdf().replace('type="revolute"', f'type="{"x" * 100}"', 1), None),
    "declares the entity 'a'": (
        '<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><robot name="&b;"><link name="x"/></robot>', None,
    ),
    "'passwd'": ('<!DOCTYPE r [<!ENTITY passwd SYSTEM "file:///etc/passwd">]><robot name="&passwd;"/>', None),
    "not XML: no element": ("<robot>" + "<a>" * 100_000, None),
    "at most 30 are read": (
        '<robot name="snake">' + "".join(LINK.format(f"l{i}", "x") for i in range(101)) + "".join(
            f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
            for i in range(100)
        ) + "</robot>", None,
    ),
    "the robot has 3001 links, at most 2000 are read": (
        '<robot name="chain">' + "".join(f'<link name="l{i}"/>' for i in range(3001)) + "</robot>", None,
    ),
    "the link of joint q1 has no inertia": (urdf(without=LINK.format("qa", "qa")) .replace(
        "</robot>", '<link name="qa"/></robot>'), None),
    "limit speed of joint p1 must be greater than 0 rad/s": (urdf().replace('velocity="3"', 'velocity="0"', 1), None),
    "range is empty": (urdf().replace('lower="-2"', 'lower="2"', 1), None),
    "'nan' is no finite number": (urdf().replace('lower="-2"', 'lower="nan"', 1), None),
    "at least 6": (urdf(), "pc"),
    "has 0 joints between its base and its tip": (urdf(), "base"),
    "has 1 joint between its base and its tip": (urdf(), "pa"),
    "two joints named p1": (urdf().replace('name="p2"', 'name="p1"'), None),
    "not XML: no element found": (" \n", None),
    "the file is empty": ("", None),
    "not XML": ("<robot", None),
    "a URDF's document is <robot>": ("<other/>", None),
}  # fmt: skip


@pytest.mark.parametrize("message", sorted(BAD_URDF))
def test_a_bad_urdf_is_told_in_one_line(message: str, tmp_path: Path) -> None:
    text, tip = BAD_URDF[message]
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        load_arm(path, tip)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("file", ["kuka_iiwa/model.urdf", "franka_panda/panda.urdf", "xarm/xarm6_robot.urdf"])
def test_robots_of_others_are_read_as_they_are(file: str) -> None:
    robots = pytest.importorskip("pybullet_data")
    arm = load_arm(Path(robots.getDataPath()) / file)
    assert len(arm) in (6, 7)
    position, rotation, _ = ArmModel(arm).pan(np.zeros(len(arm)))
    assert np.isfinite(position).all()
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


def test_a_name_that_is_unknown_is_told_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="there is no arm named 'ur6': known are fr3, iiwa14, panda, paper"):
        load_arm("ur6")


def test_a_description_of_ones_own_is_checked_key_by_key(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "runtime/arms/shipped/ur5e.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert load_arm(path).joints == load_arm("ur5e").joints
    for wrong, message in (
        (text.replace("torque = 150.0", "torque = 0.0", 1), "limit torque of joint shoulder_pan_joint"),
        (text.replace("torque = 150.0", "strength = 1.0", 1), "joint[0]: unknown key 'strength'"),
        (text.replace("mass = 3.761", 'mass = "3"', 1), "joint[0].mass must be a number"),
        (text.replace("title", "titel", 1), "missing key 'title'"),
        ("a = ", "not TOML"),
    ):
        path.write_text(wrong)
        with pytest.raises(FormatError) as caught:
            load_arm(path)
        assert message in str(caught.value)


def test_bodies_add_up_as_steiner_says() -> None:
    whole = disc(2.0, 0.3)
    halves = [Body(1.0, (x, 0.0, 0.0), disc(1.0, 0.3).inertia) for x in (-0.2, 0.2)]
    both = halves[0] + halves[1]
    assert (both.mass, both.centre) == (2.0, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(both.matrix, whole.matrix + 2.0 * 0.2**2 * np.diag([0.0, 1.0, 1.0]), atol=1e-15)


@pytest.mark.parametrize("rpy", [(0.3, -0.2, 1.0), (0.1, QUARTER, 0.0), (0.0, -QUARTER, 0.7)])
def test_a_frame_keeps_its_attitude_through_matrix_and_quaternion(rpy: tuple[float, float, float]) -> None:
    frame = Frame((1.0, 2.0, 3.0), rpy)
    again = Frame.of(np.array(frame.position), frame.rotation)
    np.testing.assert_allclose(again.rotation, frame.rotation, atol=1e-7)
    w, x, y, z = frame.quaternion
    assert math.isclose(w * w + x * x + y * y + z * z, 1.0)
    np.testing.assert_allclose(frame.rotation[2, 1] - frame.rotation[1, 2], 4.0 * w * x, atol=1e-12)


def test_the_description_in_the_guide_has_every_key(tmp_path: Path) -> None:
    guide = (Path(__file__).parents[3] / "docs/guide/arms.md").read_text(encoding="utf-8")
    text = guide.partition("```toml\n")[2].partition("```")[0]
    joint = text[text.index("[[joint]]") :]
    for key in ("axis", "sliding", "lower", "upper", *LIMITS, "mass", "centre", "inertia", "radius"):
        assert f"{key} =" in joint
    path = tmp_path / "my_arm.toml"
    path.write_text(text + "".join(joint.replace('"shoulder"', f'"joint{index}"') for index in range(2, 7)))
    arm = load_arm(path)
    assert (len(arm), arm.title, arm.hand.jerk, arm.joints[5].torque) == (6, "My arm", 6500.0, 90.0)

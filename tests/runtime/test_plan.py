from __future__ import annotations

import copy
import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from runtime import FormatError, Friction, OutputError, Plan, Quality, Sizes, Status
from runtime.limits import UNITS
from runtime.physics.law import GRAVITY, slide_one
from runtime.physics.pan import integrate_pan
from runtime.plan import LEVEL_FORMAT, PLAN_FORMAT
from runtime.quality import Changes, FrictionRange, OffPan

ARRAYS = (
    "command_position",
    "pan_acceleration",
    "pan_velocity",
    "pan_position",
    "object_velocity",
    "object_position",
    "stop_acceleration",
)
finite = st.floats(allow_nan=False, allow_infinity=False)
printable = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=20)
optional_limits = st.fixed_dictionaries(dict.fromkeys(UNITS, st.none() | finite))
changes = st.builds(Changes, st.integers(0, 10**6), finite, finite)
friction_ranges = st.builds(FrictionRange, finite, *[st.none() | finite] * 4)
off_pans = st.builds(OffPan, st.integers(0, 10**6), finite)
sizes = st.builds(Sizes, st.floats(0.1, 10.0), st.floats(0.0, 0.09))


def width(name: str) -> int:
    """Return how many numbers a row has: the pan moves in space, the object on the pan."""
    return 3 if name.startswith("pan_") else 2


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    rows = draw(st.integers(1, 8))
    kinetic, static = sorted(draw(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 10.0))))
    figures = {field.name: draw(finite) for field in dataclasses.fields(Quality)[:8]}
    quality = Quality(
        **figures,
        limits=draw(optional_limits),
        margins=draw(optional_limits),
        status=draw(st.sampled_from(Status)),
        notes=tuple(draw(st.lists(printable, max_size=3))),
        worst=draw(optional_limits),
        governed=draw(st.none() | changes),
        friction=draw(st.none() | friction_ranges),
        friction_off_rmse=draw(st.none() | finite),
        rest_error=draw(st.none() | finite),
        command_off_pan=draw(st.none() | off_pans),
        object_off_pan=draw(st.none() | off_pans),
    )
    return Plan(
        dt=draw(st.floats(1e-6, 1.0)),
        model_name=draw(printable),
        model_sha256=draw(printable),
        friction=Friction(static, kinetic),
        quality=quality,
        sizes=draw(sizes),
        stop_acceleration=draw(npst.arrays(np.float64, (draw(st.integers(0, 4)), 3), elements=finite)),
        **{name: draw(npst.arrays(np.float64, (rows, width(name)), elements=finite)) for name in ARRAYS[:-1]},
    )


def assert_same(one: Plan, other: Plan) -> None:
    for name in ARRAYS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
        assert getattr(other, name).dtype == np.float64
    for name in ("dt", "model_name", "model_sha256", "friction", "sizes", "quality"):
        assert getattr(one, name) == getattr(other, name), name


@given(plans())
def test_plan_comes_back_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, plan: Plan) -> None:
    folder = tmp_path_factory.mktemp("plans")
    for suffix in (".json", ".npz"):
        plan.save(folder / f"plan{suffix}")
        assert_same(plan, Plan.load(folder / f"plan{suffix}"))
    assert_same(plan, Plan.from_dict(plan.to_dict()))


def test_document_is_laid_out_as_promised(plan: Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "plan.json")
    document = json.loads((tmp_path / "plan.json").read_text())
    assert document["format"] == "slide-plan/2" == PLAN_FORMAT
    assert {name: sorted(part) for name, part in document.items() if isinstance(part, dict)} == {
        "model": ["name", "sha256"],
        "friction": ["kinetic", "static"],
        "command": ["position"],
        "pan": ["acceleration", "position", "velocity"],
        "object": ["position", "velocity"],
        "stop": ["acceleration"],
        "sizes": ["object_radius", "pan_radius"],
        "quality": sorted(field.name for field in dataclasses.fields(Quality)),
    }
    assert np.array_equal(document["pan"]["acceleration"], plan.pan_acceleration)
    plan.save(tmp_path / "plan.npz")
    with np.load(tmp_path / "plan.npz") as arrays:
        assert np.array_equal(arrays["pan.acceleration"], plan.pan_acceleration)


def test_replay_from_a_file_is_the_prediction_bit_for_bit(plan: Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "plan.json")
    states = Plan.load(tmp_path / "plan.json").replay()
    np.testing.assert_array_equal(states, np.hstack([plan.object_position, plan.object_velocity]))


def test_replay_under_another_friction_follows_the_law(plan: Plan) -> None:
    stuck = plan.replay(Friction(10.0, 0.5))
    np.testing.assert_array_equal(stuck, np.tile([*plan.object_position[0], 0.0, 0.0], (len(plan), 1)))
    steady = dataclasses.replace(plan, pan_acceleration=np.tile([2.0, 1.0, 0.0], (len(plan), 1)))
    t = np.arange(len(plan))[:, None] * plan.dt
    smooth = steady.replay(Friction(0.0, 0.0))  # nothing pulls the object along: it stays behind in the world
    np.testing.assert_allclose(smooth[:, :2], plan.object_position[0] - 0.5 * np.array([2.0, 1.0]) * t**2, atol=1e-12)
    dragged = steady.replay(Friction(0.2, 0.1))
    speed = np.hypot(2.0, 1.0) - 0.1 * GRAVITY
    assert np.hypot(*dragged[-1, 2:]) == pytest.approx(speed * t[-1, 0] - 0.1 * GRAVITY * plan.dt, rel=1e-9)


def test_plan_with_its_stop_is_one_motion(plan: Plan) -> None:
    motion, samples = plan.with_stop(), len(plan)
    assert len(motion.acceleration) == samples + len(plan.stop_acceleration)
    np.testing.assert_array_equal(motion.acceleration[:samples], plan.pan_acceleration)
    np.testing.assert_array_equal(motion.acceleration[samples:], plan.stop_acceleration)
    np.testing.assert_array_equal(motion.pan[:samples], np.hstack([plan.pan_position, plan.pan_velocity]))
    np.testing.assert_array_equal(motion.sliding[:samples], np.hstack([plan.object_position, plan.object_velocity]))
    whole = integrate_pan(motion.pan[0], motion.acceleration)
    np.testing.assert_allclose(motion.pan[1:], whole, atol=1e-12)
    np.testing.assert_array_equal(motion.sliding[1:], slide_one(motion.sliding[0], motion.acceleration, plan.friction))
    np.testing.assert_allclose(motion.pan[-1, 3:], 0.0, atol=1e-12)


def test_plan_with_its_stop_under_another_friction_is_the_replay_and_what_follows(plan: Plan) -> None:
    motion = plan.with_stop(Friction(0.7, 0.3))
    np.testing.assert_array_equal(motion.sliding[: len(plan)], plan.replay(Friction(0.7, 0.3)))
    after = slide_one(motion.sliding[0], motion.acceleration, Friction(0.7, 0.3))
    np.testing.assert_array_equal(motion.sliding[1:], after)


def change(document: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Return a copy with the value at a dotted path replaced, or removed if it is `...`."""
    document = copy.deepcopy(document)
    *groups, name = path.split(".")
    place = document
    for group in groups:
        place = place[group]
    if value is ...:
        del place[name]
    else:
        place[name] = value
    return document


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("format", "slide-plan/3", "format must be 'slide-plan/2', got 'slide-plan/3'"),
        ("format", ..., "format must be 'slide-plan/2', got None"),
        ("format", ["slide-plan/2"], "format must be"),
        ("dt", ..., "missing key 'dt'"),
        ("dt", 0.0, "dt must be greater than 0 s"),
        ("dt", None, "dt must be a number"),
        ("dt", True, "dt must be a number"),
        ("extra", 1, "unknown key 'extra'"),
        ("model", "tiny", "model: must be an object"),
        ("model.name", 3, "model.name must be printable text"),
        ("model.name", "a\x1b[2J", "model.name must be printable text"),
        ("model.sha256", ..., "model: missing key 'sha256'"),
        ("friction.static", -1.0, "friction static must be between 0 and 10"),
        ("friction.kinetic", 3.0, "kinetic friction 3 must not exceed static"),
        ("friction.rolling", 3.0, "friction: unknown key 'rolling'"),
        ("command.position", ..., "command: missing key 'position'"),
        ("command.position", [], "command.position must have at least one row"),
        ("pan.acceleration", ..., "pan: missing key 'acceleration'"),
        ("pan.acceleration", [[0.0, 0.0, 0.0]], "pan.acceleration has 1 rows, command.position has 250"),
        ("pan.velocity", [[0.0]] * 250, r"pan.velocity\[0\] must be a triple"),
        ("pan.position", [[0.0, "1", 0.0]] * 250, r"pan.position\[0\], column y must be a number"),
        ("object.velocity", 0.0, "object.velocity must be a list"),
        ("object.position", [[1e999, 0.0]] * 250, r"object.position\[0\], column x: inf is not a finite number"),
        ("object.speed", 0.0, "object: unknown key 'speed'"),
        ("stop.acceleration", ..., "stop: missing key 'acceleration'"),
        ("stop.acceleration", [[0.0]], r"stop.acceleration\[0\] must be a triple"),
        ("sizes.pan_radius", ..., "sizes: missing key 'pan_radius'"),
        ("sizes.pan_radius", -1.0, "pan_radius must be above 0 and at most 10 m, got -1 m"),
        ("sizes.object_radius", 0.2, "object_radius must be at least 0 m and less than the pan's, 0.18 m, got 0.2 m"),
        ("quality.object_off_pan", 3, "quality.object_off_pan: must be an object"),
        ("quality.tracking_rmse", ..., "quality: missing key 'tracking_rmse'"),
        ("quality.pan_reach", "far", "quality.pan_reach must be a number"),
        (
            "quality.status",
            "fine",
            "quality.status must be one of ok, governed, limited, beyond_training_range, poor, cannot_slide, off_pan, ",
        ),
        ("quality.status", ["ok"], "quality.status must be printable text"),
        ("quality.notes", "fine", "quality.notes must be a list"),
        ("quality.notes", [1], r"quality.notes\[0\] must be printable text"),
        ("quality.limits.pan_reach", ..., "quality.limits: missing key 'pan_reach'"),
        ("quality.limits.height", ..., "quality.limits: missing key 'height'"),
        ("quality.limits.force", 1.0, "quality.limits: unknown key 'force'"),
        ("quality.margins.acceleration", "none", "quality.margins.acceleration must be a number"),
    ],
)
def test_bad_document_is_a_format_error_naming_the_key(plan: Plan, path: str, value: Any, message: str) -> None:
    with pytest.raises(FormatError, match=f"^plan: {message}"):
        Plan.from_dict(change(plan.to_dict(), path, value))


@pytest.mark.parametrize("document", [None, [], 3, "slide-plan/1"])
def test_what_is_no_document_is_a_format_error(document: object) -> None:
    with pytest.raises(FormatError, match="format must be"):
        Plan.from_dict(document)


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_truncated_file_is_a_format_error(plan: Plan, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"plan{suffix}"
    plan.save(path)
    whole = path.read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(FormatError, match=r"truncated|not a readable npz|empty"):
            Plan.load(path)


def test_nan_in_json_is_a_format_error(plan: Plan, tmp_path: Path) -> None:
    document = change(plan.to_dict(), "pan.velocity", [[float("nan"), 0.0, 0.0]] * len(plan))
    (tmp_path / "plan.json").write_text(json.dumps(document))
    with pytest.raises(FormatError, match="NaN is not a finite number"):
        Plan.load(tmp_path / "plan.json")


def test_wrong_npz_is_a_format_error(plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "plan.npz"
    plan.save(path)
    with np.load(path) as file:
        arrays = dict(file)
    for changes, message in [
        ({"pan.velocity": np.full((250, 3), np.nan)}, r"pan.velocity\[0\], column x: nan"),
        ({"pan.velocity": np.zeros((250, 2))}, r"pan.velocity must have the shape \(K, 3\)"),
        ({"dt": np.array(np.nan)}, "dt must be a number"),
        ({"friction.static": np.ones(2)}, "friction.static must be a number"),
        ({"format": np.array(1.0)}, "format must be"),
        ({"dt.more": np.array(1.0)}, "below a value|both a value and a group"),
        ({"object": np.array(1.0)}, "below a value|both a value and a group"),
        ({"pan.mass": np.array(1.0)}, "pan: unknown key 'mass'"),
        ({"quality.status": np.array([1.0, 2.0])}, "quality.status must be printable text"),
    ]:
        np.savez(path, **(arrays | changes))
        with pytest.raises(FormatError, match=message):
            Plan.load(path)


def test_another_suffix_is_refused(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"written as .json, .npz, .csv or .parquet, got the suffix '.yaml'"):
        plan.save(tmp_path / "plan.yaml")
    with pytest.raises(FormatError, match=r"is a .json or .npz file"):
        Plan.load(tmp_path / "plan.yaml")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".json", ".npz"])
@pytest.mark.parametrize("failing", ["replace", "fsync"])
def test_plan_file_appears_whole_or_not_at_all(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, failing: str
) -> None:
    path = tmp_path / f"plan{suffix}"
    path.write_bytes(b"what was there")

    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, failing, fail)
    with pytest.raises(OutputError, match="cannot be written: No space left on device"):
        plan.save(path)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"what was there"


def test_interrupted_save_leaves_nothing(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        plan.save(tmp_path / "plan.json")
    assert not list(tmp_path.iterdir())


def test_save_into_what_cannot_hold_it_is_an_output_error(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "absent" / "plan.json", tmp_path / "folder.json", tmp_path / "file" / "plan.json"):
        with pytest.raises(OutputError, match="cannot be written"):
            plan.save(path)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder.json"]


LEVEL_PLAN = Path(__file__).parents[1] / "data" / "level_plan.json"
"""Written by version 0.2.0, whose plans are in the plane."""


def test_plan_in_the_plane_is_read_as_a_level_one() -> None:
    written = json.loads(LEVEL_PLAN.read_text())
    assert written["format"] == "slide-plan/1" == LEVEL_FORMAT
    plan = Plan.load(LEVEL_PLAN)
    for name in ("acceleration", "velocity", "position"):
        rows = getattr(plan, f"pan_{name}")
        np.testing.assert_array_equal(rows[:, :2], written["pan"][name])
        assert not rows[:, 2].any()
    np.testing.assert_array_equal(plan.stop_acceleration[:, :2], written["stop"]["acceleration"])
    assert plan.stop_acceleration.shape == (len(written["stop"]["acceleration"]), 3)
    quality = plan.quality
    assert quality.limits == {"pan_reach": 0.2, "height": 0.0, "speed": None, "acceleration": 30.0, "jerk": 10_000.0}
    assert (quality.height_max, quality.margins["height"], quality.margins["speed"]) == (0.0, 0.0, None)
    assert quality.speed_max == np.hypot(*np.array(written["pan"]["velocity"]).T).max()
    motion = plan.with_stop()
    np.testing.assert_allclose(motion.pan[-1, 3:], 0.0, atol=1e-12)
    np.testing.assert_array_equal(motion.sliding[: len(plan), :2], written["object"]["position"])
    again = Plan.from_dict(plan.to_dict())
    assert plan.to_dict()["format"] == PLAN_FORMAT
    assert_same(plan, again)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("pan.acceleration", [[0.0, 0.0, 0.0]], r"pan.acceleration\[0\] must be a pair"),
        ("stop.acceleration", [[0.0, 0.0, 0.0]], r"stop.acceleration\[0\] must be a pair"),
        ("quality", "good", "quality: must be an object"),
        ("quality.limits", "none", "quality.limits: must be an object"),
        ("quality.limits.force", 1.0, "quality.limits: unknown key 'force'"),
        ("format", "slide-plan/2", r"pan.velocity\[0\] must be a triple"),
    ],
)
def test_bad_plan_in_the_plane_is_a_format_error_naming_the_key(path: str, value: Any, message: str) -> None:
    document = json.loads(LEVEL_PLAN.read_text())
    with pytest.raises(FormatError, match=f"^plan: {message}"):
        Plan.from_dict(change(document, path, value))


def test_plan_written_before_the_governor_the_rim_and_the_stop_is_still_read() -> None:
    document = json.loads(LEVEL_PLAN.read_text())
    del document["sizes"], document["stop"]
    quality = document["quality"]
    for name in (
        "worst",
        "governed",
        "friction",
        "friction_off_rmse",
        "rest_error",
        "command_off_pan",
        "object_off_pan",
    ):
        del quality[name]
    for name in ("limits", "margins"):
        quality[name] = {"pan_reach": 0.2, "acceleration": None}
    quality["status"] = "limit_exceeded"
    assert Plan.from_dict(document).sizes == Sizes(0.18, 0.03)
    assert Plan.from_dict(document).stop_acceleration.shape == (0, 3)
    old = Plan.from_dict(document).quality
    assert old.limits == {"pan_reach": 0.2, "height": 0.0, "speed": None, "acceleration": None, "jerk": None}
    assert (old.governed, old.friction, old.worst) == (None, None, dict.fromkeys(UNITS))
    assert old.status is Status.LIMIT_EXCEEDED

"""Tasks on pans of several kinds: what they ask, and that their figures are those of the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.section import Subject
from benchmarks.sections.accuracy import SECTION, TARGETS, AccuracySettings
from benchmarks.sections.on_pans import DISTURBED
from benchmarks.suite.pans import PANS, TASKS, cannot_slide, summary, tasks
from benchmarks.suite.suite import FAMILIES, suite
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import DT


def test_every_task_has_a_name_of_its_own_and_a_target_for_its_figures() -> None:
    names = [task.name for task in TASKS]
    assert len(set(names)) == len(names)
    assert all("." not in name for name in names)
    aimed = {target.figure for target in TARGETS}
    assert all(f"pans.tasks.{task.name}.lifting.tracking_mean" in aimed for task in TASKS)
    assert DISTURBED.name == "default_100_50_spline"


def test_tasks_are_chosen_by_pan_and_family() -> None:
    assert {task.pan for task in tasks(["all"], tuple(FAMILIES))} == set(PANS)
    assert [task.name for task in tasks(["panda"], ["stops"])] == ["panda_100_50_stops"]
    with pytest.raises(InputError, match="there is no pan 'kuka': known are default, panda, fr3"):
        tasks(["kuka"], ["spline"])


def test_commands_are_smaller_and_slower_where_the_task_says_so() -> None:
    spline = suite(["spline"], 1)["spline"].positions[0]
    (weak,), (small,) = ([task for task in TASKS if task.pan == name][:1] for name in ("weak", "small"))
    (slow,), (half,) = weak.positions(1), small.positions(1)
    assert len(slow) == 4 * (len(spline) - 1) + 1
    assert slow[::4] == pytest.approx(spline, abs=1e-15)
    assert half == pytest.approx(0.5 * spline)


def test_few_commands_are_spread_over_the_family() -> None:
    (task,) = tasks(["panda"], ["shapes"])
    shapes = suite(["shapes"])["shapes"].positions
    few = task.positions(4)
    assert all(np.array_equal(each, shapes[index]) for each, index in zip(few, (0, 4, 7, 11), strict=True))
    assert len(task.positions(None)) == len(task.positions(99)) == len(shapes)


def test_drawings_are_planned_with_the_rest(tiny_bundle: Path, tmp_path: Path) -> None:
    file = tmp_path / "drawings.csv"
    file.write_text("88,92,2,99,16,66,94,37,70,0,0,24,42,65,100,100,8\n")
    settings = AccuracySettings(family=("short",), commands=1, limits=("slow",), drawings=file)
    figures, notes = SECTION.measure(Subject.load(tiny_bundle), settings)
    assert list(figures.pans.tasks) == ["default_100_50_drawings"]
    assert figures.pans.tasks["default_100_50_drawings"].lifting.tracking_mean > 0.0
    assert not notes
    with pytest.raises(InputError, match="--drawings are planned within limits"):
        AccuracySettings(drawings=file)


def test_a_level_pan_of_an_fr3_cannot_slide_its_object() -> None:
    (task,) = tasks(["fr3"], ["spline"])[:1]
    assert cannot_slide(task)
    assert not cannot_slide(task.lifting())


def test_figures_are_those_of_the_motion() -> None:
    u = np.tile([6.0, 0.0, 8.0], (100, 1))
    found = summary([np.zeros((100, 2))], [u], Friction(1.0, 0.5))
    t = 100 * DT
    assert (found.acceleration, found.jerk) == pytest.approx((10.0, 10.0 / DT))
    assert (found.pan_reach, found.height, found.speed) == pytest.approx((3.0 * t**2, 4.0 * t**2, 10.0 * t))
    assert found.tracking_mean == 0.0  # what rises is pressed on the pan
    assert summary([np.zeros((100, 2))], [u[:, :2] * 2.0], Friction(1.0, 0.5)).tracking_max > 0.0


def test_the_section_measures_pans_in_the_place_of_the_suite(tiny_bundle: Path) -> None:
    settings = AccuracySettings(family=("spline",), commands=1, limits=("default", "slow"))
    figures, _ = SECTION.measure(Subject.load(tiny_bundle), settings)
    assert list(figures.pans.tasks) == ["default_100_50_spline", "slow_100_50_spline"]
    level, lifting = figures.pans.level, figures.pans.lifting
    assert level.asked > 0.0
    assert level.refined <= level.robust
    assert min(level.friction_worst, lifting.friction_worst) > 0.0
    assert figures.families == {}
    assert SECTION.tables(figures, [])

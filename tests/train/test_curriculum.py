"""The curriculum is Table I, and models A, B and C are what Section V-B says."""

from __future__ import annotations

import itertools

import pytest

from train.curriculum import GRADUAL, MID_COURSE, TABLE_I, task_at


@pytest.mark.parametrize(
    ("epoch", "stage", "pan_loss", "physics"),
    [
        (1, 1, 1.0, 1.0),
        (10, 1, 1.0, 1.0),
        (11, 2, 0.1, 1.0),
        (20, 2, 1.0, 1.0),
        (21, 3, 0.0, 1.0),
        (30, 3, 0.0, 1.0),
        (31, 4, 0.0, 0.1),
        (35, 4, 0.0, 0.5),
        (40, 4, 0.0, 1.0),
        (41, 5, 0.0, 0.0),
        (50, 5, 0.0, 0.0),
    ],
)
def test_table_1_is_the_papers(epoch, stage, pan_loss, physics):
    task = task_at(TABLE_I, "A", epoch, 50)
    assert (task.stage, task.pan_loss, task.physics) == (stage, pytest.approx(pan_loss), pytest.approx(physics))
    assert not task.varied_friction


@pytest.mark.parametrize("epoch", [1, 25, 50])
def test_model_b_is_stage_3_alone_and_model_c_stage_1_alone(epoch):
    for stages in (TABLE_I, GRADUAL):
        b, c = task_at(stages, "B", epoch, 50), task_at(stages, "C", epoch, 50)
        assert (b.stage, b.pan_loss, b.physics) == (3, 0.0, 1.0)
        assert (c.stage, c.pan_loss, c.physics) == (1, 1.0, 1.0)


def test_gradual_curriculum_fades_each_task_out():
    tasks = [task_at(GRADUAL, "A", epoch, 50) for epoch in range(1, 51)]
    assert all(before.pan_loss >= after.pan_loss for before, after in itertools.pairwise(tasks))
    assert all(before.physics >= after.physics for before, after in itertools.pairwise(tasks))
    assert (tasks[0].pan_loss, tasks[-1].pan_loss, tasks[-1].physics) == (1.0, 0.0, 0.0)
    assert tasks[-1].varied_friction


def test_second_half_in_mid_course_is_late():
    assert [task_at(MID_COURSE, "A", epoch, 10).late for epoch in range(1, 11)] == [False] * 5 + [True] * 5


@pytest.mark.parametrize("epochs", [5, 50, 100])
def test_stages_stretch_over_the_epochs(epochs):
    stages = [task_at(TABLE_I, "A", epoch, epochs).stage for epoch in range(1, epochs + 1)]
    assert stages == sorted(stages)
    assert stages.count(1) == stages.count(5) == epochs // 5

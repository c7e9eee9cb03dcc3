"""The curriculum is Table I, and models A, B and C are what Section V-B says."""

from __future__ import annotations

import pytest

from train.paper.curriculum import task_at


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
    task = task_at("A", epoch, 50)
    assert (task.stage, task.pan_loss, task.physics) == (stage, pytest.approx(pan_loss), pytest.approx(physics))


@pytest.mark.parametrize("epoch", [1, 25, 50])
def test_model_b_is_stage_3_alone_and_model_c_stage_1_alone(epoch):
    b, c = task_at("B", epoch, 50), task_at("C", epoch, 50)
    assert (b.stage, b.pan_loss, b.physics) == (3, 0.0, 1.0)
    assert (c.stage, c.pan_loss, c.physics) == (1, 1.0, 1.0)


@pytest.mark.parametrize("epochs", [5, 50, 100])
def test_stages_stretch_over_the_epochs(epochs):
    stages = [task_at("A", epoch, epochs).stage for epoch in range(1, epochs + 1)]
    assert stages == sorted(stages)
    assert stages.count(1) == stages.count(5) == epochs // 5

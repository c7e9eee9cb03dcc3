"""Models on the simulated arm, as `slide-eval --pybullet` runs them; and the paper's network in closed loop."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from runtime.physics.pan import IN_PLANE
from runtime.planner import DEFAULT_BUNDLE
from train.commands.batch import make_batch
from train.commands.families import free_commands
from train.evaluation.evaluate import PaperStream, commands_of, load_subjects
from train.paper.closed_loop import decode
from train.paper.network import PaperNetwork


def test_stream_of_a_network_is_its_decoding():
    torch.manual_seed(0)
    model = PaperNetwork(units=12)
    command = free_commands(np.random.default_rng(0), 1, 400, {"moves": 1.0}, (0.03, 0.1), 0.7, 1).position
    batch = make_batch(command, np.array([400]), None, np.ones(1), 0.5 * np.ones(1))
    with torch.no_grad():
        motion = decode(model, batch.command, batch.static, batch.kinetic)
    states = np.concatenate([np.zeros((100, 8)), motion.states[0].numpy()])
    stream = PaperStream(model, command[0])
    for n in range(4):
        seen = states[100 * n : 100 * (n + 1)]
        pan = np.zeros((100, 6))
        pan[:, IN_PLANE] = seen[:, :4]
        u = stream.step(pan, seen[:, 4:])
        assert not u[:, 2].any()
        assert u[:, :2] == pytest.approx(motion.u[0, 100 * n : 100 * (n + 1)].numpy(), abs=1e-5)


def test_a_model_is_executed_in_every_way_and_drawn():
    pytest.importorskip("pybullet")
    figure = pytest.importorskip("matplotlib.figure")
    from train.evaluation import arm

    subject = load_subjects(DEFAULT_BUNDLE)[0]
    position = commands_of("spline_acceleration", 1)
    rows = arm.evaluate_on_arm(subject, position)
    assert list(rows) == [arm.LAW, *arm.WAYS]
    assert rows["closed loop"].rmse_mean < 0.01
    assert rows["open loop, paper control"].pan_worst > 10 * rows["open loop"].pan_worst
    assert len(arm.arm_table({"default": rows}).splitlines()) == 2 + len(rows)

    run = arm.photograph(subject, position[0])
    assert run.object_position.shape == run.pan_position.shape == position[0].shape
    assert [picture.shape for picture in run.snapshots] == [(360, 480, 3)] * len(arm.SNAPSHOTS)
    assert len(arm.draw_snapshots(figure.Figure, [run, run]).axes) == 2 * len(arm.SNAPSHOTS)

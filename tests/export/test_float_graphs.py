"""The graphs do what the network does."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch

from export.float_graphs import decoder_step_graph, encoder_graph
from export.quantize import quantize_bundle
from export.verify import VerificationError, verify
from export.write_bundle import export_bundle
from runtime import Command, Friction, Limits, Planner, Start
from runtime.network.bundle import Bundle
from runtime.network.job import Job
from runtime.network.onnx_check import check_graph
from runtime.network.reach import with_reach
from runtime.network.units import (
    AHEAD,
    AHEAD_ROWS,
    CHUNK,
    ENCODER_CHUNK,
    ENCODER_ROWS,
    OBSERVED,
    SEEN_ROWS,
    Constants,
    Situation,
)
from train.config import load_config
from train.evaluation.evaluate import commands_of, load_subjects
from train.learn.checkpoint import load_checkpoint
from train.network.network import Network, Told, observe
from train.network.real_time import PanLimits, follow
from train.network.recipe import VALIDATED, load_network


@pytest.mark.parametrize("height", [0.0, 0.1])
def test_graphs_do_what_the_network_does(height):
    torch.manual_seed(0)
    network, rng, batch = Network(24, features=20), np.random.default_rng(0), 3
    with torch.no_grad():
        network.output.weight *= 20.0  # so that the bounds are met
    graphs = encoder_graph(network), decoder_step_graph(network)
    for graph in graphs:
        check_graph(graph)
    encoder, decoder = (onnxruntime.InferenceSession(graph) for graph in graphs)
    situation = Situation(*(np.full(batch, part) for part in (15.0, 5_000.0, 2.0, height, 0.5, 0.3, 1.0)))
    told = Told.of(situation)

    command = rng.normal(0, 0.05, (batch, 2 * ENCODER_CHUNK, 4))
    rows = command.reshape(batch, 2, ENCODER_CHUNK, 4)[:, :, list(ENCODER_ROWS)].reshape(batch, 2, -1)
    conditions = situation.conditions()
    fed = np.concatenate([rows, np.repeat(conditions[:, None], 2, axis=1)], axis=2).astype(np.float32)
    hidden, cell = encoder.run(None, {"command": fed})
    with torch.no_grad():
        state = network.encode(torch.from_numpy(command), told)
    np.testing.assert_allclose(hidden, state.hidden, atol=1e-5)
    np.testing.assert_allclose(cell, state.cell, atol=1e-5)

    states, ahead, last = (rng.normal(0, 0.1, (batch, *shape)) for shape in ((CHUNK, 10), (AHEAD, 4), (3,)))
    here = np.concatenate([ahead[:, :1, :2], np.zeros((batch, 1, 2))], axis=2)
    seen = states[:, list(SEEN_ROWS)] - np.concatenate([np.zeros((batch, 1, 6)), here], axis=2)
    later = ahead[:, list(AHEAD_ROWS)] - here
    parts = [seen.reshape(batch, -1), last, later.reshape(batch, -1), conditions, np.full((batch, 1), 0.5)]
    observation = np.concatenate(parts, axis=1).astype(np.float32)
    assert observation.shape == (batch, OBSERVED)
    found = decoder.run(None, {"observation": observation, "hidden": hidden, "cell": cell})
    with torch.no_grad():
        tensors = [torch.from_numpy(part) for part in (states, ahead, last)]
        wanted, after = network.step(observe(tensors[0], tensors[1], tensors[2], told, 0.5), told, state)
    np.testing.assert_allclose(found[0], wanted, atol=2e-4)
    np.testing.assert_allclose(found[1], after.hidden, atol=1e-5)
    np.testing.assert_allclose(found[2], after.cell, atol=1e-5)
    assert np.linalg.norm(found[0], axis=-1).max() > 20.0
    assert bool(found[0][..., 2].any()) == (height > 0.0)


def test_run_is_exported_as_a_bundle_that_answers_alike(run, tmp_path):
    agreement = export_bundle(run, tmp_path / "bundle").agreement
    assert agreement.questions > 20
    assert 0.0 < agreement.acceleration < 1e-5
    manifest = Bundle.load(tmp_path / "bundle").manifest
    config = load_config("smoke")
    assert (manifest.network, manifest.units) == (Constants(), config.units)
    assert manifest.training["configuration"] == config.model_dump(mode="json")
    assert manifest.trained_on["jerk"] == config.jerk
    assert manifest.trained_on["reach"] == (0.0, 1.5)
    assert set(manifest.evaluation) == {f"{name}_{what}" for name in VALIDATED for what in ("tracking", "reach")}


def test_bundle_that_answers_otherwise_is_refused(run, tmp_path):
    export_bundle(run, tmp_path / "bundle")
    _, network = load_network(load_checkpoint(run))
    with torch.no_grad():
        network.output.bias[3] += 0.001
    with pytest.raises(VerificationError, match="answers of the bundle"):
        verify(network, tmp_path / "bundle")


@pytest.mark.parametrize("pan", [PanLimits(0.2, 30.0, 10_000.0, height=0.1), PanLimits(0.1, 40.0, 20_000.0)])
def test_runtime_follows_as_the_training_s_own_loop_does(run, tmp_path, pan):
    export_bundle(run, tmp_path / "bundle")
    _, network = load_network(load_checkpoint(run))
    position = 0.5 * commands_of("spline_acceleration", 3)[:, :200]
    friction = Friction(0.3, 0.2)
    limits = Limits(pan.reach, height=pan.height, acceleration=pan.acceleration, jerk=pan.jerk)
    plans = Planner(tmp_path / "bundle").plan_batch(position, friction, limits=limits)
    for each, plan in zip(position, plans, strict=True):
        job = with_reach(Job(Command(each), friction, limits, Start()))
        followed = follow(network, each[None], pan, friction, friction, reach_used=job.reach_used)
        u, sliding = followed.acceleration[0], followed.sliding[0]
        # Two chunks, or three: until the pan comes to the end of its reach, which is nobody's in the training's loop.
        first = plan.pan_acceleration[:90]
        assert np.abs(first).max() > 5.0
        assert first == pytest.approx(u[:90], abs=2e-3)
        assert plan.object_position[1:90] == pytest.approx(sliding[:89, :2], abs=1e-6)


def test_int8_bundle_plans_nearly_as_well_on_every_pan(run, tmp_path):
    export_bundle(run, tmp_path / "bundle")
    comparison = quantize_bundle(tmp_path / "bundle", tmp_path / "int8", max_growth=0.5).comparison
    assert comparison.commands == 3 * 16 * 7
    manifest = Bundle.load(tmp_path / "int8").manifest
    assert manifest.precision == "int8"
    position = commands_of("spline_acceleration", 2)[:, :300]
    plans = (Planner(tmp_path / name).plan_batch(position, limits=Limits(height=0.1)) for name in ("bundle", "int8"))
    for fp32, int8 in zip(*plans, strict=True):
        assert int8.pan_acceleration[:60] == pytest.approx(fp32.pan_acceleration[:60], abs=1.5)


def test_run_and_bundle_are_evaluated_level_and_lifting(run, tmp_path):
    export_bundle(run, tmp_path / "bundle")
    subjects = [*load_subjects(run, "a"), *load_subjects(tmp_path / "bundle", "b")]
    assert [each.name for each in subjects] == ["a", "a, lifting", "b", "b, lifting"]
    assert subjects[0].origin == "0 trajectories; acceleration, jerk and speed held"
    assert subjects[2].origin == "0 trajectories; limits in force"
    position = commands_of("moves", 2)[:, :200]
    for each in subjects:
        plans = each.plan(position, Friction())
        assert plans[0].pan_acceleration[:, 2].any() == ("lifting" in each.name)

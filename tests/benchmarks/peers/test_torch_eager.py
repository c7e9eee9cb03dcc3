"""Torch eager is the same planner as the runtime, but for the engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.peers.torch_eager import EagerPlanner, eager_model, untrained_model
from benchmarks.suite.families import odd, spline
from runtime.network.bundle import Bundle
from runtime.plan import Plan
from runtime.planner import Planner


def assert_same_until_the_branches_part(ours: Plan, eager: Plan) -> None:
    """Compare two plans up to the first sample at which the object slides in one and sticks in the other."""
    differs = np.flatnonzero(ours.object_velocity.any(axis=1) != eager.object_velocity.any(axis=1))
    end = int(differs[0]) if differs.size else len(ours)
    assert end >= 200
    assert np.abs(ours.pan_acceleration[:end] - eager.pan_acceleration[:end]).max() <= 1e-3
    assert np.abs(ours.object_position[:end] - eager.object_position[:end]).max() <= 1e-5


@pytest.mark.parametrize("command_ahead", [0, 2])
def test_torch_eager_plans_what_the_runtime_plans(make_bundle: Callable[..., Path], command_ahead: int) -> None:
    bundle = make_bundle(command_ahead=command_ahead)
    position = odd().positions[0]
    ours = Planner(bundle).plan(position)
    assert ours.object_velocity.any()  # a stuck object would make the comparison easy
    assert_same_until_the_branches_part(ours, EagerPlanner(bundle).plan(position))


def test_torch_eager_plans_batches(tiny_bundle: Path) -> None:
    positions = spline().positions[:3]
    plans = zip(
        Planner(tiny_bundle).plan_batch(positions), EagerPlanner(tiny_bundle).plan_batch(positions), strict=True
    )
    for ours, eager in plans:
        assert_same_until_the_branches_part(ours, eager)


def test_a_quantized_bundle_is_timed_with_drawn_weights_of_its_sizes(tiny_bundle: Path) -> None:
    bundle = Bundle.load(tiny_bundle)
    quantized = replace(bundle, manifest=replace(bundle.manifest, precision="int8"))
    model = eager_model(tiny_bundle, quantized)
    assert model.units == bundle.manifest.units
    assert torch.equal(model.output.weight, untrained_model(bundle.manifest).output.weight)
    assert not torch.equal(model.output.weight, eager_model(tiny_bundle, bundle).output.weight)


def test_building_it_leaves_torch_s_generator_alone(tiny_bundle: Path) -> None:
    before = torch.random.get_rng_state()
    EagerPlanner(tiny_bundle)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_shipped_bundle_is_known_by_its_name_here_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (position,) = spline().positions[:1]
    assert_same_until_the_branches_part(Planner("fp32").plan(position), EagerPlanner("fp32").plan(position))

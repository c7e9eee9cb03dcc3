"""Torch eager is the same planner as the runtime, but for the engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from benchmarks.peers.torch_eager import EagerPlanner
from benchmarks.suite.families import odd, spline
from runtime.plan import Plan
from runtime.planner import Planner

from ..conftest import large_network


def assert_same_until_the_branches_part(ours: Plan, eager: Plan) -> None:
    """Compare two plans up to the first sample at which the object slides in one and sticks in the other."""
    differs = np.flatnonzero(ours.object_velocity.any(axis=1) != eager.object_velocity.any(axis=1))
    end = int(differs[0]) if differs.size else len(ours)
    assert end >= 200
    assert np.abs(ours.pan_acceleration[:end] - eager.pan_acceleration[:end]).max() <= 1e-3
    assert np.abs(ours.object_position[:end] - eager.object_position[:end]).max() <= 1e-5


def test_torch_eager_plans_what_the_runtime_plans(tiny_bundle: Path) -> None:
    position = odd().positions[0]
    ours = Planner(tiny_bundle).plan(position, candidates=1)
    assert ours.object_velocity.any()  # a stuck object would make the comparison easy
    assert_same_until_the_branches_part(ours, EagerPlanner(tiny_bundle, large_network()).plan(position, candidates=1))


def test_torch_eager_plans_batches(tiny_bundle: Path) -> None:
    positions = spline().positions[:3]
    planners = Planner(tiny_bundle), EagerPlanner(tiny_bundle, large_network())
    for ours, eager in zip(*(planner.plan_batch(positions) for planner in planners), strict=True):
        assert_same_until_the_branches_part(ours, eager)


def test_a_bundle_alone_is_timed_with_drawn_weights_of_its_sizes(tiny_bundle: Path) -> None:
    one, other = (EagerPlanner(tiny_bundle).plan(spline().positions[0], candidates=1) for _ in range(2))
    assert np.array_equal(one.pan_acceleration, other.pan_acceleration)
    assert not np.array_equal(
        one.pan_acceleration, Planner(tiny_bundle).plan(one.command_position, candidates=1).pan_acceleration
    )


def test_building_it_leaves_torch_s_generator_alone(tiny_bundle: Path) -> None:
    before = torch.random.get_rng_state()
    EagerPlanner(tiny_bundle)
    assert torch.equal(torch.random.get_rng_state(), before)

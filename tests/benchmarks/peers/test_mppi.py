"""The library's path-integral planner: it tracks, within the bound, and the same from the same seed."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.mppi import PathIntegral
from benchmarks.peers.objective import ACCELERATION
from benchmarks.suite.outcome import plan_family
from benchmarks.suite.suite import suite
from runtime import Friction


def test_planner_tracks_better_than_a_still_pan_and_keeps_to_the_bound():
    outcome = plan_family(PathIntegral(128, 6), suite(["short"])["short"].first(1))
    assert outcome.tracking[0] < 0.7 * outcome.unmoved[0]
    assert outcome.acceleration_max.max() <= ACCELERATION * (1 + 1e-12)


def test_plan_is_the_same_from_the_same_seed():
    position = suite(["short"])["short"].positions[0][:177]
    one, two = (PathIntegral(16, 2).plan(position, Friction()) for _ in range(2))
    assert one.shape == (177, 2)
    assert np.array_equal(one, two)

"""The optimizer that the network is measured against: it tracks, within its limits, and better with more effort."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.peers.cross_entropy import CrossEntropy
from benchmarks.peers.objective import ACCELERATION
from benchmarks.suite.outcome import plan_family
from benchmarks.suite.pans import summary
from benchmarks.suite.suite import suite
from runtime import Friction, Limits
from runtime.limits import LARGEST_SINK


@pytest.fixture(scope="module")
def spline():
    return suite(["spline"])["spline"].first(3)


def test_more_candidates_and_iterations_track_better_and_a_still_pan_is_worst(spline):
    few, many = (plan_family(CrossEntropy(*effort), spline) for effort in ((64, 3), (256, 12)))
    assert many.tracking.mean() < few.tracking.mean() < spline_unmoved(spline)
    assert many.tracking.mean() < 0.008


def spline_unmoved(family):
    return np.mean([np.sqrt((position**2).sum(-1).mean()) for position in family.positions])


def test_plan_keeps_to_the_bound_and_about_to_the_pan_limit(spline):
    outcome = plan_family(CrossEntropy(128, 6), spline)
    assert outcome.acceleration_max.max() <= ACCELERATION * (1 + 1e-12)
    assert outcome.pan_reach.max() < 0.25


def test_plan_is_the_same_from_the_same_seed_whatever_the_length(spline):
    position, friction = spline.positions[0][:777], Friction()
    one, two = (CrossEntropy(32, 2).plan(position, friction) for _ in range(2))
    assert one.shape == (777, 2)
    assert np.array_equal(one, two)
    assert not np.array_equal(one, CrossEntropy(32, 2, seed=1).plan(position, friction))


def test_knots_and_spreads_are_in_the_units_of_the_limits():
    tuned, default, weak, small = (
        CrossEntropy(limits=limits) for limits in (None, Limits(), Limits(acceleration=7.5), Limits(0.05))
    )
    assert [planner.span for planner in (tuned, default, weak, small)] == [10, 10, 20, 5]
    assert [planner.strength for planner in (tuned, default, weak, small)] == [1.0, 1.0, 0.25, 1.0]


@pytest.mark.parametrize("limits", [Limits.named("panda"), Limits(acceleration=13.0, jerk=6_500.0)])
def test_plan_keeps_the_limits_that_it_is_given(spline, limits):
    planner = CrossEntropy(64, 4, limits=limits)
    friction = Friction(0.5, 0.3)
    u = planner.plan(spline.positions[0][:600], friction)
    found = summary([spline.positions[0][:600]], [u], friction)
    assert u.shape == (600, 2 if limits.level else 3)
    assert found.acceleration <= limits.acceleration * (1 + 1e-9)
    assert found.jerk <= limits.jerk * (1 + 1e-9)
    assert found.speed < 1.1 * limits.speed
    assert found.tracking_mean < 0.02
    assert u[:, 2:].min(initial=0.0) >= -LARGEST_SINK - 1e-9

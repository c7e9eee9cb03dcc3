"""The network's units: in them every pan is the same pan, and the law the same law."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.friction import Friction
from runtime.network.units import (
    ACCELERATION,
    CONDITIONS,
    LARGEST_HEIGHT,
    LARGEST_JERK,
    LARGEST_SPEED,
    LEAST_JERK,
    REACH,
    Situation,
    Units,
)
from runtime.physics.law import DT, GRAVITY, slide_one


def situation(reach, acceleration, jerk, speed=np.inf, height=0.0, static=0.5, kinetic=0.3, told=1.0):
    one = np.ones(1)
    units = Units.of(reach * one, acceleration * one, jerk * one)
    pan = (jerk, speed, height, static, kinetic, told)
    return Situation.of(units, *(part * one for part in pan))


@pytest.mark.parametrize("pan", [(0.2, 30.0, 10_000.0), (0.1, 30.0, 10_000.0), (0.2, 9.0, 4_500.0), (0.4, 2.0, 500.0)])
def test_every_pan_has_the_same_reach_and_acceleration(pan):
    reach, acceleration, jerk = pan
    units = Units.of(*(np.array([part]) for part in pan))
    assert reach / units.length == pytest.approx(REACH)
    assert acceleration / units.acceleration == pytest.approx(ACCELERATION)
    assert units.velocity == pytest.approx(units.length / units.time)
    assert jerk / units.jerk > LEAST_JERK


def test_acceleration_that_the_jerk_cannot_bring_about_does_not_count():
    units = Units.of(np.array([0.2]), np.array([40.0]), np.array([500.0]))
    assert 500.0 / units.jerk == pytest.approx(LEAST_JERK)
    assert ACCELERATION * units.acceleration < 40.0


def test_law_is_the_same_in_these_units():
    """Friction is a pure number; gravity is an acceleration like any other."""
    units = Units.of(np.array([0.1]), np.array([9.0]), np.array([4_500.0]))
    rng = np.random.default_rng(0)
    u = np.column_stack([rng.normal(0, 6, (300, 2)), rng.uniform(-7, 6, 300)])
    state = np.array([0.01, -0.02, 0.1, 0.05])
    states = slide_one(state, u, Friction(0.5, 0.3))
    # In the network's units gravity is another; the law in numpy has only one, so it is put into the friction, and u
    # into the plane: mu (g + w) is what counts.
    scale = float(units.acceleration[0])
    inner = np.empty((300, 4))
    s = state / np.array([units.length, units.length, units.velocity, units.velocity]).ravel()
    for k in range(300):
        share = (GRAVITY + u[k, 2]) / scale / GRAVITY
        s = slide_one(s, u[k : k + 1, :2] / scale, Friction(0.5 * share, 0.3 * share), DT / float(units.time[0]))[0]
        inner[k] = s
    factors = np.array([units.length, units.length, units.velocity, units.velocity]).ravel()
    np.testing.assert_allclose(inner * factors, states, atol=1e-12)


def test_pan_twice_as_slow_and_four_times_as_long_is_told_the_same():
    small = situation(0.05, 13.0, 6_000.0, speed=0.5, height=0.02)
    large = situation(0.2, 13.0, 3_000.0, speed=1.0, height=0.08)
    np.testing.assert_allclose(small.conditions(), large.conditions(), atol=1e-12)


@pytest.mark.parametrize("told", [0.0, 1.0])
def test_conditions_are_of_the_order_of_one_wherever_the_network_is_used(told):
    rng = np.random.default_rng(1)
    low = np.array([0.02, 2.0, 500.0, 0.5, 0.0, 0.0, 0.0])
    high = np.array([0.4, 40.0, 20_000.0, 3.0, 0.2, 1.5, 1.5])
    for row in rng.uniform(low, high, (200, 7)):
        reach, acceleration, jerk, speed, height, static, kinetic = row
        conditions = situation(reach, acceleration, jerk, speed, height, static, kinetic, told).conditions()
        assert conditions.shape == (1, CONDITIONS)
        assert np.abs(conditions).max() < 20.0
        assert np.isfinite(conditions).all()


def test_friction_that_is_not_told_is_not_in_the_conditions():
    one, other = (situation(0.2, 30.0, 10_000.0, static=mu, told=0.0).conditions() for mu in (0.3, 1.0))
    np.testing.assert_array_equal(one, other)
    assert (situation(0.2, 30.0, 10_000.0, static=0.3).conditions() != one).any()


def test_limits_that_are_as_good_as_none_are_told_as_the_largest():
    found = situation(0.02, 2.0, 1e9, height=1.0)
    assert (found.jerk[0], found.speed[0], found.height[0]) == (LARGEST_JERK, LARGEST_SPEED, LARGEST_HEIGHT)


def test_a_fifth_of_the_weight_is_kept_and_a_level_pan_does_not_lift():
    level, lifting = situation(0.2, 9.0, 4_500.0), situation(0.2, 9.0, 4_500.0, height=0.1)
    assert lifting.floor == pytest.approx(0.8 * lifting.gravity)
    assert (level.lift[0], lifting.lift[0]) == (0.0, 1.0)

"""The pan by its encoders: one false reading moves nothing, and the delay of its arm is found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import Friction
from runtime.observe.delay import DelaySearch
from runtime.observe.pan import agree
from runtime.observe.past import Past

from .conftest import World

numbers = st.floats(-1e3, 1e3)
states = st.lists(numbers, min_size=4, max_size=4).map(np.array)


@given(states, st.floats(0.0, 0.1))
def test_one_false_reading_moves_nothing(false: np.ndarray, time: float) -> None:
    right = np.zeros(4)
    first = agree(right, false, time)
    assert not first.believed.any()
    np.testing.assert_array_equal(first.rest, false)
    second = agree(first.rest, right, time)
    assert not second.believed.any()


@given(states, st.floats(0.0, 0.1))
def test_what_lasts_is_believed_at_the_second_reading(moved: np.ndarray, time: float) -> None:
    later = moved.copy()
    later[:2] += moved[2:] * time
    offset = agree(agree(np.zeros(4), moved, time).rest, later, time)
    np.testing.assert_array_equal(offset.believed, later)
    assert not offset.rest.any()


@pytest.mark.parametrize("late", [0, 5, 12, 20, 60])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_delay_of_the_arm_is_found(late: int, noise: float) -> None:
    world, rng = World.shaken(Friction()), np.random.default_rng(0)
    search, past = DelaySearch.begin(2), Past.still(np.zeros(2), np.zeros(2))
    assert search.delay is None
    for at in range(1, 1200):
        past = past.then(world.u[at - 1 : at])
        moved = world.pan[max(at - late, 0), 2:] + [0.05, 0.0] + rng.normal(0.0, noise, 2)
        search = search.see(at, moved, past)
    assert search.delay == pytest.approx(late * 1e-3, abs=0.5e-3 if noise == 0.0 else 1e-3)


def test_pan_that_rests_tells_no_delay() -> None:
    search, past = DelaySearch.begin(2), Past.still(np.zeros(2), np.zeros(2))
    rng = np.random.default_rng(0)
    for at in range(1, 1000):
        past = past.then(np.zeros((1, 2)))
        search = search.see(at, rng.normal(0.0, 0.01, 2), past)
    assert search.delay is None


def test_past_keeps_as_much_as_a_late_reading_needs() -> None:
    past = Past.still(np.array([1.0, 0.0]), np.array([2.0, 0.0]))
    u = np.random.default_rng(0).normal(size=(1500, 2))
    for first in range(0, 1500, 100):
        past = past.then(u[first : first + 100])
    assert past.end == 1500
    assert past.begin == 900
    np.testing.assert_array_equal(past.between(1000, 1100), u[1000:1100])
    np.testing.assert_allclose(past.velocity[-1], [2.0, 0.0] + u.sum(axis=0) * 1e-3)
    np.testing.assert_array_equal(past.until(1400).between(1300, 1400), u[1300:1400])

"""A stream whose arm cannot do all that the pan may: its chunks hold what the check says, and the pan's own limits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, Limits, Planner, Stream, StreamStatus
from runtime.following.tighten import Check
from runtime.physics.law import DT, slide_one
from runtime.physics.motion import lengths
from runtime.physics.pan import integrate_pan
from runtime.safety.stop import PanState

Array = NDArray[np.float64]
Curve = Callable[..., Array]

FRICTION = Friction(0.6, 0.5)
LIMITS = Limits(0.1, speed=2.0, acceleration=15.0, jerk=2000.0)
WEAKER = {"speed": 0.35, "acceleration": 0.6, "jerk": 0.5}
"""Shares of the pan's limits that an arm can do."""


@pytest.fixture(scope="module")
def shipped() -> Planner:
    return Planner()


def weaker(quantity: str, told: list[float] | None = None) -> Check:
    """An arm that can do only its share of one of the pan's limits."""

    def check(state: PanState, u: Array) -> dict[str, float]:
        velocity = np.array(state[3:6]) + DT * np.cumsum(u, axis=0)
        rows = {"speed": velocity, "acceleration": u, "jerk": np.diff(u, axis=0, prepend=[state[6:]]) / DT}
        share = float(lengths(rows[quantity]).max()) / (WEAKER[quantity] * getattr(LIMITS, quantity))
        if told is not None:
            told.append(share)
        return {quantity: share}

    return check


def accelerations(stream: Stream, position: Array, chunks: int) -> Array:
    """What a stream commands while pan and object obey."""
    pan, sliding, given = np.zeros(6), np.array([*position[0], 0.0, 0.0]), []
    for _ in range(chunks):
        given.append(stream.step(pan, sliding))
        pan = integrate_pan(pan, given[-1])[-1]
        sliding = slide_one(sliding, given[-1], FRICTION)[-1]
    return np.concatenate(given)


@pytest.mark.parametrize("quantity", sorted(WEAKER))
def test_chunks_hold_what_the_arm_can_do_and_end_at_rest(shipped: Planner, make_curve: Curve, quantity: str) -> None:
    position, told = make_curve(900), []
    chunks = 40
    free = accelerations(shipped.stream(position, FRICTION, limits=LIMITS), position, chunks)
    u = accelerations(shipped.stream(position, FRICTION, limits=LIMITS, check=weaker(quantity, told)), position, chunks)
    pan = integrate_pan(np.zeros(6), u)

    def most(u: Array) -> float:
        return weaker(quantity)(PanState(*np.zeros(9)), u)[quantity]

    assert most(free) > 1.0, "the arm is asked for more than it can do"
    assert most(u) <= 1.0 + 1e-9
    assert len(told) > chunks, "some chunks were tried again"
    assert not u[-1].any()
    assert lengths(pan[:, :2]).max() <= LIMITS.pan_reach
    assert lengths(np.diff(u, axis=0, prepend=0.0)).max() <= LIMITS.jerk * DT + 1e-9


def test_an_arm_that_can_do_all_changes_nothing(shipped: Planner, make_curve: Curve) -> None:
    position = make_curve(400)
    checked = shipped.stream(position, FRICTION, limits=LIMITS, check=lambda state, u: {"acceleration": 1.0})
    np.testing.assert_array_equal(
        accelerations(checked, position, 12),
        accelerations(shipped.stream(position, FRICTION, limits=LIMITS), position, 12),
    )


@pytest.mark.parametrize("never", [1e9, math.inf, math.nan])
def test_an_arm_that_can_do_nothing_stops_no_stream(shipped: Planner, make_curve: Curve, never: float) -> None:
    position = make_curve(400)
    stream = shipped.stream(
        position, FRICTION, limits=LIMITS, check=lambda state, u: {"acceleration": never, "jerk": never}
    )
    u = accelerations(stream, position, 20)
    assert np.isfinite(u).all()
    assert lengths(u).max() <= LIMITS.acceleration + 1e-9
    assert stream.status is StreamStatus.RESTING


def test_what_was_tightened_for_a_chunk_is_not_carried_on(shipped: Planner, make_curve: Curve) -> None:
    position, calls = make_curve(900), 0

    def first_only(state: PanState, u: Array) -> dict[str, float]:
        nonlocal calls
        calls += 1
        return {"acceleration": 2.0 if calls < 4 else 0.5}

    u = accelerations(shipped.stream(position, FRICTION, limits=LIMITS, check=first_only), position, 12)
    size = lengths(u)
    assert size[:50].max() < 0.5 * LIMITS.acceleration
    assert size.max() > 0.9 * LIMITS.acceleration

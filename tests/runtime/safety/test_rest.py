"""Every plan ends at rest, by its last row and its stop, within limits and reach; the object on its mark if it can."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, InputError, Limits, Plan, Planner, Start
from runtime.limits import LARGEST_SINK
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import lengths
from runtime.physics.pan import integrate_pan
from runtime.physics.positions import slide_to_rest
from runtime.safety.pan import Pan
from runtime.safety.rest import KEPT, kindest_stop
from runtime.safety.stop import SHORT_RAMP, Extent, PanState, find_brake, stop_extent

Array = NDArray[np.float64]

PLANS = int(os.environ.get("SLIDE_PLANS", "300"))
"""Random plans that are brought to rest; the nightly form sets 10000."""

TOLERANCE = 1e-9


def random_job(rng: np.random.Generator) -> dict[str, Any]:
    """Draw a command, friction, limits and a start, of all kinds; the command may end at any speed."""
    samples = int(rng.integers(2, 420))
    t = np.arange(samples)[:, None, None] * DT
    rate, phase = rng.uniform(1.0, 12.0, (2, 3)), rng.uniform(0.0, 6.28, (2, 3))
    position = (rng.uniform(0.002, 0.05) * np.sin(rate * t + phase)).sum(axis=2)
    static = rng.uniform(0.0, 1.5)
    jerk = 10.0 ** rng.uniform(2.5, 6.0)
    limits = Limits(
        rng.uniform(0.01, 0.4),
        acceleration=min(10.0 ** rng.uniform(0.3, rng.choice([1.8, 5.0])), 9.0 * jerk),
        jerk=jerk,
    )
    start = Start()
    if rng.random() < 0.5:
        direction = rng.normal(0.0, 1.0, (3, 2))
        direction /= np.hypot(*direction.T)[:, None]
        size = rng.uniform(0.0, 0.6, 3) * (limits.pan_reach, 1.0, min(limits.acceleration, 500.0))
        pairs = [(float(x), float(y)) for x, y in direction * size[:, None]]
        start = Start(*pairs, object_velocity=(float(rng.normal(0.0, 0.2)), 0.0))
    return {
        "position": position,
        "friction": Friction(static, static * rng.uniform(0.0, 1.0)),
        "limits": limits,
        "start": start,
    }


def check_at_rest(plan: Plan, limits: Limits) -> None:
    motion, last = plan.with_stop(), len(plan) - 1
    u = motion.acceleration
    assert len(plan.stop_acceleration) >= 1
    assert not u[-1].any()
    np.testing.assert_allclose(motion.pan[-1, 3:], 0.0, atol=TOLERANCE)
    assert lengths(u[last:]).max() <= limits.acceleration * (1.0 + TOLERANCE)
    assert lengths(np.diff(u[last:], axis=0)).max() <= limits.jerk * DT * (1.0 + TOLERANCE) + TOLERANCE
    assert lengths(motion.pan[last:, :2]).max() <= limits.pan_reach + TOLERANCE
    assert lengths(motion.pan[last:, 3:]).max() <= limits.speed + TOLERANCE
    assert np.abs(motion.pan[last:, 2]).max() <= limits.height + TOLERANCE * (not limits.level)
    assert u[:, 2].min() >= -LARGEST_SINK - TOLERANCE


def test_random_plans_end_at_rest_within_limits_and_reach(planner: Planner) -> None:
    rng, planned = np.random.default_rng(PLANS), 0
    while planned < PLANS:
        job = random_job(rng)
        try:
            plan = planner.plan(**job)
        except InputError:  # from this start the pan cannot stop in its reach
            continue
        check_at_rest(plan, job["limits"])
        planned += 1


@pytest.mark.parametrize("options", [{"candidates": 6}, {"refine_iterations": 2}])
def test_turned_and_refined_plans_end_at_rest_too(planner: Planner, options: dict[str, Any]) -> None:
    rng, limits = np.random.default_rng(3), Limits(0.05, acceleration=20.0, jerk=4_000.0)
    for samples in (130, 200, 333):
        position = np.cumsum(rng.normal(0.0, 1e-4, (samples, 2)), axis=0)
        check_at_rest(planner.plan(position, limits=limits, **options), limits)


def test_a_pan_that_lifts_comes_to_rest_within_all_of_its_limits() -> None:
    rng = np.random.default_rng(12)
    stopped = 0
    while stopped < PLANS:
        static = rng.uniform(0.05, 1.5)
        friction = Friction(static, static * rng.uniform(0.2, 1.0))
        limits = Limits(
            rng.uniform(0.02, 0.4),
            height=rng.uniform(0.005, 0.2),
            speed=rng.uniform(0.3, 3.0),
            acceleration=10.0 ** rng.uniform(0.5, 1.6),
            jerk=10.0 ** rng.uniform(2.7, 4.3),
        )
        direction = rng.normal(0.0, 1.0, (3, 3))
        direction /= lengths(direction)[:, None]
        size = rng.uniform(0.0, 0.8, 3) * (limits.height, limits.speed, limits.acceleration)
        state = PanState(*(direction * size[:, None]).ravel().tolist())
        pan = Pan.at(state, limits)
        if not pan.can_stop or state.uz < -LARGEST_SINK:
            continue
        sliding = np.array([0.02, 0.0, *rng.normal(0.0, 0.2, 2)])
        brake = kindest_stop(state, sliding, np.zeros(2), limits, friction)
        assert brake is not None  # the strongest is within the limits
        u = brake.accelerations(brake.samples)
        pan_states = integrate_pan(np.array(state[:6]), u)
        assert np.abs(pan_states[-1, 3:]).max() <= TOLERANCE
        assert not u[-1].any()
        assert lengths(u).max() <= limits.acceleration + TOLERANCE
        assert lengths(np.diff(np.concatenate([[state[6:]], u]), axis=0)).max() <= limits.jerk * DT + TOLERANCE
        assert u[:, 2].min() >= -LARGEST_SINK - TOLERANCE
        assert Extent(
            lengths(pan_states[:, :2]).max() - TOLERANCE,
            np.abs(pan_states[:, 2]).max() - TOLERANCE,
            lengths(pan_states[:, 3:]).max() - TOLERANCE,
        ).within(limits)
        # And it throws the object no farther than the strongest does, if at all.
        strongest = pan.brake.accelerations(pan.brake.samples)
        left, most = (np.hypot(*slide_to_rest(sliding, each, friction)) for each in (u, strongest))
        assert left <= max(most, 0.02) + KEPT
        stopped += 1


def test_batches_end_as_lone_plans_do(planner: Planner) -> None:
    rng = np.random.default_rng(5)
    positions = [np.cumsum(rng.normal(0.0, 1e-4, (samples, 2)), axis=0) for samples in (150, 180, 199, 200)]
    for plan in planner.plan_batch(positions):
        check_at_rest(plan, planner.bundle.manifest.limits)


def test_plan_without_limits_ends_at_rest() -> None:
    rng = np.random.default_rng(6)
    for spread in (1.0, 20.0):
        motion = Plan.of_accelerations(rng.normal(0.0, spread, (200, 2)), Friction(0.5, 0.4), "drawn").with_stop()
        np.testing.assert_allclose(motion.pan[-1, 3:], 0.0, atol=TOLERANCE)
        assert not motion.acceleration[-1].any()


def test_object_stays_on_its_mark_where_the_pan_can_stop_gently() -> None:
    t = np.linspace(0.0, 1.0, 1000)[:, None]
    move = 0.08 * np.concatenate([t**3 * (10.0 - 15.0 * t + 6.0 * t * t), 0.0 * t], axis=1)
    position = np.concatenate([move, np.repeat(move[-1:], 100, axis=0)])
    plan = Planner().plan(position)
    check_at_rest(plan, Limits())
    assert plan.quality.rest_error is not None
    assert plan.quality.rest_error < plan.quality.tracking_max + KEPT
    end = plan.with_stop().sliding[-1, :2]
    assert np.hypot(*(end - position[-1])) == pytest.approx(plan.quality.rest_error, abs=1e-5)


def brake_at(speed: float, sliding: tuple[float, float], reach: float, friction: Friction) -> tuple[Array, float]:
    """Return the kindest stop of a pan at a speed along x, and how far from its mark it leaves the object (m)."""
    state, limits = PanState(0.0, 0.0, 0.0, speed, *[0.0] * 5), Limits(reach)
    moving = np.array([0.0, 0.0, *sliding])
    brake = kindest_stop(state, moving, np.zeros(2), limits, friction)
    assert brake is not None
    assert stop_extent(state, brake).reach <= reach
    u = brake.accelerations(brake.samples)
    return u, float(np.hypot(*slide_to_rest(moving, u, friction)))


def test_stop_is_no_stronger_than_friction_holds_where_there_is_room() -> None:
    friction = Friction(0.8, 0.4)
    u, left = brake_at(1.0, (0.0, 0.0), 0.3, friction)  # at rest: static friction holds it
    assert left == 0.0
    assert lengths(u).max() < 0.8 * GRAVITY
    u, left = brake_at(
        0.6, (0.2, 0.0), 0.3, friction
    )  # sliding ahead: kinetic friction brakes it, a strong stop throws it
    assert lengths(u).max() < 0.4 * GRAVITY
    strong = find_brake(PanState(0.0, 0.0, 0.0, 0.6, *[0.0] * 5), Limits(0.3))
    thrown = slide_to_rest(np.array([0.0, 0.0, 0.2, 0.0]), strong.accelerations(strong.samples), friction)
    assert left < 0.5 * np.hypot(*thrown)


def test_stop_is_as_strong_as_the_reach_asks_for() -> None:
    u, left = brake_at(1.0, (0.0, 0.0), 0.04, Friction(0.8, 0.4))
    assert lengths(u).max() > 0.8 * GRAVITY
    assert left > 0.01
    state = PanState(0.0, 0.0, 0.0, 1.0, *[0.0] * 5)
    assert kindest_stop(state, np.zeros(4), np.zeros(2), Limits(0.01), Friction()) is None


@pytest.mark.parametrize("friction", [Friction(1.0, 0.5), Friction(0.2, 0.2), Friction(0.05, 0.02)])
def test_slide_to_rest_is_the_law_with_the_pan_at_rest_after(friction: Friction) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        state, u = np.array([*rng.normal(0.0, 0.1, 2), *rng.normal(0.0, 0.3, 2)]), rng.normal(0.0, 6.0, (80, 2))
        long = np.concatenate([u, np.zeros((8000, 2))])
        assert slide_to_rest(state, u, friction) == pytest.approx(slide_one(state, long, friction)[-1, :2], abs=2e-6)
    assert slide_to_rest(np.array([0.0, 0.0, 1.0, 0.0]), np.zeros((10, 2)), Friction(0.0, 0.0)) == (0.01, 0.0)


def test_looser_limits_stop_no_later_than_a_short_ramp() -> None:
    rng = np.random.default_rng(8)
    for _ in range(200):
        push, jerk = rng.uniform(0.0, 10.0), 10.0 ** rng.uniform(3.0, 5.0)
        speed = rng.uniform(0.01, 3.0)
        state = PanState(0.0, 0.0, 0.0, speed, 0.0, 0.0, push * rng.uniform(-1.0, 1.0), 0.0, 0.0)
        tight, *loose = (
            find_brake(state, Limits(1.0, acceleration=limit, jerk=jerk)) for limit in (30.0, 100.0, 1e3, 9e3)
        )
        u = [brake.accelerations(brake.samples) for brake in (tight, *loose)]
        for each in u:
            assert np.abs(integrate_pan(np.array(state[:6]), each)[-1, 3:]).max() <= TOLERANCE
            assert lengths(np.diff(np.concatenate([[state[6:]], each]), axis=0)).max() <= jerk * DT + TOLERANCE
        for brake in loose:
            assert brake.samples <= tight.samples + 2.0 * SHORT_RAMP / DT
            assert stop_extent(state, brake).reach <= stop_extent(state, tight).reach + state.vx * SHORT_RAMP


def test_looser_limits_make_no_plan_worse() -> None:
    shipped = Planner("default")  # the same network under all of these
    t = np.linspace(0.0, 2.0 * np.pi, 1200)
    position = 0.05 * np.stack([np.sin(t) ** 3, 1.0 - np.cos(t)], axis=1)
    usual = shipped.plan(position).quality.tracking_rmse
    for limits in (
        Limits(acceleration=1e4),
        Limits(acceleration=1e9, jerk=1e9),
        Limits(0.25),
        Limits(0.2, acceleration=60.0, jerk=2e4),
    ):
        assert shipped.plan(position, limits=limits).quality.tracking_rmse <= 1.05 * usual


def test_looser_limits_keep_the_object_on_its_mark_in_the_stop() -> None:
    shipped = Planner()
    t = np.linspace(0.0, 2.0 * np.pi, 1200)
    position = 0.025 * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)
    for limits in (
        Limits(),
        Limits(acceleration=1e4),
        Limits(0.2, acceleration=30.0, jerk=1e9),
        Limits(0.2, acceleration=1e4, jerk=1e9),
    ):
        rest_error = shipped.plan(position, limits=limits).quality.rest_error
        assert rest_error is not None
        assert rest_error < 0.003

"""Refinement: never worse, within limits, the same each time for a number of steps, and in time."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Command, Friction, InputError, Limits, Plan, Planner, Start
from runtime.physics.law import DT, GRAVITY, slide_step
from runtime.physics.linearized import linearize
from runtime.physics.motion import tracking_error
from runtime.refine.gauss_newton import BLOCK, REACH_WEIGHT, row_size, state_size
from runtime.refine.refine import PLAIN, Effort, Kernels, expected, refine, weights
from runtime.safety.pan import Pan

Array = NDArray[np.float64]
Curve = Callable[..., Array]

LIMITS = Limits()
SAMPLES = 600


@pytest.fixture(scope="module")
def plain(planner: Planner, make_curve: Curve) -> Plan:
    return planner.plan(make_curve(SAMPLES), limits=LIMITS, candidates=1)


def test_refined_plan_is_better_keeps_its_limits_and_obeys_the_law(
    planner: Planner, make_curve: Curve, plain: Plan
) -> None:
    plan = planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=60, robust=0.0)
    assert plan.quality.tracking_rmse < 0.97 * plain.quality.tracking_rmse
    assert min(value for value in plan.quality.margins.values() if value is not None) > -1e-9
    np.testing.assert_array_equal(plan.replay()[:, :2], plan.object_position)


@pytest.mark.parametrize("robust", [0.0, 0.1])
def test_a_pan_that_lifts_is_refined_in_its_plane_within_all_of_its_limits(
    planner: Planner, make_curve: Curve, robust: float
) -> None:
    friction, gained = Friction(0.4, 0.3), 0
    for seed, limits in enumerate((Limits.named("panda"), Limits.named("fr3"), Limits(height=0.05, speed=0.6))):
        position = make_curve(SAMPLES, seed)
        before = planner.plan(position, friction, limits=limits, candidates=1)
        plan = planner.plan(position, friction, limits=limits, candidates=1, refine_iterations=25, robust=robust)
        assert before.quality.height_max > 1e-4
        if not robust:
            assert plan.quality.tracking_rmse <= before.quality.tracking_rmse
        gained += plan.quality.tracking_rmse < 0.97 * before.quality.tracking_rmse
        assert min(value for value in plan.quality.margins.values() if value is not None) > -1e-9
        u = np.concatenate([plan.pan_acceleration, plan.stop_acceleration])
        assert u[:, 2].min() >= -0.8 * GRAVITY - 1e-9
        np.testing.assert_array_equal(plan.replay()[:, :2], plan.object_position)
        if plan.quality.governed is not None and not plan.quality.governed.samples:
            np.testing.assert_allclose(plan.pan_acceleration[:, 2], before.pan_acceleration[:, 2], atol=1e-9)
    assert gained


def test_a_number_of_steps_gives_the_same_plan_each_time(planner: Planner, make_curve: Curve) -> None:
    one, other = (planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=20) for _ in range(2))
    np.testing.assert_array_equal(one.pan_acceleration, other.pan_acceleration)


def test_more_steps_are_never_worse_than_none(planner: Planner, make_curve: Curve) -> None:
    for seed in range(4):
        for friction in (Friction(1.0, 0.5), Friction(0.5, 0.3)):
            start = Start((0.01, 0.0), (0.05, 0.0), object_velocity=(0.1, 0.0))
            arguments = {"friction": friction, "limits": LIMITS, "start": start}
            before = planner.plan(make_curve(377, seed), **arguments, candidates=1)
            after = planner.plan(make_curve(377, seed), **arguments, refine_iterations=5, robust=0.0)
            assert after.quality.tracking_rmse <= before.quality.tracking_rmse
            np.testing.assert_array_equal(after.pan_position[0], start.pan_position)


def test_time_is_kept(planner: Planner, make_curve: Curve) -> None:
    planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=1)  # loads and compiles
    began = time.perf_counter()
    planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_ms=50.0)
    assert 0.05 <= time.perf_counter() - began < 1.0  # the machine may be busy


def test_plain_and_compiled_loops_agree(plain: Plan) -> None:
    pytest.importorskip("numba")

    def refined(loops: Kernels | None = None) -> Array:
        pan = Pan.at_start(Start(), LIMITS)
        sliding = np.array([*plain.object_position[0], 0.0, 0.0])
        found = refine(
            plain.pan_acceleration, pan, sliding, plain.command_position, plain.friction, 100, Effort(0.0, 3), loops
        )
        assert found is not None
        return found[0].acceleration

    compiled = refined()
    np.testing.assert_allclose(refined(PLAIN), compiled, atol=1e-6)


@pytest.mark.parametrize("press", [1.0, 0.4])
@pytest.mark.parametrize("robust", [0.0, 0.1])
def test_damped_step_is_along_the_gradient_of_the_cost(robust: float, press: float) -> None:
    """With all the damping in the world a block's change is minus the gradient over the damping."""
    rng = np.random.default_rng(3)
    samples, damping = 8 * BLOCK, 1e9
    move, sweep, column = PLAIN
    frictions = expected(Friction(), robust)
    objects = len(frictions)
    state, row = state_size(objects), row_size(state_size(objects))
    u = 6.0 + rng.standard_normal((samples, 2))
    command = np.cumsum(rng.standard_normal((samples, 2)), axis=0) * 1e-3
    sliding = [0.0, 0.0, -0.5, -0.3]  # sliding throughout, and the pan beyond the soft reach
    start = np.array([0.1, 0.05, 0.2, 0.1, *(sliding * objects)])
    friction = column(9.8 * np.array([(each.static, each.kinetic) for each in frictions]))
    law, room = (0.1, 1e9, 0.0045), column(np.tile([press, 1e9, 1e9], (samples, 1)))
    gains, states = column(np.zeros((samples // BLOCK, row))), column(np.zeros((samples, state)))
    each = column(weights(objects))

    def cost(u: Array) -> tuple[float, list[float]]:
        end = column(start)
        squared, penalized, _ = move(
            column(u), column(command), end, friction, each, law, room, (0.0, 0.0), no_gains,
            column(np.zeros((samples, state))), 0.0, states, column(u),
        )  # fmt: skip
        assert penalized > squared
        return penalized, end

    no_gains = column(np.zeros((samples // BLOCK, row)))
    _, end = cost(u)
    model = column(np.zeros((state + 2, state + 2))), column(np.zeros(state + 2))
    sweep(
        column(u), column(command), end, friction, each, law, room, list(states), damping, gains, *model
    )  # fmt: skip
    for block in (0, 3, 7):
        for axis in (0, 1):
            step = np.zeros_like(u)
            step[block * BLOCK : (block + 1) * BLOCK, axis] = 1e-4
            measured = (cost(u + step)[0] - cost(u - step)[0]) / 2e-4
            assert -2.0 * damping * gains[row * block + axis] == pytest.approx(measured, rel=2e-3, abs=1e-12)
    assert REACH_WEIGHT > 0.0


def _slid(velocity: float, u: float, samples: int) -> float:
    """Return the velocity (m/s) after sliding along a line under a constant acceleration (m/s^2)."""
    vx = velocity
    for _ in range(samples):
        _, _, vx, _ = slide_step(0.0, 0.0, vx, 0.0, u, 0.0, 9.8, 4.9, DT)
    return vx


def test_an_object_that_turns_round_answers_later_to_a_faster_arrival() -> None:
    """By the law the velocity after turning is that of a later start; whole samples hide it from its derivative."""
    u, low, high = 14.0, 0.1, 0.3
    measured = (_slid(high, u, 60) - _slid(low, u, 60)) / (high - low)
    turned = linearize(1e-3, 0.0, u, 0.0, u, 0.0, 9.8, 4.9, DT)
    assert turned[0] == pytest.approx(measured, abs=0.05)
    assert linearize(1e-3, 0.0, 9.0, 0.0, 9.0, 0.0, 9.8, 4.9, DT) == (0.0,) * 6  # comes to rest and stays


def test_an_object_breaks_away_earlier_under_a_stronger_push() -> None:
    def after(offset: float) -> float:
        vx = 0.0
        for k in range(60):
            _, _, vx, _ = slide_step(0.0, 0.0, vx, 0.0, 0.5 * k + offset, 0.0, 9.8, 4.9, DT)
        return vx

    measured = (after(2.0) - after(-2.0)) / 4.0
    whole = linearize(0.0, 0.0, 10.0, 0.0, 9.5, 0.0, 9.8, 4.9, DT)[3] - 39 * DT  # one sample breaking away, 39 sliding
    assert whole == pytest.approx(measured, rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"refine_ms": 5.0, "refine_iterations": 5}, "refine_ms or refine_iterations, not both"),
        ({"refine_ms": -5.0}, "refine_ms must be between 0 and 600000, got -5"),
        ({"refine_ms": 1e9}, "refine_ms must be between 0 and 600000, got 1e\\+09"),
        ({"refine_iterations": 1e9}, "refine_iterations must be between 0 and 100000, got 1e\\+09"),
        ({"refine_ms": float("nan")}, "refine_ms: nan is not a finite number"),
        ({"refine_iterations": 5.5}, "refine_iterations must be a whole number, got 5.5"),
    ],
)
def test_unusable_effort_is_an_input_error(planner: Planner, arguments: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner.plan(np.zeros((200, 2)), **arguments)  # type: ignore[arg-type]


def errors_around(plan: Plan) -> list[float]:
    """Return the tracking RMSE (m) under the plan's friction, and with each coefficient 10 % lower and higher."""
    frictions = [plan.friction, *plan.friction.corners(0.1)]
    return [tracking_error(plan.replay(each)[:, :2], plan.command_position)[0] for each in frictions]


def test_refinement_makes_plans_better_where_the_friction_is_not_quite_what_was_said(make_curve: Curve) -> None:
    planner = Planner()
    before, robust, nominal = np.array(
        [
            [
                errors_around(planner.plan(make_curve(SAMPLES, seed), limits=LIMITS, **how))
                for how in ({}, {"refine_iterations": 40}, {"refine_iterations": 40, "robust": 0.0})
            ]
            for seed in range(3)
        ]
    ).mean(axis=0)
    assert robust.mean() < 0.9 * before.mean()
    assert nominal[0] < robust[0]
    assert robust[1:].mean() < nominal[1:].mean()


def test_refinement_leaves_the_object_where_the_command_ends_if_the_plan_did() -> None:
    planner = Planner()
    t = np.linspace(0.0, 1.0, 5)
    command = Command.from_waypoints(t, np.array([[0, 0], [0.04, 0.02], [0.02, 0.05], [-0.02, 0.03], [0.03, 0.0]]))
    at_rest = np.concatenate([command.position, np.tile(command.position[-1], (250, 1))])
    before = planner.plan(at_rest, candidates=1)
    assert before.quality.rest_error < 0.005
    for robust in (0.0, 0.1):
        after = planner.plan(at_rest, refine_iterations=60, robust=robust)
        assert after.quality.rest_error < 0.01
        assert after.quality.tracking_rmse < 1.1 * before.quality.tracking_rmse


def test_the_best_candidate_is_no_worse_than_the_plan_and_obeys_the_law(planner: Planner, make_curve: Curve) -> None:
    start = Start((0.02, -0.03), (0.1, 0.2), (1.0, 0.5), (0.001, 0.0), (0.05, 0.02))
    for seed in range(3):
        for arguments in ({"limits": LIMITS}, {"limits": LIMITS, "start": start}):
            one = planner.plan(make_curve(377, seed), **arguments, candidates=1)
            best = planner.plan(make_curve(377, seed), **arguments, candidates=6)
            assert best.quality.tracking_rmse <= one.quality.tracking_rmse
            np.testing.assert_array_equal(best.replay()[:, :2], best.object_position)
            np.testing.assert_array_equal(best.pan_position[0], one.pan_position[0])
            assert min(value for value in best.quality.margins.values() if value is not None) > -1e-9


def test_robust_candidates_are_judged_by_the_mean_over_frictions(planner: Planner, make_curve: Curve) -> None:
    arguments = {"limits": LIMITS, "candidates": 12}
    for seed in range(3):
        nominal, robust = (planner.plan(make_curve(377, seed), **arguments, robust=share) for share in (0.0, 0.1))
        assert nominal.quality.tracking_rmse <= robust.quality.tracking_rmse
        of_nominal, of_robust = (weights(5) @ np.square(errors_around(plan)) for plan in (nominal, robust))
        assert of_robust <= of_nominal * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"candidates": 0}, "candidates must be a whole number from 1 to 256, got 0"),
        ({"candidates": 2.5}, "candidates must be a whole number from 1 to 256, got 2.5"),
        ({"candidates": 1000}, "from 1 to 256, got 1000"),
        ({"candidates": float("nan")}, "candidates: nan is not a finite number"),
        ({"robust": 1.0}, "robust must be a share of the friction from 0 to less than 1, got 1"),
        ({"robust": -0.1}, "robust must be a share of the friction from 0 to less than 1, got -0.1"),
        ({"robust": float("inf")}, "robust: inf is not a finite number"),
    ],
)
def test_unusable_candidates_are_an_input_error(planner: Planner, arguments: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner.plan(np.zeros((200, 2)), **arguments)  # type: ignore[arg-type]

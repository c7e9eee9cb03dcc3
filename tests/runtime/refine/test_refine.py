"""Refinement: never worse, within limits, the same each time for a number of steps, and in time."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, InputError, Limits, Plan, Planner, Start
from runtime.limits import NO_LIMITS
from runtime.physics.law import DT, slide_step
from runtime.physics.linearized import linearize
from runtime.refine import refine as refine_module
from runtime.refine.gauss_newton import BLOCK, REACH_WEIGHT, ROW, SIZE
from runtime.refine.refine import PLAIN, Effort, refine
from runtime.safety.pan import Pan

Array = NDArray[np.float64]
Curve = Callable[..., Array]

LIMITS = Limits()
SAMPLES = 600


@pytest.fixture(scope="module")
def plain(planner: Planner, make_curve: Curve) -> Plan:
    return planner.plan(make_curve(SAMPLES), limits=LIMITS)


def test_refined_plan_is_better_keeps_its_limits_and_obeys_the_law(
    planner: Planner, make_curve: Curve, plain: Plan
) -> None:
    plan = planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=60)
    assert plan.quality.tracking_rmse < 0.97 * plain.quality.tracking_rmse
    assert min(value for value in plan.quality.margins.values() if value is not None) > -1e-9
    np.testing.assert_array_equal(plan.replay()[:, :2], plan.object_position)


def test_a_number_of_steps_gives_the_same_plan_each_time(planner: Planner, make_curve: Curve) -> None:
    one, other = (planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=20) for _ in range(2))
    np.testing.assert_array_equal(one.pan_acceleration, other.pan_acceleration)


def test_more_steps_are_never_worse_than_none(planner: Planner, make_curve: Curve) -> None:
    for seed in range(4):
        for friction in (Friction(1.0, 0.5), Friction(0.5, 0.3)):
            start = Start((0.01, 0.0), (0.05, 0.0), object_velocity=(0.1, 0.0))
            arguments = {"friction": friction, "limits": LIMITS, "start": start}
            before = planner.plan(make_curve(377, seed), **arguments)
            after = planner.plan(make_curve(377, seed), **arguments, refine_iterations=5)
            assert after.quality.tracking_rmse <= before.quality.tracking_rmse
            np.testing.assert_array_equal(after.pan_position[0], start.pan_position)


def test_time_is_kept(planner: Planner, make_curve: Curve) -> None:
    planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_iterations=1)  # loads and compiles
    began = time.perf_counter()
    planner.plan(make_curve(SAMPLES), limits=LIMITS, refine_ms=50.0)
    assert 0.05 <= time.perf_counter() - began < 1.0  # the machine may be busy


def test_plain_and_compiled_loops_agree(plain: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")

    def refined() -> Array:
        pan = Pan.at_start(Start(), LIMITS)
        sliding = np.array([*plain.object_position[0], 0.0, 0.0])
        found = refine(
            plain.pan_acceleration, pan, sliding, plain.command_position, plain.friction, 100, Effort(0.0, 3)
        )
        assert found is not None
        return found.acceleration

    compiled = refined()
    monkeypatch.setattr(refine_module, "kernels", lambda: PLAIN)
    np.testing.assert_allclose(refined(), compiled, atol=1e-6)


def test_damped_step_is_along_the_gradient_of_the_cost() -> None:
    """With all the damping in the world a block's change is minus the gradient over the damping."""
    rng = np.random.default_rng(3)
    samples, damping = 8 * BLOCK, 1e9
    move, sweep, column = PLAIN
    u = 6.0 + rng.standard_normal((samples, 2))
    command = np.cumsum(rng.standard_normal((samples, 2)), axis=0) * 1e-3
    start = np.array([0.1, 0.05, 0.2, 0.1, 0.0, 0.0, -0.5, -0.3])  # sliding throughout, and beyond the soft reach
    law, within = (9.8, 4.9, 0.1, 0.0045), (1e9, 1e9, 0.0, 0.0)
    gains, states = column(np.zeros((samples // BLOCK, ROW))), column(np.zeros((samples, 8)))

    def cost(u: Array) -> tuple[float, list[float]]:
        end = column(start)
        squared, penalized, _ = move(
            column(u), column(command), end, law, within, no_gains, column(np.zeros((samples, 8))), 0.0, states,
            column(u),
        )  # fmt: skip
        assert penalized > squared
        return penalized, end

    no_gains = column(np.zeros((samples // BLOCK, ROW)))
    _, end = cost(u)
    model = column(np.zeros((SIZE, SIZE))), column(np.zeros(SIZE))
    sweep(column(u), column(command), end, law, within[0], list(states), damping, gains, *model)
    for block in (0, 3, 7):
        for axis in (0, 1):
            step = np.zeros_like(u)
            step[block * BLOCK : (block + 1) * BLOCK, axis] = 1e-4
            measured = (cost(u + step)[0] - cost(u - step)[0]) / 2e-4
            assert -2.0 * damping * gains[ROW * block + axis] == pytest.approx(measured, rel=2e-3, abs=1e-12)
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
        ({"refine_ms": -5.0}, "refine_ms must not be negative, got -5"),
        ({"refine_ms": float("nan")}, "refine_ms: nan is not a finite number"),
        ({"refine_iterations": 5.5}, "refine_iterations must be a whole number, got 5.5"),
        ({"refine_iterations": 5, "limits": NO_LIMITS}, "refined within limits"),
    ],
)
def test_unusable_effort_is_an_input_error(planner: Planner, arguments: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner.plan(np.zeros((200, 2)), **arguments)  # type: ignore[arg-type]

"""Refinement: never worse, within limits, the same each time for a number of steps, and in time."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, InputError, Limits, Plan, Planner, Start
from runtime import refine as refine_module
from runtime.decoding import begin
from runtime.limits import NO_LIMITS
from runtime.refine import REACH_WEIGHT, SOFT_REACH, Effort, Kernels, _make, kernels, refine

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
        motion = begin(Start(), LIMITS)
        sliding = np.array([*plain.object_position[0], 0.0, 0.0])
        found = refine(
            plain.pan_acceleration, motion, sliding, plain.command_position, plain.friction, 100, Effort(0.0, 3)
        )
        assert found is not None
        return found.acceleration

    compiled = refined()
    lists = Kernels(*_make(lambda function: function), lambda values: values.tolist())
    monkeypatch.setattr(refine_module, "kernels", lambda: lists)
    np.testing.assert_allclose(refined(), compiled, atol=1e-9)


def test_gradient_is_that_of_finite_differences() -> None:
    """With a momentum of its own the first step is along the gradient: it must be that of the cost."""
    rng = np.random.default_rng(3)
    samples = 40
    track, descend, column = kernels()
    u = 6.0 + rng.standard_normal((samples, 2))
    command = np.cumsum(rng.standard_normal((samples, 2)), axis=0) * 1e-3
    point = (0.1, 0.05, 0.2, 0.1, 0.0, 0.0, -0.5, -0.3)  # sliding throughout, and beyond the soft reach
    law = (9.8, 4.9, SOFT_REACH * 0.1)
    states = [column(np.zeros(samples)) for _ in range(6)]
    moments = [column(np.zeros(samples)) for _ in range(4)]

    def cost(u: Array) -> float:
        return float(track(column(u[:, 0]), column(u[:, 1]), *columns, point, *law, *states)[1])

    columns = [column(command[:, axis]) for axis in (0, 1)]
    assert cost(u) > track(column(u[:, 0]), column(u[:, 1]), *columns, point, *law, *states)[0]
    ux, uy = column(u[:, 0]), column(u[:, 1])
    descend(ux, uy, *columns, *law, *states, *moments, 0.0, 1, (0.0, 0.0), 1e9, 1e9)
    gradient = np.array(moments[2:]).T
    for k in (0, 7, 20, 38):
        for axis in (0, 1):
            step = np.zeros_like(u)
            step[k, axis] = 1e-4
            measured = (cost(u + step) - cost(u - step)) / 2e-4
            assert gradient[k, axis] == pytest.approx(measured, rel=1e-4, abs=1e-12)
    assert REACH_WEIGHT > 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"refine_ms": 5.0, "refine_iterations": 5}, "refine_ms or refine_iterations, not both"),
        ({"refine_ms": -5.0}, "refine_ms must not be negative, got -5"),
        ({"refine_ms": float("nan")}, "refine_ms: nan is not a finite number"),
        ({"refine_iterations": 5, "limits": NO_LIMITS}, "refined within limits"),
    ],
)
def test_unusable_effort_is_an_input_error(planner: Planner, arguments: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner.plan(np.zeros((200, 2)), **arguments)  # type: ignore[arg-type]

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import Command, InputError, Planner, Reading, Status

corners = st.lists(st.tuples(st.floats(-0.06, 0.06), st.floats(-0.06, 0.06)), min_size=2, max_size=8)


def acceleration(command: Command) -> float:
    return float(np.hypot(*np.diff(command.position, 2, axis=0).T).max()) / 1e-6


@settings(deadline=None)
@given(corners, st.floats(0.05, 1.0))
def test_a_path_is_run_from_rest_to_rest_as_fast_as_asked_and_no_faster(points: Any, speed: float) -> None:
    try:
        command = Command.from_path(points, speed)
    except InputError as error:
        assert "the path is " in str(error)  # noqa: PT017 - too short
        return
    assert command.speed <= speed * (1.0 + 1e-6)
    assert acceleration(command) < 8.0
    assert np.abs(command.velocity[[0, -1]]).max() < 0.01
    np.testing.assert_allclose(command.position[[0, -1]], [points[0], points[-1]], atol=1e-9)
    assert command.deviation < 0.0035


def test_corners_are_slowed_down_and_hardly_cut() -> None:
    square = [[0, 0], [0.08, 0], [0.08, 0.08], [0, 0.08], [0, 0]]
    command = Command.from_path(square, 0.5)
    speed = np.hypot(*command.velocity.T)
    assert speed.max() > 0.35
    for corner in square[1:4]:
        nearest = np.hypot(*(command.position - corner).T).argmin()
        assert speed[nearest] < 0.12
        assert np.hypot(*(command.position[nearest] - corner)) < 0.002
    assert acceleration(Command.from_path(square, 0.5, acceleration=1.0)) < 2.5


def test_a_path_can_be_followed() -> None:
    plan = Planner().plan(Command.from_path([[0, 0], [0.06, 0], [0.06, 0.06], [0, 0.06], [0, 0]], 0.3))
    assert plan.quality.status in (Status.OK, Status.GOVERNED)
    assert plan.quality.tracking_rmse < 0.003


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([[0, 0], [0.005, 0]], {"speed": 0.3}, "the path is 0.005 m long, 0.01 to 100 m are allowed"),
        ([[0, 0], [0.3, 0]], {"speed": 0.0}, "speed must be greater than 0 m/s, got 0"),
        ([[0, 0], [0.3, 0]], {"speed": float("inf")}, "speed: inf is not a finite number"),
        ([[0, 0], [0.3, 0]], {"speed": 1e-4}, "the path takes 3000 s at 0.0001 m/s, at most 600 s are allowed"),
        ([[0, 0], [0.3, 0]], {"speed": 1.0, "acceleration": -1.0}, "path_acceleration must be greater than 0 m/s"),
        ([[0, 0], [80, 0]], {"speed": 0.3}, r"goes 80 m .* millimetres \(--scale 0.001\)"),
        ([[0, 0]], {"speed": 0.3}, "1 sample, at least 2"),
        ([[0, 0], [0, 0]], {"speed": 0.3}, "the path is 0 m long"),
    ],
)
def test_a_path_that_cannot_be_run_is_refused(points: Any, options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Command.from_path(points, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 1.0, "path_acceleration": 1e-7}, "the path takes .* s at this acceleration, at most 600 s"),
        ({"speed": 1e300}, "speed must be between 1e-12 and 1e[+]12 m/s, got 1e[+]300 m/s"),
        ({"rate": 1e-300}, "rate must be between"),
        ({"rate": 100.0, "smooth": 1e-9}, "smooth must be between 0.1 and 200 ms"),
        ({"rate": 100.0, "scale": 1e300}, "scale must be between"),
    ],
)
def test_option_that_would_take_endless_samples_or_overflow_is_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Command.from_samples([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]], reading=Reading(**options))  # type: ignore[arg-type]

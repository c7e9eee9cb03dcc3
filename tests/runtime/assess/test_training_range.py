"""What a plan asks of the network, beside what it was trained on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Command, Friction, Start
from runtime.assess.training_range import asked_for, beyond

Array = NDArray[np.float64]
TRAINED_ON = {
    "static": (0.5, 1.4),
    "kinetic": (0.3, 0.7),
    "reach": (0.0, 0.15),
    "speed": (0.0, 1.1),
    "samples": (300.0, 1500.0),
    "start_speed": (0.0, 1.0),
    "corner": (0.0, 1.2),
}


def bent(speed: float, angle: float) -> Array:
    """Return 400 positions: straight ahead, and from the middle on at an angle (rad), at a speed (m/s)."""
    heading = np.where(np.arange(400) < 200, 0.0, angle)
    return np.cumsum(speed * 1e-3 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)


def lines(position: Array, friction: Friction | None = None, start: Start | None = None) -> list[str]:
    return beyond(asked_for(Command(position), friction or Friction(), start or Start()), TRAINED_ON)


def test_ordinary_command_is_within() -> None:
    assert lines(bent(0.3, 1.0)) == []


@pytest.mark.parametrize(("speed", "angle"), [(0.4, np.pi / 2), (0.9, np.pi / 3), (0.7, 2.5)])
def test_corner_is_the_change_of_velocity(speed: float, angle: float) -> None:
    found = asked_for(Command(bent(speed, angle)), Friction(), Start())
    assert found["corner"] == pytest.approx(max(speed, 2.0 * speed * np.sin(angle / 2.0)), rel=1e-9)
    assert found["speed"] == pytest.approx(speed, rel=1e-9)


def test_command_that_begins_at_speed_has_a_corner_there() -> None:
    found = asked_for(Command(bent(0.8, 0.0)), Friction(), Start())
    assert found["corner"] == pytest.approx(0.8, rel=1e-9)


def test_each_thing_beyond_is_named_with_value_and_range() -> None:
    assert lines(bent(0.7, np.pi))[-1] == "corner 1.4 m/s is outside the range trained on, 0 to 1.2 m/s"
    assert lines(bent(1.2, 0.3))[1:] == ["speed 1.2 m/s is outside the range trained on, 0 to 1.1 m/s"]
    assert lines(bent(1.2, 0.3))[0].startswith("reach 0.4")
    assert lines(bent(0.1, 0.0), Friction(1.5, 0.2)) == [
        "static 1.5 is outside the range trained on, 0.5 to 1.4",
        "kinetic 0.2 is outside the range trained on, 0.3 to 0.7",
    ]
    assert lines(bent(0.1, 0.0), start=Start(pan_velocity=(0.9, 0.9))) == [
        "start speed 1.273 m/s is outside the range trained on, 0 to 1 m/s"
    ]


def test_short_commands_are_beyond_and_long_ones_are_not() -> None:
    assert lines(np.zeros((200, 2))) == ["samples 200 is outside the range trained on, 300 to 1500"]
    assert lines(np.zeros((60_000, 2))) == []
    assert lines(np.zeros((2, 2))) == ["samples 2 is outside the range trained on, 300 to 1500"]


def test_noise_of_a_millimetre_is_neither_speed_nor_corner() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0, 1200, 10) * 1e-3
    noisy = 0.03 * np.sin(4.0 * t)[:, None] * [1.0, 0.5] + rng.normal(0.0, 1e-3, (len(t), 2))
    found = asked_for(Command.from_waypoints(t, noisy), Friction(), Start())
    assert found["speed"] < 0.5
    assert found["corner"] < 0.6

"""What a plan asks of the network, beside what it was trained on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Command, Friction, Limits, Planner, Start
from runtime.assess.training_range import asked_for, beyond_training
from runtime.network.job import Job

Array = NDArray[np.float64]

UNIT = Limits(0.2, acceleration=25.0, jerk=10_000.0)
"""Limits of a pan whose units are the network's own: a sample of its time lasts a millisecond."""

TRAINED_ON = {
    "static": (0.5, 1.4),
    "kinetic": (0.3, 0.7),
    "push": (0.0, 0.88),
    "pan_reach": (0.02, 0.4),
    "height": (0.0, 0.2),
    "pan_speed": (0.5, 3.0),
    "acceleration": (2.0, 40.0),
    "jerk": (500.0, 20_000.0),
    "reach": (0.0, 0.75),
    "speed": (0.0, 1.1),
    "samples": (300.0, 1500.0),
    "start_speed": (0.0, 1.0),
    "corner": (0.0, 1.2),
}


def bent(speed: float, angle: float) -> Array:
    """Return 400 positions: straight ahead, and from the middle on at an angle (rad), at a speed (m/s)."""
    heading = np.where(np.arange(400) < 200, 0.0, angle)
    return np.cumsum(speed * 1e-3 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)


def job_of(position: Array, friction: Friction | None = None, start: Start | None = None) -> Job:
    return Job(Command(position), friction or Friction(), UNIT, start or Start())


@pytest.fixture
def lines(planner: Planner) -> object:
    manifest = replace(planner.bundle.manifest, trained_on=TRAINED_ON)
    return lambda *arguments, **options: beyond_training(manifest, job_of(*arguments, **options))


def found(position: Array) -> dict[str, float]:
    return {name: asked.value for name, asked in asked_for(job_of(position), 3.0).items()}


def test_ordinary_command_is_within(lines) -> None:
    assert lines(bent(0.3, 1.0)) == []


@pytest.mark.parametrize(("speed", "angle"), [(0.4, np.pi / 2), (0.9, np.pi / 3), (0.7, 2.5)])
def test_corner_is_the_change_of_velocity(speed: float, angle: float) -> None:
    asked = found(bent(speed, angle))
    assert asked["corner"] == pytest.approx(max(speed, 2.0 * speed * np.sin(angle / 2.0)), rel=1e-9)
    assert asked["speed"] == pytest.approx(speed, rel=1e-9)


def test_command_that_begins_at_speed_has_a_corner_there() -> None:
    assert found(bent(0.8, 0.0))["corner"] == pytest.approx(0.8, rel=1e-9)


def test_each_thing_beyond_is_named_with_value_and_range(lines) -> None:
    assert lines(bent(0.7, np.pi))[-1] == "corner 1.4 m/s is outside the range trained on, 0 to 1.2 m/s"
    assert lines(bent(1.2, 0.3))[1:] == ["speed 1.2 m/s is outside the range trained on, 0 to 1.1 m/s"]
    assert lines(bent(1.2, 0.3))[0].startswith("reach 0.4")
    assert lines(bent(0.1, 0.0), Friction(1.45, 0.2)) == [
        "static 1.45 is outside the range trained on, 0.5 to 1.4",
        "kinetic 0.2 is outside the range trained on, 0.3 to 0.7",
    ]
    assert lines(bent(0.1, 0.0), start=Start(pan_velocity=(0.9, 0.9))) == [
        "start speed 1.273 m/s is outside the range trained on, 0 to 1 m/s"
    ]


def test_ranges_are_told_in_the_units_of_the_pan(planner: Planner) -> None:
    manifest = replace(planner.bundle.manifest, trained_on=TRAINED_ON)
    job = job_of(bent(0.9, 0.0))._replace(limits=Limits(0.1, acceleration=12.5, jerk=10_000.0))
    # Half of the length and the same time: half of the velocity.
    assert "speed 0.9 m/s is outside the range trained on, 0 to 0.55 m/s" in beyond_training(manifest, job)


def test_short_commands_are_beyond_and_long_ones_are_not(lines) -> None:
    assert lines(np.zeros((200, 2))) == ["samples 200 is outside the range trained on, 300 to 1500"]
    assert lines(np.zeros((60_000, 2))) == []
    assert lines(np.zeros((2, 2))) == ["samples 2 is outside the range trained on, 300 to 1500"]


def test_noise_of_a_millimetre_is_neither_speed_nor_corner() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0, 1200, 10) * 1e-3
    noisy = 0.03 * np.sin(4.0 * t)[:, None] * [1.0, 0.5] + rng.normal(0.0, 1e-3, (len(t), 2))
    asked = found(Command.from_waypoints(t, noisy).position)
    assert asked["speed"] < 0.5
    assert asked["corner"] < 0.6

"""The kinetic friction, found by particles from noisy frames."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.friction import Friction
from runtime.observe.particles import MOST, PACE, SPACING, Particles
from runtime.observe.past import Past
from runtime.observe.sliding import Frame
from runtime.physics.law import slide_one

NOISE, EVERY, SAMPLES = 1e-3, 10, 1200


def shaken(lifts: bool = False) -> Past:
    t = np.arange(SAMPLES) * 1e-3
    u = np.stack([11.0 * np.sin(21.0 * t), 9.0 * np.cos(13.0 * t), lifts * 3.0 * np.sin(9.0 * t)], axis=1)
    return Past.still(np.zeros(3), np.zeros(3), 2 * SAMPLES).then(u)


def followed(past: Past, friction: Friction, push: float = 0.0, seed: int = 0) -> Particles:
    """Return what is believed after a frame every 10 ms; half-way the object is pushed (m)."""
    u, rng = past.between(0, SAMPLES), np.random.default_rng(seed)
    half = slide_one(np.zeros(4), u[: SAMPLES // 2], friction)
    rest = slide_one(half[-1] + [push, 0.0, 0.0, 0.0], u[SAMPLES // 2 :], friction)
    position: NDArray[np.float64] = np.concatenate([half, rest])[:, :2]
    particles = Particles.begin(np.zeros(4), Friction(1.0, 0.5))
    for at in range(EVERY, SAMPLES, EVERY):
        seen = position[at - 1] + rng.normal(0.0, NOISE, 2)
        particles = particles.offered(Frame(at, seen), NOISE, False).run(past, at)
    return particles


@pytest.mark.parametrize(("static", "kinetic"), [(1.0, 0.5), (0.6, 0.45), (0.4, 0.3), (0.8, 0.65)])
@pytest.mark.parametrize("lifts", [False, True])
def test_kinetic_friction_is_found_to_a_few_per_cent(static: float, kinetic: float, lifts: bool) -> None:
    found, spread = followed(shaken(lifts), Friction(static, kinetic)).found
    assert found == pytest.approx(kinetic, rel=0.05)
    assert abs(found - kinetic) < 3.0 * spread
    assert spread < 0.1 * kinetic


def test_push_is_not_taken_for_friction() -> None:
    found, _ = followed(shaken(), Friction(0.7, 0.6), push=0.03).found
    assert found == pytest.approx(0.6, rel=0.08)


def test_what_was_told_holds_until_a_frame_tells_more() -> None:
    particles = Particles.begin(np.zeros(4), Friction(1.0, 0.37))
    still = Past.still(np.zeros(3), np.zeros(3)).then(np.zeros((300, 3)))
    for at in range(EVERY, 300, EVERY):
        particles = particles.offered(Frame(at, np.zeros(2)), NOISE, False).run(still, at)
    assert particles.found[0] == 0.37
    assert not particles.informed


def test_same_frames_find_the_same_friction_and_a_new_place_keeps_it() -> None:
    first, second = (followed(shaken(), Friction(0.9, 0.4)) for _ in range(2))
    assert first.found == second.found
    placed = first.placed(5000, np.array([0.01, 0.0, 0.0, 0.0]))
    assert placed.found == first.found
    assert placed.at == 5000


def test_a_reading_pays_for_a_few_samples_and_no_more() -> None:
    past, particles = shaken(), Particles.begin(np.zeros(4), Friction())
    for at in range(SPACING, 400, SPACING):
        particles = particles.offered(Frame(at, np.zeros(2)), NOISE, False)
    for now, ran in ((1, PACE), (2, 2 * PACE), (2, 2 * PACE), (300, 2 * PACE + MOST)):
        particles = particles.run(past, now)
        assert particles.at == ran


def test_frames_too_close_together_or_out_of_order_are_passed_over() -> None:
    particles = Particles.begin(np.zeros(4), Friction())
    for at in (20, 21, 10, 20, 20 + SPACING):
        particles = particles.offered(Frame(at, np.zeros(2)), NOISE, False)
    assert [each.frame.at for each in particles.waiting] == [20, 20 + SPACING]
    event = particles.offered(Frame(21 + SPACING, np.zeros(2)), NOISE, True)
    assert event.waiting[-1].event

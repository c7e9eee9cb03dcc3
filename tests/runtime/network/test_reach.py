"""How much of a pan's reach the network is told."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, Limits, Start
from runtime.command import Command
from runtime.network.job import Job
from runtime.network.reach import SHARES, nearest, shares_about, with_reach


def straight(speed: float, samples: int = 600) -> NDArray[np.float64]:
    """A command along x at a speed (m/s)."""
    return np.stack([1e-3 * speed * np.arange(samples), np.zeros(samples)], axis=1)


def share(speed: float, limits: Limits, noise: float = 0.0) -> float:
    position = straight(speed) + np.random.default_rng(0).normal(0.0, noise, (600, 2))
    return with_reach(Job(Command(position), Friction(), limits, Start())).reach_used


def test_slow_commands_are_told_a_smaller_reach_and_fast_ones_all_of_it() -> None:
    level = [share(speed, Limits()) for speed in (0.01, 0.05, 0.08, 0.12, 0.5)]
    assert level == sorted(level)
    assert (level[0], level[-1]) == (SHARES[-1], 1.0)
    assert share(0.08, Limits(height=0.1)) < share(0.08, Limits())


def test_what_is_slow_depends_on_the_pan() -> None:
    speed = 0.07
    assert share(speed, Limits(acceleration=4.0, jerk=1_000.0)) > share(speed, Limits())
    assert share(speed, Limits(0.1)) > share(speed, Limits(0.4))


def test_noise_is_no_speed() -> None:
    assert share(0.02, Limits(), noise=1e-4) == share(0.02, Limits())


def test_what_a_job_was_told_before_does_not_matter() -> None:
    job = Job(Command(straight(0.08)), Friction(), Limits(), Start(), reach_used=0.25)
    assert with_reach(job).reach_used == share(0.08, Limits())


@pytest.mark.parametrize(("wanted", "found"), [(5.0, 1.0), (0.9, 1.0), (0.6, 0.7), (0.4, 0.35), (0.0, 0.25)])
def test_shares_are_of_a_few(wanted: float, found: float) -> None:
    assert nearest(wanted) == found


@pytest.mark.parametrize(
    ("first", "others"), [(1.0, (0.7, 0.5)), (0.7, (1.0, 0.5)), (0.5, (0.7, 0.35)), (0.25, (0.35, 0.5))]
)
def test_candidates_try_the_shares_about_it(first: float, others: tuple[float, float]) -> None:
    found = shares_about(first)
    assert found[0] == first
    assert set(found[1:]) == set(others)

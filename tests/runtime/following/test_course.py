"""What a stream follows, and what its network is told of the friction."""

from __future__ import annotations

import numpy as np
import pytest

from runtime import Friction, FrictionEstimate, Planner, Start
from runtime.command import Command
from runtime.following.course import Course
from runtime.network.job import Job

TOLD = Friction(1.0, 0.5)
FOUND = FrictionEstimate(Friction(0.6, 0.4), kinetic=(0.38, 0.42), static=(0.5, 0.75))


def course_of(planner: Planner) -> Course:
    position = np.linspace([0.0, 0.0], [0.05, 0.02], 600)
    return Course.begin(planner.bundle, Job(Command(position), TOLD, planner.bundle.manifest.limits, Start()), 0)


def test_network_is_told_the_friction_that_was_found(planner: Planner) -> None:
    course = course_of(planner)
    found = course.told(FOUND)
    assert found.job.friction == FOUND.friction
    assert found.reader.now == course.reader.now
    assert not np.array_equal(found.reader.frame.conditions, course.reader.frame.conditions)
    assert found.told(FOUND) is found


@pytest.mark.parametrize(
    "found",
    [
        FrictionEstimate(Friction(0.6, 0.4), kinetic=(0.35, 0.55), static=(0.4, 1.2)),
        FrictionEstimate(Friction(0.98, 0.49), kinetic=(0.485, 0.495), static=(0.97, 0.99)),
    ],
    ids=["not ruled out", "as good as told"],
)
def test_what_was_told_holds_until_it_is_ruled_out(planner: Planner, found: FrictionEstimate) -> None:
    course = course_of(planner)
    assert course.told(found) is course

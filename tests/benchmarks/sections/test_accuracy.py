"""What plans lead to, and the figures of accuracy, on planners whose answer is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.section import Subject
from benchmarks.sections.accuracy import AccuracySettings, accuracy_of, figures, friction_cells, measure_accuracy
from benchmarks.suite.families import FRICTION_GRID, NOMINAL, Family, spline
from benchmarks.suite.outcome import one_by_one, plan_family
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY
from runtime.planner import Planner

ACCELERATION = 15.0
"""Of a pan that moves along x: above mu g for every static friction of the grid, so that the object slides (m/s^2)."""


def family(*positions: FloatArray, frictions: Sequence[Friction] | None = None) -> Family:
    labels = tuple(f"command {index}" for index in range(len(positions)))
    return Family("test", positions, tuple(frictions or [NOMINAL] * len(positions)), labels)


def still(positions: Sequence[FloatArray], _frictions: Sequence[Friction]) -> list[FloatArray]:
    return [np.zeros_like(position) for position in positions]


def pushing(positions: Sequence[FloatArray], _frictions: Sequence[Friction]) -> list[FloatArray]:
    return [np.tile([ACCELERATION, 0.0], (len(position), 1)) for position in positions]


def slid(samples: int, friction: Friction = NOMINAL) -> FloatArray:
    """Positions (samples, 2) of an object on the pan of `pushing`, from Eqs. 4 and 9 by hand.

    In its first sample it breaks away under mu g, from then on it slides under mu' g.
    """
    first, after = (ACCELERATION - mu * GRAVITY for mu in (friction.static, friction.kinetic))
    t = np.maximum(np.arange(samples) - 1, 0) * DT
    x = np.where(np.arange(samples) > 0, 0.5 * first * DT**2 + first * DT * t + 0.5 * after * t**2, 0.0)
    return np.stack([-x, np.zeros(samples)], axis=1)


def line(samples: int, length: float) -> FloatArray:
    return np.linspace([0.0, 0.0], [0.0, length], samples)


def test_a_pan_that_never_moves_leaves_the_command_as_the_error() -> None:
    commands = family(line(101, 0.1), line(301, 0.2))
    outcome = plan_family(still, commands)
    # The root mean square of 0, h, 2h, .., nh is h sqrt(n (2n + 1) / 6).
    expected = [length / n * math.sqrt(n * (2 * n + 1) / 6) for n, length in ((100, 0.1), (300, 0.2))]
    assert outcome.tracking == pytest.approx(expected, rel=1e-12)
    summed = figures([outcome])
    assert summed.no_better_than_unmoved == 2
    assert summed.pan_reach_max == summed.acceleration_max == summed.change_mean == 0.0
    assert summed.pan_reach_share == 1.0


def test_an_object_that_slides_as_commanded_has_no_error() -> None:
    frictions = [NOMINAL, Friction(0.8, 0.3)]
    commands = family(slid(200), slid(150, frictions[1]), frictions=frictions)
    outcome = plan_family(pushing, commands)
    assert outcome.tracking == pytest.approx([0.0, 0.0], abs=1e-12)
    # K samples are K - 1 steps: the last acceleration leads out of the command.
    assert outcome.pan_reach == pytest.approx([0.5 * ACCELERATION * ((k - 1) * DT) ** 2 for k in (200, 150)])
    summed = figures([outcome])
    assert summed.no_better_than_unmoved == 0
    assert summed.pan_reach_share == 0.5
    assert summed.acceleration_max == summed.acceleration_mean == ACCELERATION


def test_a_command_off_the_origin_is_measured_from_its_own_start() -> None:
    offset = np.array([0.3, -0.2])
    outcome = plan_family(pushing, family(slid(200) + offset))
    assert outcome.tracking == pytest.approx([0.0], abs=1e-12)
    assert outcome.unmoved == pytest.approx(plan_family(still, family(slid(200))).tracking)


def test_figures_are_those_of_the_errors_of_single_commands() -> None:
    commands = family(*(line(50, 0.01 * index) for index in range(1, 22)))
    outcome = plan_family(still, commands)
    unit = outcome.tracking[0]
    summed = figures([outcome])
    assert summed.commands == 21
    assert summed.tracking_mean == pytest.approx(11 * unit)
    assert summed.tracking_median == pytest.approx(11 * unit)
    assert summed.tracking_p95 == pytest.approx(20 * unit)
    assert summed.tracking_max == pytest.approx(21 * unit)
    assert summed.worst == "command 20"
    assert summed.samples_per_second == pytest.approx(21 * 50 / outcome.planning_time)


def test_the_change_of_the_acceleration_is_a_vector_s() -> None:
    def turning(positions: Sequence[FloatArray], _frictions: Sequence[Friction]) -> list[FloatArray]:
        return [np.tile([[3.0, 0.0], [0.0, 4.0]], (len(position) // 2, 1)) for position in positions]

    summed = figures([plan_family(turning, family(line(40, 0.1)))])
    assert summed.change_mean == pytest.approx(5.0)
    assert summed.acceleration_mean == pytest.approx(3.5)
    assert summed.acceleration_max == 4.0


def test_the_friction_table_gives_each_friction_its_own_mean() -> None:
    # Each friction's command is what the object does under it, twice as far for the second half of them.
    positions, frictions = [], []
    for index, friction in enumerate(FRICTION_GRID):
        positions += [slid(100, friction), slid(100, friction) * (2.0 if index % 2 else 1.0)]
        frictions += [friction, friction]
    outcome = plan_family(pushing, family(*positions, frictions=frictions))
    table = friction_cells(outcome)
    assert [(cell.static, cell.kinetic) for cell in table] == [(each.static, each.kinetic) for each in FRICTION_GRID]
    for index, (cell, friction) in enumerate(zip(table, FRICTION_GRID, strict=True)):
        rms = math.sqrt(np.mean(slid(100, friction) ** 2) * 2)
        assert cell.tracking_mean == pytest.approx(0.5 * rms if index % 2 else 0.0, abs=1e-9)


def test_the_total_leaves_the_many_commands_of_friction_out() -> None:
    measured = accuracy_of(still, AccuracySettings(("short", "odd", "friction")))
    assert measured.total.commands == 16
    assert list(measured.families) == ["short", "odd", "friction"]
    spline_mean = accuracy_of(still, AccuracySettings(("spline",))).total.tracking_mean
    assert measured.friction_worst == pytest.approx(spline_mean)
    assert measured.friction_ratio is None
    assert [cell.tracking_mean for cell in measured.friction] == pytest.approx([spline_mean] * len(FRICTION_GRID))


@pytest.mark.parametrize(
    ("planned", "message"),
    [
        ([np.zeros((50, 2))], "1 plans for 2 commands"),
        ([np.zeros((50, 2)), np.zeros((49, 2))], r"command 1: .* shape \(50, 2\), got \(49, 2\)"),
        ([np.zeros((50, 2)), np.full((50, 2), np.nan)], "command 1: .* no finite number"),
    ],
)
def test_a_plan_that_is_none_is_refused(planned: list[FloatArray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan_family(lambda _positions, _frictions: planned, family(line(50, 0.1), line(50, 0.1)))


def test_a_planner_s_own_prediction_is_what_is_measured(tiny_bundle: Path) -> None:
    planner = Planner(tiny_bundle)
    positions, frictions = spline().positions[:3], (NOMINAL, Friction(0.5, 0.3), NOMINAL)
    commands = family(*positions, frictions=frictions)
    outcome = plan_family(one_by_one(planner), commands)
    qualities = [planner.plan(*one).quality for one in zip(positions, frictions, strict=True)]
    assert outcome.tracking == pytest.approx([quality.tracking_rmse for quality in qualities], rel=1e-6)
    assert outcome.pan_reach == pytest.approx([quality.pan_reach for quality in qualities], rel=1e-6)


def test_only_the_first_commands_are_planned() -> None:
    measured = accuracy_of(still, AccuracySettings(("short", "odd"), 2))
    assert [each.commands for each in measured.families.values()] == [2, 2]
    assert measured.total.commands == 4
    with pytest.raises(InputError, match="--commands must be at least 1, got 0"):
        AccuracySettings(commands=0)


def test_ray_measures_the_same(tiny_bundle: Path) -> None:
    pytest.importorskip("ray")
    subject = Subject.load(tiny_bundle)
    here, there = (
        measure_accuracy(subject, AccuracySettings(("short", "odd"), 2, ray=address)).figures
        for address in (None, "local")
    )
    for name, row in here.families.items():
        assert there.families[name] == replace(row, samples_per_second=there.families[name].samples_per_second)

"""Which plans are bad, and that these, and no others, are made again in several ways."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from runtime import Friction, Limits, Planner, Start
from runtime.assess.several import BAD_FLOOR, BAD_SHARE, MOST_CHUNKS, SEVERAL, follows_badly
from runtime.documents.checks import FloatArray
from runtime.network.reader import chunk_samples

from ..conftest import WatchedBundle

Curve = Callable[..., FloatArray]

TIGHT = Limits(pan_reach=0.06, acceleration=20.0, jerk=3_000.0)


def line(samples: int, length: float) -> FloatArray:
    """Return a move of the least jerk, (samples, 2) (m)."""
    s = np.linspace(0.0, 1.0, samples)
    return length * np.stack([s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.zeros_like(s)], axis=1)


def loops(samples: int, turns: float, size: float) -> FloatArray:
    t = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


@pytest.mark.parametrize(("way", "height"), [("level", 0.0), ("lifting", 0.1)])
def test_a_plan_is_bad_by_the_share_of_what_the_command_moves(way: str, height: float) -> None:
    start, friction, limits = np.zeros(4), Friction(1.0, 0.5), Limits(height=height)
    for size in (0.06, 0.12):
        command = line(1200, size)
        bad = BAD_SHARE[way] * np.sqrt((command**2).sum(axis=1).mean())
        assert not follows_badly(0.99 * bad, start, command, friction, limits)
        assert follows_badly(1.01 * bad, start, command, friction, limits)


def test_small_errors_and_pans_that_are_too_weak_are_not_bad_plans() -> None:
    start, friction, limits = np.zeros(4), Friction(1.0, 0.5), Limits()
    small = line(1200, 0.01)
    assert not follows_badly(BAD_FLOOR, start, small, friction, limits)
    assert not follows_badly(0.05, start, line(1200, 0.1), friction, Limits(acceleration=9.0))  # it cannot slide


def test_a_long_command_is_planned_once() -> None:
    start, friction, limits = np.zeros(4), Friction(1.0, 0.5), Limits()
    longest = MOST_CHUNKS * chunk_samples(limits)
    assert follows_badly(0.05, start, line(longest, 0.1), friction, limits)
    assert not follows_badly(0.05, start, line(longest + 1, 0.1), friction, limits)


def test_a_bad_plan_is_made_several_ways_as_one_batch(
    watched: tuple[Planner, WatchedBundle], make_curve: Curve
) -> None:
    planner, bundle = watched
    lone = planner.plan(make_curve(400), candidates=1)
    assert [len(command) for command in bundle.encoded] == [1]
    bundle.encoded.clear()
    best = planner.plan(make_curve(400))
    assert [len(command) for command in bundle.encoded] == [1, SEVERAL - 1]
    assert best.quality.tracking_rmse < lone.quality.tracking_rmse
    (note,) = (note for note in best.quality.notes if "plans" in note)
    told = re.fullmatch(r"the best of 8 plans: .* has a tracking RMSE of (\S+) m", note)
    assert told is not None
    assert float(told[1]) == pytest.approx(lone.quality.tracking_rmse, rel=1e-3)
    np.testing.assert_array_equal(best.replay()[:, :2], best.object_position)


@pytest.mark.parametrize(
    ("position", "limits"),
    [
        (line(400, 1e-4), Limits(pan_reach=0.05)),  # below the floor, whatever the pan does
        (line(400, 0.05), Limits(acceleration=9.0)),  # the object cannot slide
        (line(6000, 0.05), Limits()),  # too long
    ],
)
def test_what_gains_nothing_costs_one_decode(
    watched: tuple[Planner, WatchedBundle], position: FloatArray, limits: Limits
) -> None:
    planner, bundle = watched
    friction = Friction(1.4, 1.4) if limits.acceleration > 9.0 and len(position) < 6000 else Friction(1.0, 0.5)
    plan = planner.plan(position, friction, limits=limits)
    assert {len(command) for command in bundle.encoded} == {1}
    assert not any("best of" in note for note in plan.quality.notes)


def test_one_plan_is_what_who_asks_for_one_gets(watched: tuple[Planner, WatchedBundle], make_curve: Curve) -> None:
    planner, bundle = watched
    one = planner.plan(make_curve(400), candidates=1)
    (batch,) = planner.plan_batch([make_curve(400)])
    assert [len(command) for command in bundle.encoded] == [1, 1]
    np.testing.assert_array_equal(one.pan_acceleration, batch.pan_acceleration)
    assert not any("best of" in note for note in (*one.quality.notes, *batch.quality.notes))


def test_the_shipped_network_gets_better_where_it_is_bad_and_stays_where_it_is_good() -> None:
    planner = Planner()
    start = Start((0.01, 0.0), (0.1, 0.0))
    for position, limits, begin in ((loops(1000, 1.5, 0.05), TIGHT, Start()), (loops(600, 1.0, 0.05), TIGHT, start)):
        lone, best = (planner.plan(position, limits=limits, start=begin, candidates=count) for count in (1, None))
        assert best.quality.tracking_rmse < 0.97 * lone.quality.tracking_rmse
        assert min(value for value in best.quality.margins.values() if value is not None) > -1e-9
        np.testing.assert_array_equal(best.pan_position[0], lone.pan_position[0])
    for size in (0.03, 0.06):
        good = line(1200, size)
        lone, same = (planner.plan(good, limits=Limits(height=0.1), candidates=count) for count in (1, None))
        np.testing.assert_array_equal(same.pan_acceleration, lone.pan_acceleration)
        assert same.quality.to_dict() == lone.quality.to_dict()


def test_judged_under_several_frictions_if_that_is_asked(planner: Planner, make_curve: Curve) -> None:
    friction = Friction(1.0, 0.5)
    for seed in range(3):
        position = make_curve(400, seed)
        nominal, robust = (planner.plan(position, friction, robust=share) for share in (0.0, 0.1))
        assert nominal.quality.tracking_rmse <= robust.quality.tracking_rmse

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from runtime import Command, InputError, Planner, Reading
from runtime.commands.resample import LONG, deviation, is_sparse, resample, spline_slopes
from runtime.commands.smoothing import noise, smooth

coordinates = st.floats(-0.1, 0.1).map(lambda value: round(value, 5))
intervals = st.floats(0.002, 0.6)


@st.composite
def waypoints(draw: Any, interval: Any = intervals) -> tuple[Any, Any]:
    """Draw times (n,) (s) and positions (n, 2) (m)."""
    steps = draw(st.lists(interval, min_size=1, max_size=12))
    position = draw(st.lists(st.tuples(coordinates, coordinates), min_size=len(steps) + 1, max_size=len(steps) + 1))
    return np.concatenate([[0.0], np.cumsum(steps)]), np.array(position)


def dense(t: Any) -> Any:
    return np.linspace(0.0, t[-1], 4001)


def eight(samples: int) -> tuple[Any, Any]:
    """Return times (s) and positions (m) of an eight of 1.2 s, from rest to rest."""
    s = np.linspace(0.0, 1.0, samples)
    angle = 2 * np.pi * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return 1.2 * s, 0.05 * np.stack([np.sin(angle), 0.5 * np.sin(2 * angle)], axis=1)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 20, 500])
def test_slopes_are_those_of_scipys_spline(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(20):
        t = np.cumsum(random.uniform(0.001, 0.3, count))
        y = random.uniform(-0.1, 0.1, (count, 2))
        np.testing.assert_allclose(spline_slopes(t, y), CubicSpline(t, y)(t, 1), rtol=1e-9, atol=1e-9)


@settings(deadline=None)
@given(waypoints())
def test_command_goes_through_its_waypoints_and_stays_in_their_box(drawn: tuple[Any, Any]) -> None:
    t, position = drawn
    np.testing.assert_allclose(resample(t, position, t), position, atol=1e-12)
    made = resample(t, position, dense(t))
    assert (made >= position.min(axis=0) - 0.001).all()
    assert (made <= position.max(axis=0) + 0.001).all()


@settings(deadline=None)
@given(waypoints())
def test_monotone_waypoints_stay_monotone(drawn: tuple[Any, Any]) -> None:
    t, position = drawn
    position = np.stack([np.sort(position[:, 0]), -np.sort(position[:, 1])], axis=1)
    made = resample(t, position, dense(t))
    assert np.diff(made[:, 0]).min() >= -1e-12
    assert np.diff(made[:, 1]).max() <= 1e-12


@settings(deadline=None)
@given(waypoints(st.floats(LONG + 0.001, 1.0)))
def test_sparse_waypoints_are_joined_by_straight_lines_from_rest_to_rest(drawn: tuple[Any, Any]) -> None:
    t, position = drawn
    made = resample(t, position, dense(t))
    assert is_sparse(t)
    assert deviation(t, position, dense(t), made) <= 0.002
    step = 1e-6
    ends = resample(t, position, np.array([0.0, step, t[-1] - step, t[-1]]))
    assert np.hypot(*(ends[1] - ends[0])) / step < 1e-3
    assert np.hypot(*(ends[3] - ends[2])) / step < 1e-3


def test_a_stop_between_two_moves_is_a_stop() -> None:
    command = Command.from_waypoints([0.0, 1.0, 1.2, 2.2], [[0, 0], [0, 0], [0.05, 0], [0.05, 0]])
    assert not command.position[:1001].any()
    np.testing.assert_allclose(command.position[1200:], [[0.05, 0.0]] * 1001, atol=1e-12)
    assert command.speed < 0.4
    assert command.deviation < 1e-12


@pytest.mark.parametrize(("rate", "error"), [(20, 2e-4), (25, 1e-4), (50, 1e-5), (100, 1e-6), (250, 1e-7)])
def test_smooth_recordings_are_what_they_sample(rate: int, error: float) -> None:
    t, position = eight(round(1.2 * rate) + 1)
    made = resample(t, position, np.linspace(0.0, 1.2, 1201))
    assert np.abs(made - eight(1201)[1]).max() < error
    assert not is_sparse(t)


def test_a_gap_in_a_recording_is_crossed_straight_and_starts_as_fast_as_it_was() -> None:
    t, position = eight(121)
    kept = (t < 0.5) | (t > 0.65)
    made = resample(t[kept][20:], position[kept][20:], np.linspace(0.3, 1.2, 901))
    assert not is_sparse(t[kept][20:])
    begin, end = t[t < 0.5][-1], t[t > 0.65][0]
    inside = (np.linspace(0.3, 1.2, 901) > begin) & (np.linspace(0.3, 1.2, 901) < end)
    assert deviation(t[kept], position[kept], np.linspace(0.3, 1.2, 901)[inside], made[inside]) <= 0.002


def test_leaving_the_waypoints_lines_is_known_and_told(planner: Planner) -> None:
    t, position = eight(25)
    command = Command.from_waypoints(t, position)
    assert 0.002 < command.deviation < 0.003
    note = f"the command leaves the straight lines between its waypoints by {command.deviation * 1e3:.1f} mm"
    assert note in planner.plan(command).quality.notes
    close = Command.from_waypoints(*eight(49))
    assert 0.0 < close.deviation < 0.002
    assert not close.remarks


def test_a_jump_names_its_waypoints_with_all_digits_of_their_times() -> None:
    t = np.array([1403715309.127143, 1403715309.128143, 1403715309.129143])
    with pytest.raises(InputError) as caught:
        Command.from_waypoints(t, [[0, 0], [0, 0], [0.4, 0]])
    said = str(caught.value)
    assert "from waypoint 1 at 1403715309.128143 s to waypoint 2 at 1403715309.129143 s" in said
    assert "400 m/s, at most 50 m/s" in said


def test_noise_is_seen_and_smoothed_out() -> None:
    t, position = eight(121)
    noisy = position + np.random.default_rng(2).normal(0.0, 1e-3, position.shape)
    assert noise(t, position) == 0.0
    assert noise(t, noisy) == pytest.approx(1e-3, rel=0.3)
    rough, fine = Command.from_waypoints(t, noisy), Command.from_waypoints(t, noisy, Reading(smooth=20.0))
    assert rough.notes == ("looks noisy, by about 1.0 mm: --smooth 25 would take it out",)
    assert fine.notes[0].startswith("smoothing moved it by ")
    truth = eight(1201)[1]
    error = [np.sqrt(np.mean(np.sum((command.position - truth) ** 2, axis=1))) for command in (rough, fine)]
    assert error[1] < 0.75 * error[0]


def test_smoothing_leaves_steady_motion_as_it_is() -> None:
    line = np.linspace([0.0, 0.1], [0.2, -0.1], 500)
    for width in (0.1, 5.0, 200.0):
        np.testing.assert_allclose(smooth(line, width), line, atol=1e-12)

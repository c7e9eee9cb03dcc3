"""The limits hold whatever is asked for, and the pan can come to rest in its reach from every sample."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from ruckig import InputParameter, Result, Ruckig, Trajectory

from runtime import InputError, Limits, Start
from runtime.friction import Friction
from runtime.limits import NO_LIMITS
from runtime.physics.law import DT
from runtime.physics.pan import integrate_pan
from runtime.safety.governor import follow, govern
from runtime.safety.pan import Pan
from runtime.safety.stop import GENTLE, PanState, find_brake, gentle_stop, stop_reach

Array = NDArray[np.float64]

SEQUENCES = int(os.environ.get("SLIDE_SEQUENCES", "1000"))
"""Sequences of chunks asked for; the nightly form sets 100000."""

CHUNK = 100
CHUNKS = 4
TOLERANCE = 1e-9
"""By which a limit may be passed (m, m/s^2, and m/s^3 after multiplication by dt)."""

often = settings(max_examples=SEQUENCES, deadline=None, suppress_health_check=list(HealthCheck))
limits_drawn = st.builds(
    Limits, st.floats(0.01, 0.5), st.floats(1.0, 100.0), st.floats(2.0, 5.0).map(lambda power: 10.0**power)
)


@st.composite
def pans(draw: st.DrawFn) -> Pan:
    """Draw limits, and a state from which the pan can stop within them: any that is not is slowed down until it can."""
    limits = draw(limits_drawn)
    unit = st.floats(-1.0, 1.0)
    x, y, vx, vy, ux, uy = draw(st.tuples(unit, unit, unit, unit, unit, unit))
    scale = 1.0
    for _ in range(40):
        state = PanState(
            0.7 * limits.pan_reach * x,
            0.7 * limits.pan_reach * y,
            scale * 2.0 * vx,
            scale * 2.0 * vy,
            scale * 0.7 * limits.acceleration * ux,
            scale * 0.7 * limits.acceleration * uy,
        )
        pan = Pan.at(state, limits)
        if pan.can_stop:
            return pan
        scale *= 0.5
    return Pan.at(PanState(state.x, state.y, 0.0, 0.0, 0.0, 0.0), limits)


def ask(kind: str, pan: Pan, rng: np.random.Generator) -> Array:
    """Return a chunk (1, C, 2) that a decoder of some kind would ask for."""
    bound = pan.limits.acceleration
    if kind == "random":
        return rng.standard_normal((1, CHUNK, 2)) * bound * 10.0 ** rng.uniform(-2.0, 3.0)
    if kind == "constant":
        return np.tile(rng.standard_normal(2) * 2.0 * bound, (1, CHUNK, 1))
    if kind == "smooth":
        return np.cumsum(rng.standard_normal((1, CHUNK, 2)), axis=1) * pan.limits.jerk * DT * rng.uniform(0.0, 0.5)
    if kind == "bang":
        return bound * np.sign(rng.standard_normal((1, CHUNK, 2))).repeat(rng.integers(1, 30), axis=1)[:, :CHUNK]
    # Outwards, as hard as it can: along where the pan is heading, or away from the centre.
    away = np.array(pan.state[:2]) + rng.uniform(0.0, 1.0) * np.array(pan.state[2:4])
    size = math.hypot(*away)
    direction = away / size if size > 0.0 else np.array([1.0, 0.0])
    return np.tile(direction * bound * rng.uniform(0.9, 50.0), (1, CHUNK, 1))


KINDS = ("random", "constant", "smooth", "bang", "outwards")


def drive(pan: Pan, kinds: list[str], seed: int) -> tuple[Array, Array, list[Pan]]:
    """Govern one chunk of each kind: accelerations (n, 2), pan states (n, 4), and the pan after each chunk."""
    rng, pans = np.random.default_rng(seed), [pan]
    accelerations, states = [], []
    for kind in kinds:
        acceleration, moved, (after,) = govern(pans[-1:], ask(kind, pans[-1], rng))
        accelerations.append(acceleration[0])
        states.append(moved[0])
        pans.append(after)
    return np.concatenate(accelerations), np.concatenate(states), pans[1:]


def check_limits(pan: Pan, u: Array, states: Array) -> None:
    limits = pan.limits
    moved = integrate_pan(np.array(pan.state[:4]), u)
    assert np.abs(moved - states).max() <= TOLERANCE
    assert np.hypot(*u.T).max() <= limits.acceleration + TOLERANCE
    change = np.diff(np.concatenate([[pan.state[4:]], u]), axis=0)
    assert np.hypot(*change.T).max() <= limits.jerk * DT + TOLERANCE
    assert np.hypot(*moved[:, :2].T).max() <= limits.pan_reach + TOLERANCE


@often
@given(pans(), st.lists(st.sampled_from(KINDS), min_size=CHUNKS, max_size=CHUNKS), st.integers(0, 2**32))
def test_limits_hold_whatever_is_asked_for_and_a_stop_leads_on(pan: Pan, kinds: list[str], seed: int) -> None:
    u, states, pans = drive(pan, kinds, seed)
    check_limits(pan, u, states)
    # From every sample the pan can come to rest: along the rest of its chunk and the stop that is kept.
    for index, after in enumerate(pans):
        stop = after.brake.accelerations(max(1, after.brake.samples))
        end = slice(0, (index + 1) * CHUNK)
        check_limits(pan, np.concatenate([u[end], stop]), np.concatenate([states[end], _led_to(after, stop)]))
        assert np.abs(_led_to(after, stop)[-1, 2:]).max() <= TOLERANCE
        assert not stop[-1].any()


def _led_to(pan: Pan, u: Array) -> Array:
    return integrate_pan(np.array(pan.state[:4]), u)


@often
@given(pans())
def test_brake_stops_within_its_limits_and_its_hull(pan: Pan) -> None:
    brake = find_brake(pan.state, pan.limits)
    u = brake.accelerations(brake.samples)
    states = integrate_pan(np.array(pan.state[:4]), u)
    check_limits(pan, u, states)
    assert np.abs(states[-1, 2:]).max() <= TOLERANCE
    farthest = max(math.hypot(pan.state.x, pan.state.y), float(np.hypot(*states[:, :2].T).max()))
    assert farthest <= stop_reach(pan.state, brake) + 1e-12
    np.testing.assert_array_equal(u[1:], brake._replace(done=1).accelerations(brake.samples - 1))
    assert not brake.accelerations(brake.samples + 5)[brake.samples - 1 :].any()


def ruckig_time(state: PanState, limits: Limits) -> float:
    """Return the least time (s) to rest by `ruckig`, along the line of the motion: position free, velocity zero."""
    size = math.hypot(state.vx, state.vy)
    given_ = InputParameter(1)
    given_.control_interface = given_.control_interface.Velocity
    given_.current_velocity = [size]
    given_.current_acceleration = [(state.ux * state.vx + state.uy * state.vy) / size]
    given_.target_velocity, given_.target_acceleration = [0.0], [0.0]
    given_.max_acceleration, given_.max_jerk = [limits.acceleration], [limits.jerk]
    trajectory = Trajectory(1)
    assert Ruckig(1).calculate(given_, trajectory) in (Result.Working, Result.Finished)
    return float(trajectory.duration)


@often
@given(limits_drawn, st.floats(0.01, 3.0), st.floats(-1.0, 1.0), st.floats(0.0, 6.28))
def test_brake_on_a_line_is_nearly_as_short_as_the_least_time_stop(
    limits: Limits, speed: float, share: float, angle: float
) -> None:
    x, y = math.cos(angle), math.sin(angle)
    u = share * limits.acceleration
    state = PanState(0.0, 0.0, speed * x, speed * y, u * x, u * y)
    least = ruckig_time(state, limits)
    brake = find_brake(state, limits)
    # Never shorter than the least time, and longer only by the ramps, which go to the full braking acceleration and
    # back even where the stop is too short to reach it, and by whole samples.
    ramp = limits.acceleration / limits.jerk
    assert least - 2.0 * DT <= brake.samples * DT <= least + 3.0 * ramp + 5.0 * DT


@often
@given(pans(), st.integers(0, 2**32))
def test_what_keeps_the_limits_is_not_changed_in_a_single_bit(pan: Pan, seed: int) -> None:
    rng = np.random.default_rng(seed)
    brake = find_brake(pan.state, pan.limits)
    nearly = brake.accelerations(CHUNK)[None] * rng.uniform(0.9, 1.0, (1, 1, 1))
    start = np.array(pan.state[4:])
    steps = np.diff(np.concatenate([start[None, None], nearly], axis=1), axis=1)
    states = integrate_pan(np.array(pan.state[:4]), nearly[0])
    end = PanState(*states[-1].tolist(), *nearly[0, -1].tolist())
    assume(np.hypot(steps[..., 0], steps[..., 1]).max() < pan.limits.jerk * DT)
    assume(np.hypot(*states[:, :2].T).max() < pan.limits.pan_reach)
    assume(stop_reach(end, find_brake(end, pan.limits)) < pan.limits.pan_reach)
    assert govern([pan], nearly)[0] is nearly


def test_batch_is_governed_as_each_one_is() -> None:
    rng = np.random.default_rng(4)
    pans_ = [Pan.at(PanState(0.01 * n, 0.0, 0.1, 0.0, 0.0, 0.0), Limits(0.1 + 0.01 * n, 5.0 + n)) for n in range(8)]
    asked = rng.standard_normal((8, CHUNK, 2)) * 8.0
    together = govern(pans_, asked)
    for row, pan in enumerate(pans_):
        alone = govern([pan], asked[row : row + 1])
        np.testing.assert_array_equal(alone[0][0], together[0][row])
        assert alone[2][0] == together[2][row]


def test_following_catches_up_as_fast_as_the_jerk_allows_and_then_is_exact() -> None:
    asked = np.tile([10.0, 0.0], (1, 20, 1))
    asked[0, 12:] = [10.0, 0.5]
    u = follow(np.zeros((1, 2)), asked, [Limits(jerk=3000.0)])
    np.testing.assert_allclose(u[0, :4, 0], [3.0, 6.0, 9.0, 10.0])
    np.testing.assert_array_equal(u[0, 4:], asked[0, 4:])
    assert asked[0, 0, 0] == 10.0


def test_without_limits_nothing_is_changed() -> None:
    wild = np.full((1, CHUNK, 2), 1e6)
    pan = Pan.at_start(Start(), NO_LIMITS)
    assert govern([pan], wild)[0] is wild


@often
@given(pans(), st.floats(0.2, 2.0))
def test_a_gentle_stop_leaves_a_resting_object_at_rest_where_there_is_room(pan: Pan, static: float) -> None:
    friction = Friction(static, 0.1)
    hold = GENTLE * static * 9.8
    assume(math.hypot(pan.state.ux, pan.state.uy) <= hold)
    softest = find_brake(pan.state, pan.limits, hold)
    stop = gentle_stop(pan.state, pan.limits, friction)
    assert stop is not None  # the strongest one is in reach, by the way these pans are drawn
    u = stop.accelerations(stop.samples)
    check_limits(pan, u, integrate_pan(np.array(pan.state[:4]), u))
    if stop_reach(pan.state, softest) <= pan.limits.pan_reach:
        assert np.hypot(*u.T).max() <= hold + TOLERANCE


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, 30.0, 1e4), "limit pan_reach must be greater than 0 m, got 0 m"),
        ((0.2, -1.0, 1e4), r"limit acceleration must be greater than 0 m/s\^2, got -1 m/s\^2"),
        ((0.2, 30.0, float("nan")), r"limit jerk must be greater than 0 m/s\^3, got nan"),
        (("a", 30.0, 1e4), "limit pan_reach must be a number, got 'a'"),
        ((0.2, 30.0, math.inf), "contradict each other: all must be finite, or none: .* jerk inf"),
        ((math.inf, 30.0, 1e4), "contradict each other: all must be finite, or none: pan_reach inf"),
        ((200.0, 30.0, 1e4), r"must be at most 100 m, got 200 m: is it in millimetres\? Then give 0.2 m"),
        ((-math.inf, 30.0, 1e4), "limit pan_reach must be greater than 0 m, got -inf m"),
        ((True, 30.0, 1e4), "limit pan_reach must be a number, got True"),
        ((0.2, np.bool_(True), 1e4), "limit acceleration must be a number, got "),
        ((0.2, 30.0, 1 + 0j), "limit jerk must be a number, got "),
        ((None, 30.0, 1e4), "limit pan_reach must be a number, got None"),
        ((1e-200, 30.0, 1e4), "limit pan_reach must be between 1e-06 and 1e.09 m, got 1e-200 m"),
        ((0.2, 1e200, 1e4), "limit acceleration must be between"),
        ((0.2, 30.0, 1e-310), "limit jerk must be between"),
        (
            (0.2, 30.0, 0.1),
            r"contradict each other: at a jerk of 0.1 m/s\^3 the acceleration takes 300 s to come to 30",
        ),
    ],
)
def test_bad_limits_are_refused_with_the_numbers(values: tuple[float, float, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Limits(*values)


@pytest.mark.parametrize("limits", [Limits(1e-6, 1e-6, 1e-6), Limits(1e-6, 1e9, 1e9), Limits(100.0, 10.0, 1.0)])
def test_limits_at_the_ends_of_their_ranges_can_be_kept(limits: Limits) -> None:
    pan = Pan.at(PanState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), limits)
    u, states, _ = drive(pan, list(KINDS), 1)
    check_limits(pan, u, states)

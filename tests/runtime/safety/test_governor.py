"""The limits hold whatever is asked for, and the pan can come to rest in its reach from every sample."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from ruckig import InputParameter, Result, Ruckig, Trajectory

from runtime import InputError, Limits, Start
from runtime.friction import Friction
from runtime.limits import LARGEST_SINK, NO_LIMITS
from runtime.physics.law import DT, GRAVITY
from runtime.physics.motion import lengths
from runtime.physics.pan import integrate_pan
from runtime.safety.governor import follow, govern, run_compiled
from runtime.safety.pan import Pan
from runtime.safety.stop import GENTLE, PanState, find_brake, gentle_stop, gentle_strength, stop_extent

Array = NDArray[np.float64]

SEQUENCES = int(os.environ.get("SLIDE_SEQUENCES", "1000"))
"""Sequences of chunks asked for; the nightly form sets 100000."""

SHARD = 5_000
"""Sequences in a test: of many there are several tests, each drawn anew, so that one sees how far they are."""

CHUNK = 100
CHUNKS = 4
TOLERANCE = 1e-9
"""By which a limit may be passed (m, m/s^2, and m/s^3 after multiplication by dt)."""

often = settings(max_examples=min(SEQUENCES, SHARD), deadline=None, suppress_health_check=list(HealthCheck))
in_shards = pytest.mark.parametrize("shard", range(1, -(-SEQUENCES // SHARD) + 1))
limits_drawn = st.builds(
    Limits,
    st.floats(0.01, 0.5),
    height=st.one_of(st.just(0.0), st.floats(0.002, 0.3)),
    speed=st.one_of(st.just(math.inf), st.floats(0.05, 3.0)),
    acceleration=st.floats(1.0, 100.0),
    jerk=st.floats(2.0, 5.0).map(lambda power: 10.0**power),
)


@st.composite
def pans(draw: st.DrawFn) -> Pan:
    """Draw limits, and a state from which the pan can stop within them: any that is not is slowed down until it can."""
    limits = draw(limits_drawn)
    unit = st.floats(-1.0, 1.0)
    x, y, z, vx, vy, vz, ux, uy, uz = draw(st.tuples(*[unit] * 9))
    up = 0.0 if limits.level else 1.0
    scale = 1.0
    for _ in range(40):
        push = scale * 0.57 * limits.acceleration
        state = PanState(
            0.7 * limits.pan_reach * x,
            0.7 * limits.pan_reach * y,
            limits.height * z,
            scale * 2.0 * vx,
            scale * 2.0 * vy,
            scale * 2.0 * vz * up,
            push * ux,
            push * uy,
            max(push * uz * up, -LARGEST_SINK),
        )
        pan = Pan.at(state, limits)
        if pan.can_stop:
            return pan
        scale *= 0.5
    return Pan.at(PanState(state.x, state.y, state.z, *[0.0] * 6), limits)


def ask(kind: str, pan: Pan, rng: np.random.Generator) -> Array:
    """Return a chunk (1, C, 3) that a decoder of some kind would ask for."""
    bound = pan.limits.acceleration
    if kind == "random":
        return rng.standard_normal((1, CHUNK, 3)) * bound * 10.0 ** rng.uniform(-2.0, 3.0)
    if kind == "constant":
        return np.tile(rng.standard_normal(3) * 2.0 * bound, (1, CHUNK, 1))
    if kind == "smooth":
        return np.cumsum(rng.standard_normal((1, CHUNK, 3)), axis=1) * pan.limits.jerk * DT * rng.uniform(0.0, 0.5)
    if kind == "bang":
        return bound * np.sign(rng.standard_normal((1, CHUNK, 3))).repeat(rng.integers(1, 30), axis=1)[:, :CHUNK]
    if kind == "drop":
        return np.tile([*rng.standard_normal(2), -rng.uniform(0.5, 50.0) * bound], (1, CHUNK, 1))
    # Outwards, as hard as it can: along where the pan is heading, or away from the centre.
    away = np.array(pan.state[:3]) + rng.uniform(0.0, 1.0) * np.array(pan.state[3:6])
    size = math.hypot(*away)
    direction = away / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    return np.tile(direction * bound * rng.uniform(0.9, 50.0), (1, CHUNK, 1))


KINDS = ("random", "constant", "smooth", "bang", "outwards", "drop")


def drive(pan: Pan, kinds: list[str], seed: int) -> tuple[Array, Array, list[Pan]]:
    """Govern one chunk of each kind: accelerations (n, 3), pan states (n, 6), and the pan after each chunk."""
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
    moved = integrate_pan(np.array(pan.state[:6]), u)
    assert np.abs(moved - states).max() <= TOLERANCE
    assert lengths(u).max() <= limits.acceleration + TOLERANCE
    assert u[:, 2].min() >= -0.8 * GRAVITY - TOLERANCE  # a fifth of the object's weight is kept
    change = np.diff(np.concatenate([[pan.state[6:]], u]), axis=0)
    assert lengths(change).max() <= limits.jerk * DT + TOLERANCE
    assert lengths(moved[:, :2]).max() <= limits.pan_reach + TOLERANCE
    assert lengths(moved[:, 3:]).max() <= limits.speed + TOLERANCE
    assert np.abs(moved[:, 2]).max() <= limits.height + TOLERANCE * (not limits.level)


@in_shards
@often
@given(pans(), st.lists(st.sampled_from(KINDS), min_size=CHUNKS, max_size=CHUNKS), st.integers(0, 2**32))
def test_limits_hold_whatever_is_asked_for_and_a_stop_leads_on(
    shard: int, pan: Pan, kinds: list[str], seed: int
) -> None:
    u, states, pans = drive(pan, kinds, seed)
    check_limits(pan, u, states)
    # From every sample the pan can come to rest: along the rest of its chunk and the stop that is kept.
    for index, after in enumerate(pans):
        stop = after.brake.accelerations(max(1, after.brake.samples))
        end = slice(0, (index + 1) * CHUNK)
        check_limits(pan, np.concatenate([u[end], stop]), np.concatenate([states[end], _led_to(after, stop)]))
        assert np.abs(_led_to(after, stop)[-1, 3:]).max() <= TOLERANCE
        assert not stop[-1].any()


def _led_to(pan: Pan, u: Array) -> Array:
    return integrate_pan(np.array(pan.state[:6]), u)


@in_shards
@often
@given(pans())
def test_brake_stops_within_its_limits_and_its_hull(shard: int, pan: Pan) -> None:
    brake = find_brake(pan.state, pan.limits)
    u = brake.accelerations(brake.samples)
    states = integrate_pan(np.array(pan.state[:6]), u)
    check_limits(pan, u, states)
    assert np.abs(states[-1, 3:]).max() <= TOLERANCE
    along, extent = np.concatenate([[pan.state[:6]], states]), stop_extent(pan.state, brake)
    assert lengths(along[:, :2]).max() <= extent.reach + 1e-12
    assert np.abs(along[:, 2]).max() <= extent.height + 1e-12
    assert lengths(along[:, 3:]).max() <= extent.speed + 1e-12
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


@in_shards
@often
@given(limits_drawn, st.floats(0.01, 3.0), st.floats(-1.0, 1.0), st.floats(0.0, 6.28))
def test_brake_on_a_line_is_nearly_as_short_as_the_least_time_stop(
    shard: int, limits: Limits, speed: float, share: float, angle: float
) -> None:
    x, y = math.cos(angle), math.sin(angle)
    u = share * limits.acceleration
    state = PanState(0.0, 0.0, 0.0, speed * x, speed * y, 0.0, u * x, u * y, 0.0)
    least = ruckig_time(state, limits)
    brake = find_brake(state, limits)
    # Never shorter than the least time, and longer only by the ramps, which go to the full braking acceleration and
    # back even where the stop is too short to reach it, and by whole samples.
    ramp = limits.acceleration / limits.jerk
    assert least - 2.0 * DT <= brake.samples * DT <= least + 3.0 * ramp + 5.0 * DT


@in_shards
@often
@given(pans(), st.integers(0, 2**32))
def test_what_keeps_the_limits_is_not_changed_in_a_single_bit(shard: int, pan: Pan, seed: int) -> None:
    rng = np.random.default_rng(seed)
    brake = find_brake(pan.state, pan.limits)
    nearly = brake.accelerations(CHUNK)[None] * rng.uniform(0.9, 1.0, (1, 1, 1))
    start = np.array(pan.state[6:])
    steps = np.diff(np.concatenate([start[None, None], nearly], axis=1), axis=1)
    states = integrate_pan(np.array(pan.state[:6]), nearly[0])
    end = PanState(*states[-1].tolist(), *nearly[0, -1].tolist())
    assume(lengths(steps).max() < pan.limits.jerk * DT)
    assume(lengths(states[:, :2]).max() < pan.limits.pan_reach)
    assume(lengths(states[:, 3:]).max() < pan.limits.speed)
    assume(pan.limits.level or np.abs(states[:, 2]).max() < pan.limits.height)
    assume(stop_extent(end, find_brake(end, pan.limits)).within(pan.limits))
    assert govern([pan], nearly)[0] is nearly


def test_batch_is_governed_as_each_one_is() -> None:
    rng = np.random.default_rng(4)
    pans_ = [
        Pan.at(
            PanState(0.01 * n, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0),
            Limits(0.1 + 0.01 * n, height=0.01 * (n % 3), acceleration=5.0 + n),
        )
        for n in range(8)
    ]
    asked = rng.standard_normal((8, CHUNK, 3)) * 8.0
    together = govern(pans_, asked)
    for row, pan in enumerate(pans_):
        alone = govern([pan], asked[row : row + 1])
        np.testing.assert_array_equal(alone[0][0], together[0][row])
        assert alone[2][0] == together[2][row]


def test_following_catches_up_as_fast_as_the_jerk_allows_and_then_is_exact() -> None:
    asked = np.tile([10.0, 0.0, 0.0], (1, 20, 1))
    asked[0, 12:] = [10.0, 0.5, 0.0]
    u = follow(np.zeros((1, 3)), asked, [Limits(jerk=3000.0)])
    np.testing.assert_allclose(u[0, :4, 0], [3.0, 6.0, 9.0, 10.0])
    np.testing.assert_array_equal(u[0, 4:], asked[0, 4:])
    assert asked[0, 0, 0] == 10.0


def test_a_level_pan_is_governed_in_its_plane_alone() -> None:
    rng = np.random.default_rng(9)
    for speed in (math.inf, 0.4):
        limits = Limits(0.06, speed=speed, acceleration=20.0, jerk=4_000.0)
        pans = [Pan.at_start(Start(), limits)] * 2
        for _ in range(8):
            asked = rng.standard_normal((1, CHUNK, 3)) * 30.0
            flat = asked * [1.0, 1.0, 0.0]
            u, states, pans = govern(pans, np.concatenate([asked, flat]))
            np.testing.assert_array_equal(u[0], u[1])
            for z in (u[..., 2], states[..., 2], states[..., 5], pans[0].brake.accelerations(50)[:, 2]):
                assert not z.any()
                assert not np.signbit(z).any()


def test_a_pan_that_is_asked_to_drop_keeps_a_fifth_of_the_weight() -> None:
    limits = Limits(height=0.1, acceleration=30.0, jerk=10_000.0)
    u, states, (after,) = govern([Pan.at_start(Start(), limits)], np.tile([0.0, 0.0, -30.0], (1, CHUNK, 1)))
    assert u[0, :, 2].min() >= -0.8 * GRAVITY
    assert u[0, :, 2].min() == pytest.approx(-0.8 * GRAVITY)
    assert states[0, :, 2].min() >= -0.1
    assert after.can_stop


def test_a_pan_uses_what_its_speed_and_height_allow() -> None:
    limits = Limits(1.0, height=0.1, speed=0.8, acceleration=20.0, jerk=10_000.0)
    pans, along, up = (
        [Pan.at_start(Start(), limits)] * 2,
        np.tile([20.0, 0.0, 0.0], (CHUNK, 1)),
        np.tile([0.0, 0.0, 20.0], (CHUNK, 1)),
    )
    fastest = highest = 0.0
    for _ in range(5):
        _, states, pans = govern(pans, np.stack([along, up]))
        fastest = max(fastest, states[0, :, 3].max())
        highest = max(highest, states[1, :, 2].max())
    assert 0.75 < fastest <= 0.8 + TOLERANCE
    assert 0.09 < highest <= 0.1 + TOLERANCE


def test_without_limits_nothing_is_changed() -> None:
    wild = np.full((1, CHUNK, 3), 1e6)
    pan = Pan.at_start(Start(), NO_LIMITS)
    assert govern([pan], wild)[0] is wild


@in_shards
@often
@given(pans(), st.floats(0.2, 2.0))
def test_a_gentle_stop_leaves_a_resting_object_at_rest_where_there_is_room(shard: int, pan: Pan, static: float) -> None:
    friction = Friction(static, 0.1)
    hold = gentle_strength(static, pan.limits)
    assume(math.hypot(*pan.state[6:]) <= hold)
    softest = find_brake(pan.state, pan.limits, hold)
    stop = gentle_stop(pan.state, pan.limits, friction)
    assert stop is not None  # the strongest one is in reach, by the way these pans are drawn
    u = stop.accelerations(stop.samples)
    check_limits(pan, u, integrate_pan(np.array(pan.state[:6]), u))
    if stop_extent(pan.state, softest).within(pan.limits):
        assert lengths(u).max() <= hold + TOLERANCE
        assert (lengths(u[:, :2]) <= GENTLE * static * (GRAVITY + u[:, 2]) + TOLERANCE).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"height": -0.01}, "limit height must be at least 0 m, which is a level pan, got -0.01 m"),
        ({"height": float("nan")}, "limit height must be at least 0 m, which is a level pan, got nan"),
        (
            {"height": 100.5},
            r"limit height must be at most 100 m, got 100.5 m: is it in millimetres\? Then give 0.1005 m",
        ),
        ({"height": 1e-9}, "limit height must be between 1e-06 and 1e.09 m, got 1e-09 m"),
        ({"height": math.inf}, "contradict each other: all but the speed must be finite, or none: .* height inf"),
        ({"speed": 0.0}, "limit speed must be greater than 0 m/s, got 0 m/s"),
        ({"speed": float("nan")}, "limit speed must be greater than 0 m/s, got nan m/s"),
        ({"speed": 1e10}, "limit speed must be between"),
        ({"speed": "fast"}, "limit speed must be a number, got 'fast'"),
        ({"pan_reach": 0.0}, "limit pan_reach must be greater than 0 m, got 0 m"),
        ({"acceleration": -1.0}, r"limit acceleration must be greater than 0 m/s\^2, got -1 m/s\^2"),
        ({"jerk": float("nan")}, r"limit jerk must be greater than 0 m/s\^3, got nan"),
        ({"pan_reach": "a"}, "limit pan_reach must be a number, got 'a'"),
        ({"jerk": math.inf}, "contradict each other: all but the speed must be finite, or none: .* jerk inf"),
        ({"pan_reach": math.inf}, "contradict each other: all but the speed must be finite, or none: pan_reach inf"),
        ({"pan_reach": 200.0}, r"must be at most 100 m, got 200 m: is it in millimetres\? Then give 0.2 m"),
        ({"pan_reach": -math.inf}, "limit pan_reach must be greater than 0 m, got -inf m"),
        ({"pan_reach": True}, "limit pan_reach must be a number, got True"),
        ({"acceleration": np.bool_(True)}, "limit acceleration must be a number, got "),
        ({"jerk": 1 + 0j}, "limit jerk must be a number, got "),
        ({"pan_reach": None}, "limit pan_reach must be a number, got None"),
        ({"pan_reach": 1e-200}, "limit pan_reach must be between 1e-06 and 1e.09 m, got 1e-200 m"),
        ({"acceleration": 1e200}, "limit acceleration must be between"),
        ({"jerk": 1e-310}, "limit jerk must be between"),
        (
            {"jerk": 0.1},
            r"contradict each other: at a jerk of 0.1 m/s\^3 the acceleration takes 300 s to come to 30",
        ),
    ],
)
def test_bad_limits_are_refused_with_the_numbers(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Limits(**values)


ENDS = [
    Limits(1e-6, acceleration=1e-6, jerk=1e-6),
    Limits(1e-6, acceleration=1e9, jerk=1e9),
    Limits(100.0, acceleration=10.0, jerk=1.0),
    Limits(1e-6, height=1e-6, speed=1e-6, acceleration=1e-6, jerk=1e-6),
    Limits(1e-6, height=1e-6, speed=1e9, acceleration=1e9, jerk=1e9),
    Limits(100.0, height=100.0, speed=1e-6, acceleration=10.0, jerk=1.0),
]


@pytest.mark.parametrize("limits", ENDS)
def test_limits_at_the_ends_of_their_ranges_can_be_kept(limits: Limits) -> None:
    pan = Pan.at(PanState(*[0.0] * 9), limits)
    u, states, _ = drive(pan, list(KINDS), 1)
    check_limits(pan, u, states)


def test_compiled_governor_does_the_same_to_the_last_bit() -> None:
    pytest.importorskip("numba")
    rng, limits = np.random.default_rng(0), [Limits(), Limits.named("panda"), Limits(height=0.1), Limits(0.05)]
    k = np.arange(58) / 58.0
    before, chunks, changed = [Pan.at_start(Start(), each) for each in limits], [], 0
    for _ in range(40):
        waves = rng.normal(0.0, rng.choice([1.0, 5.0, 15.0]), (4, 1, 3)) * np.sin(6.0 * k)[None, :, None]
        last = np.array([pan.state[6:] for pan in before])
        asked = last[:, None] * (1.0 - k)[None, :, None] ** 8 + waves * (1.0 - (1.0 - k) ** 8)[None, :, None]
        chunks.append((before, asked, govern(before, asked)))
        u, _, before = chunks[-1][2]
        changed += int((u != asked).any(axis=(1, 2)).sum())
    assert 10 < changed < 150
    try:
        run_compiled(True)
        again = [govern(pans, asked) for pans, asked, _ in chunks]
    finally:
        run_compiled(False)
    for (u, states, after), (_, _, plain) in zip(again, chunks, strict=True):
        np.testing.assert_array_equal(u, plain[0])
        np.testing.assert_array_equal(states, plain[1])
        assert after == plain[2]

"""A stream that is told what cameras and encoders see: late, noisy, seldom, false; and what it makes of it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.suite.false_reading import leaves
from benchmarks.suite.world import LawArm
from runtime import Friction, InputError, Limits, Planner, Start, Stream, StreamStatus
from runtime.arm.eyes import Camera, Eyes
from runtime.arm.interface import Measured, PanCommand
from runtime.physics.law import DT

Array = NDArray[np.float64]
Curve = Callable[..., Array]

LIMITS = Limits(0.05, acceleration=20.0, jerk=5000.0)
TOLERANCE = 1e-9
STEPS = int(os.environ.get("SLIDE_STEPS", "160"))
"""Steps that are fuzzed."""

FALSE_READINGS = int(os.environ.get("SLIDE_FALSE_READINGS", "12"))
"""Streams with one false reading each."""


@pytest.fixture(scope="module")
def shipped() -> Planner:
    return Planner()


def loop(samples: int = 1200, size: float = 0.03) -> Array:
    t = np.linspace(0.0, 2.0 * np.pi, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


class World:
    """A stream's world, sample by sample: an arm that obeys, maybe late, and an object by the law."""

    def __init__(self, stream: Stream, friction: Friction, late: int = 0) -> None:
        self.stream, self.arm = stream, LawArm(friction)
        self.measured: list[Measured] = [self.arm.reset(np.zeros(2))]
        self.u: list[Array] = [np.zeros(3)] * late
        self.late, self.chunk = late, np.zeros((0, 3))

    @property
    def now(self) -> int:
        return len(self.measured) - 1

    @property
    def pan(self) -> Array:
        return np.array([each.pan for each in self.measured])

    @property
    def sliding(self) -> Array:
        return np.array([each.sliding for each in self.measured])

    def step(self) -> StreamStatus:
        self.chunk = self.stream.step()
        self.u += list(self.chunk)
        return self.stream.status

    def tick(self) -> None:
        u = self.u[self.now]
        self.measured.append(self.arm.step(PanCommand(np.zeros(3), np.zeros(3), u)))

    def follow(self, eyes: Eyes, chunks: int, happen: Callable[[int], None] = lambda k: None) -> list[StreamStatus]:
        """Follow for some chunks with a camera, and encoders that tell every sample."""
        camera, statuses, count = Camera(eyes), [], self.stream.chunk
        for k in range(chunks * count):
            executed = k % count or count
            for frame in camera.look(k, self.measured[-1]):
                self.stream.see_object(frame.position, (k - frame.taken) * DT, executed)
            self.stream.see_pan(self.measured[-1].pan, 0.0, executed)
            if k % count == 0:
                statuses.append(self.step())
            self.tick()
            happen(k)
        return statuses

    def error(self, position: Array) -> float:
        samples = min(len(position), len(self.measured))
        off = self.sliding[:samples, :2] - position[:samples]
        return float(np.sqrt(np.mean(np.sum(off * off, axis=1))))

    def check(self, limits: Limits) -> None:
        u = np.array(self.u)
        assert np.linalg.norm(u, axis=1).max() <= limits.acceleration + TOLERANCE
        assert np.linalg.norm(np.diff(u, axis=0), axis=1).max() <= limits.jerk * DT + TOLERANCE
        assert np.hypot(*self.pan[:, :2].T).max() <= limits.pan_reach + TOLERANCE


@pytest.mark.parametrize(
    ("eyes", "told", "bound"),
    [
        (Eyes(60.0, 0.02), {}, 0.003),
        (Eyes(30.0, 0.05), {}, 0.0045),
        (Eyes(30.0, 0.05, 1e-3, 0.1), {"noise": 1e-3}, 0.006),
        (Eyes(60.0, 0.02, command_delay=0.02), {"command_delay": 0.02}, 0.004),
    ],
    ids=["60 Hz", "30 Hz", "noise and losses", "late arm"],
)
def test_camera_and_late_arm_follow_to_a_few_millimetres(
    shipped: Planner, eyes: Eyes, told: dict[str, float], bound: float
) -> None:
    position = loop()
    stream = shipped.stream(position, **told)  # type: ignore[arg-type]
    world = World(stream, Friction(0.5, 0.5), round(eyes.command_delay / DT))
    statuses = world.follow(eyes, 12)
    # Until the first picture comes, and where one is lost, a chunk may pass without any.
    assert set(statuses) <= {StreamStatus.FOLLOWING, StreamStatus.PREDICTED}
    assert statuses.count(StreamStatus.PREDICTED) <= 2
    assert world.error(position) < bound
    world.check(Limits())


def test_what_is_believed_is_told(shipped: Planner) -> None:
    stream = shipped.stream(loop())
    assert stream.object().sticks
    assert stream.delay is None
    np.testing.assert_array_equal(stream.object().position, np.zeros(2))
    world = World(stream, Friction(0.6, 0.45))
    world.follow(Eyes(100.0, 0.02), 9)
    seen = stream.object()
    assert math.dist(seen.position, world.sliding[-1, :2]) < 1e-3
    assert math.dist(seen.velocity, world.sliding[-1, 2:]) < 0.05
    assert seen.sticks is not seen.velocity.any()
    assert 0.0 < seen.age < 0.15
    assert 0.0 <= seen.position_error < 0.01
    np.testing.assert_allclose(stream.pan(), world.pan[-1], atol=1e-9)
    friction, kinetic, static = stream.friction
    assert friction.kinetic == pytest.approx(0.45, abs=0.02)
    assert kinetic[0] < 0.45 < kinetic[1]
    assert static[0] < 0.6 < static[1]
    assert stream.delay == pytest.approx(0.0, abs=1e-3)


def test_delay_is_found_and_used(shipped: Planner) -> None:
    position = loop()
    stream = shipped.stream(position, command_delay=None)
    world = World(stream, Friction(0.5, 0.5), 15)
    world.follow(Eyes(60.0, 0.02), 12)
    assert stream.delay == pytest.approx(0.015, abs=1e-3)
    world.check(Limits())


def test_object_that_sticks_is_no_dead_sensor(shipped: Planner) -> None:
    stream = shipped.stream(loop(size=0.05), Friction(1.0, 0.5))
    world = World(stream, Friction(1.5, 0.8))
    assert StreamStatus.BRAKING not in world.follow(Eyes(), 12)
    states = shipped.stream(loop(size=0.05), Friction(1.0, 0.5))
    world = World(states, Friction(1.5, 0.8))
    for _ in range(12):
        seen = world.measured[-states.chunk :]
        pan, sliding = np.array([each.pan for each in seen]), np.array([each.sliding for each in seen])
        world.u += list(states.step(pan, sliding) if world.now else states.step())
        assert states.status is not StreamStatus.BRAKING
        for _ in range(states.chunk):
            world.tick()


def test_frozen_camera_brakes_though_its_frames_are_stamped_anew(shipped: Planner) -> None:
    stream = shipped.stream(loop())
    world, last = World(stream, Friction()), np.zeros(2)
    for k in range(9 * stream.chunk):
        executed = k % stream.chunk or stream.chunk
        if k < 4 * stream.chunk:
            last = world.measured[-1].sliding[:2]
        if k % 20 == 0:
            stream.see_object(last, 0.0, executed)
        stream.see_pan(world.measured[-1].pan, 0.0, executed)
        if k % stream.chunk == 0:
            status = world.step()
        world.tick()
    assert status is StreamStatus.BRAKING
    world.check(Limits())


def test_nothing_told_is_predicted_for_a_while_and_then_braked_until_reset(shipped: Planner) -> None:
    stream = shipped.stream(loop())
    world = World(stream, Friction())
    world.follow(Eyes(), 3)
    statuses = []
    for _ in range(7):
        statuses.append(world.step())
        for _ in range(stream.chunk):
            world.tick()
    assert list(dict.fromkeys(statuses)) == [StreamStatus.FOLLOWING, StreamStatus.PREDICTED, StreamStatus.BRAKING]
    assert statuses[-2:] == [StreamStatus.BRAKING] * 2
    np.testing.assert_allclose(world.pan[-1, 3:], 0.0, atol=TOLERANCE)
    world.check(Limits())
    pan, sliding = world.measured[-1].pan, world.measured[-1].sliding
    stream.reset(Start(tuple(pan[:3]), object_position=tuple(sliding[:2])))
    assert world.step() is StreamStatus.FOLLOWING


def test_stop_that_the_stream_made_outside_is_a_start(planner: Planner) -> None:
    stream = planner.stream(loop(), limits=LIMITS)
    with pytest.raises(InputError, match=r"0.07 m from its centre, its reach is 0.05 m"):
        stream.reset(Start((0.07, 0.0)))
    world = World(stream, Friction())
    world.arm = LawArm(Friction(), start=np.array([0.07, 0.0, 0.0, 0.0, 0.0, 0.0]))
    world.measured = [world.arm.reset(np.zeros(2))]
    assert StreamStatus.OUTSIDE in world.follow(Eyes(), 3)
    for _ in range(30):
        world.step()
        for _ in range(stream.chunk):
            world.tick()
    assert stream.status is StreamStatus.BRAKING
    pan = world.measured[-1].pan
    assert np.hypot(*pan[:2]) > LIMITS.pan_reach
    np.testing.assert_allclose(pan[3:], 0.0, atol=TOLERANCE)
    stream.reset(Start(tuple(pan[:3])))
    assert stream.status is StreamStatus.OUTSIDE


def test_reach_opens_towards_the_pan_only_and_closes_behind_it(shipped: Planner) -> None:
    """Measured at 0.4 m of 0.2, it never crosses to the other side of the reach, and comes back for good."""
    stream = shipped.stream(loop(2400, 0.06))
    world = World(stream, Friction())
    world.follow(Eyes(), 2)
    world.arm.reset(np.zeros(2))
    moved = {"done": False}

    def carried_away(k: int) -> None:
        if not moved["done"] and k > 40:
            world.arm = LawArm(Friction(), start=np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0]))
            world.arm.reset(np.zeros(2))
            moved["done"] = True

    statuses = world.follow(Eyes(), 20, carried_away)
    assert StreamStatus.OUTSIDE in statuses
    assert statuses[-1] is not StreamStatus.OUTSIDE
    after = world.pan[2 * stream.chunk + 50 :]
    assert after[:, 0].min() > -0.2 - TOLERANCE
    assert after[:, 0].max() < 0.42
    assert np.hypot(*after[-stream.chunk :, :2].T).max() <= 0.2 + TOLERANCE


def test_one_false_reading_never_moves_the_pan_outside_its_reach(planner: Planner, shipped: Planner) -> None:
    for seed in range(FALSE_READINGS):
        assert not leaves(planner, seed)
        assert not leaves(shipped, seed)


@pytest.mark.parametrize("scale", [1e3, 1e2, -1e3])
def test_pan_in_another_unit_is_braked_and_raises_nothing(shipped: Planner, scale: float) -> None:
    stream = shipped.stream(loop())
    world, statuses = World(stream, Friction()), []
    for k in range(10 * stream.chunk):
        executed = k % stream.chunk or stream.chunk
        stream.see_pan(scale * world.measured[-1].pan, 0.0, executed)
        stream.see_object(world.measured[-1].sliding[:2], 0.0, executed)
        if k % stream.chunk == 0:
            statuses.append(world.step())
        world.tick()
    assert statuses[-1] in (StreamStatus.BRAKING, StreamStatus.OUTSIDE, StreamStatus.CONVINCED, StreamStatus.DOUBTING)
    u = np.array(world.u)
    assert np.linalg.norm(u, axis=1).max() <= Limits().acceleration + TOLERANCE


@pytest.mark.parametrize(
    ("told", "true"), [((1.0, 0.5), (0.1, 0.08)), ((1.0, 0.5), (1.5, 1.0)), ((0.3, 0.2), (1.5, 0.9))]
)
def test_friction_far_from_what_was_told_is_found(
    shipped: Planner, told: tuple[float, float], true: tuple[float, float]
) -> None:
    stream = shipped.stream(loop(), Friction(*told))
    World(stream, Friction(*true)).follow(Eyes(60.0, 0.02), 18)
    found = stream.friction
    assert found.friction.kinetic == pytest.approx(true[1], rel=0.15)
    assert found.kinetic[0] < found.friction.kinetic < found.kinetic[1]


def test_noise_never_opens_the_reach(planner: Planner) -> None:
    rng = np.random.default_rng(1)
    stream = planner.stream(loop(2000, 0.1), limits=LIMITS)
    world, spread = World(stream, Friction()), np.array([1e-3] * 3 + [1e-2] * 3)
    for k in range(20 * stream.chunk):
        executed = k % stream.chunk or stream.chunk
        stream.see_pan(world.measured[-1].pan + rng.normal(0.0, 1.0, 6) * spread, 0.0, executed)
        stream.see_object(world.measured[-1].sliding[:2], 0.0, executed)
        if k % stream.chunk == 0:
            world.step()
        world.tick()
    assert np.hypot(*world.pan[:, :2].T).max() < LIMITS.pan_reach + 5e-3


READINGS = st.one_of(
    st.none(),
    st.floats(allow_nan=True, allow_infinity=True, width=32),
    st.sampled_from([0.0, 1e-3, -1e-3, 0.05, 1e300, -1e300]),
)
HAPPENING = st.tuples(
    st.sampled_from(["true", "none", "false", "late", "twice", "future", "never"]),
    READINGS,
    st.floats(-0.2, 0.4),
    st.integers(0, 100),
)


@settings(
    max_examples=max(1, STEPS // 8), deadline=None, suppress_health_check=list(HealthCheck), derandomize=STEPS < 1000
)
@given(st.lists(st.tuples(HAPPENING, HAPPENING), min_size=8, max_size=8))
def test_whatever_is_told_nothing_is_raised_and_the_pan_keeps_its_limits(
    planner: Planner, happenings: list[tuple[Any, Any]]
) -> None:
    """Encoders may fall silent and tell one falsehood between two truths; of the object anything may be told."""
    stream = planner.stream(loop(500), limits=LIMITS)
    world = World(stream, Friction(0.7, 0.4))
    for (pan_kind, pan_value, pan_age, pan_at), (kind, value, age, at) in happenings:
        world.step()
        for k in range(1, stream.chunk + 1):
            world.tick()
            pan, sliding = world.measured[-1].pan, world.measured[-1].sliding[:2]
            if k == max(pan_at, 10):
                told: Any = {"none": None, "false": np.full(6, _number(pan_value)), "never": None}.get(pan_kind, pan)
                stream.see_pan(told, _number(pan_age) if pan_kind in ("late", "future") else 0.0, k)
            elif k in (5, 9, 100) and pan_kind != "never":
                stream.see_pan(pan, 0.0, k)
            if k == at:
                seen: Any = {"none": None, "false": np.full(2, _number(value))}.get(kind, sliding)
                for _ in range(2 if kind == "twice" else 1):
                    stream.see_object(seen, age if kind in ("late", "future") else 0.0, k)
            elif k == 50 and kind != "never":
                stream.see_object(sliding, 0.0, k)
        assert np.isfinite(stream.object().position).all()
        assert np.isfinite(stream.pan()).all()
    world.check(LIMITS)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda stream: stream.see_object([0.0, 0.0, 0.0]), r"position must be \(2,\) numbers, got float64 .* \(3,\)"),
        (lambda stream: stream.see_object("here"), "position must be .*got <U4"),
        (lambda stream: stream.see_object([0.0, 0.0], "old"), "age must be a number"),
        (lambda stream: stream.see_object([0.0, 0.0], 0.0, 101), "executed must be a whole number from 0 to 58"),
        (lambda stream: stream.see_pan(np.zeros(5)), r"state must be \(4,\) or \(6,\) numbers"),
        (lambda stream: stream.see_pan(np.zeros(6), None), "age must be a number"),
        (lambda stream: stream.see_pan(np.zeros(6), 0.0, 1.5), "executed must be a whole number"),
    ],
)
def test_reading_of_another_shape_or_type_is_an_input_error(
    shipped: Planner, call: Callable[[Any], None], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        call(shipped.stream(np.zeros((200, 2))))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"command_delay": -0.01}, r"command_delay must be between 0 and 0.1 s, got -0.01 s"),
        ({"command_delay": math.nan}, "command_delay: nan is not a finite number"),
        ({"noise": 0.0}, r"noise must be between 1e-05 and 0.1 m, got 0 m"),
    ],
)
def test_delay_and_noise_out_of_range_are_refused(shipped: Planner, options: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        shipped.stream(np.zeros((200, 2)), **options)


def test_encoder_that_says_the_same_for_ever_is_braked_and_raises_nothing(shipped: Planner) -> None:
    stream = shipped.stream(loop(2400))
    world = World(stream, Friction())
    for k in range(14 * stream.chunk):
        executed = k % stream.chunk or stream.chunk
        stream.see_pan(np.zeros(6), 0.0, executed)
        stream.see_object(world.measured[-1].sliding[:2], 0.0, executed)
        if k % stream.chunk == 0:
            status = world.step()
        world.tick()
    assert status is StreamStatus.BRAKING
    world.check(Limits())


def test_push_makes_a_step_due_before_the_chunk_has_ended(shipped: Planner) -> None:
    stream = shipped.stream(loop())
    world, due = World(stream, Friction()), False
    for k in range(3 * stream.chunk + 40):
        executed = k % stream.chunk or stream.chunk
        if k == 3 * stream.chunk:
            assert not due
        stream.see_object(world.measured[-1].sliding[:2] + (0.02 if k > 3 * stream.chunk else 0.0), 0.0, executed)
        stream.see_pan(world.measured[-1].pan, 0.0, executed)
        due = due or stream.due
        if k % stream.chunk == 0:
            world.step()
        world.tick()
    assert due
    assert stream.step(executed=40).shape == (stream.chunk, 3)
    assert not stream.due


def test_lost_frames_are_bridged_for_a_fifth_of_a_second_however_short_the_chunks_are(planner: Planner) -> None:
    stream = planner.stream(loop(), limits=Limits(0.05))
    world, statuses = World(stream, Friction()), []
    assert stream.chunk < 100
    world.follow(Eyes(1000.0), 2)
    begin = world.now
    while stream.status is not StreamStatus.BRAKING:
        statuses.append(world.step())
        for _ in range(stream.chunk):
            world.tick()
    chunks = -(-200 // stream.chunk)
    assert statuses == [StreamStatus.FOLLOWING, *[StreamStatus.PREDICTED] * (chunks - 1), StreamStatus.BRAKING]
    assert world.now - begin == (chunks + 1) * stream.chunk


def test_step_is_due_after_so_many_samples_if_that_is_asked_for(planner: Planner) -> None:
    stream = planner.stream(loop(), every=20)
    stream.step()
    for executed, due in ((10, False), (19, False), (20, True), (25, True)):
        stream.see_pan(stream.pan(executed), executed=executed)
        assert stream.due is due
    stream.step(executed=25)
    assert not stream.due
    with pytest.raises(InputError, match="every must be a whole number from 1 to"):
        planner.stream(loop(), every=0)

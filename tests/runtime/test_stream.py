"""The planner inside a controller: measured states, missing ones, the stop, and what never happens."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime import ConcurrentUseError, Friction, InputError, Limits, Planner, Start, Stream, StreamStatus
from runtime.limits import NO_LIMITS
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import lengths
from runtime.physics.pan import IN_PLANE, integrate_pan

from .conftest import WatchedBundle

Array = NDArray[np.float64]
Curve = Callable[..., Array]

LIMITS = Limits(0.1, acceleration=15.0, jerk=2000.0)
TOLERANCE = 1e-9
CHUNK = 58
HAPPENINGS = ("seen", "noisy", "none", "nan", "late", "huge")


class Plant:
    """Pan and object under the law: what a controller would measure if nothing disturbed them.

    Attributes:
        pan, sliding: (n, 6) and (n, 4) every state so far, the start C times before them.
        u: (n, 3) the acceleration that led to each.
    """

    def __init__(self, start: Start, mark: Array, friction: Friction | None = None) -> None:
        self.friction = friction or Friction()
        self.pan = np.tile(start.pan_state(), (CHUNK, 1))
        self.sliding = np.tile(start.object_state(mark), (CHUNK, 1))
        self.u = np.tile(start.pan_acceleration, (CHUNK, 1))

    def seen(self, late: int = 0) -> tuple[Array, Array]:
        """Return the C states of pan and object up to `late` samples ago."""
        end = len(self.pan) - late
        return self.pan[end - CHUNK : end], self.sliding[end - CHUNK : end]

    def move(self, u: Array) -> None:
        self.pan = np.concatenate([self.pan, integrate_pan(self.pan[-1], u)])
        self.sliding = np.concatenate([self.sliding, slide_one(self.sliding[-1], u, self.friction)])
        self.u = np.concatenate([self.u, u])

    def check(self, limits: Limits) -> None:
        assert lengths(self.u).max() <= limits.acceleration + TOLERANCE
        assert lengths(np.diff(self.u, axis=0)).max() <= limits.jerk * DT + TOLERANCE
        assert lengths(self.pan[:, :2]).max() <= limits.pan_reach + TOLERANCE
        assert lengths(self.pan[:, 3:]).max() <= limits.speed + TOLERANCE
        assert np.abs(self.pan[:, 2]).max() <= limits.height


@pytest.fixture
def stream(planner: Planner, make_curve: Curve) -> Stream:
    return planner.stream(make_curve(1000), limits=LIMITS)


@pytest.fixture
def plant(make_curve: Curve) -> Plant:
    return Plant(Start(), make_curve(1000)[0])


def test_stream_fed_with_the_prediction_gives_the_plan(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(5 * CHUNK)
    plan = planner.plan(position, limits=LIMITS, candidates=1)
    assert plan.quality.governed is not None
    assert plan.quality.governed.samples > 0
    stream, plant = planner.stream(position, limits=LIMITS), Plant(Start(), position[0])
    for _ in range(5):
        plant.move(stream.step(*plant.seen()))
        assert stream.status is StreamStatus.FOLLOWING
    np.testing.assert_array_equal(plant.u[CHUNK:], plan.pan_acceleration)


@pytest.mark.parametrize("late", [0, 1, 40, CHUNK])
def test_last_state_even_late_is_enough_where_nothing_disturbs(planner: Planner, make_curve: Curve, late: int) -> None:
    position = make_curve(5 * CHUNK)
    plan = planner.plan(position, limits=LIMITS, candidates=1)
    for rows in (slice(None), -1):
        stream, plant = planner.stream(position, limits=LIMITS), Plant(Start(), position[0])
        plant.move(stream.step())
        for _ in range(4):
            pan, sliding = plant.seen(late)
            plant.move(stream.step(pan[rows], sliding[rows], age=late * DT))
            assert stream.status is StreamStatus.FOLLOWING
        np.testing.assert_allclose(plant.u[CHUNK:], plan.pan_acceleration, atol=1e-3)


def test_stream_outlives_its_command(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(150)
    stream, plant = planner.stream(position, limits=LIMITS), Plant(Start(), position[0])
    for _ in range(8):
        plant.move(stream.step(*plant.seen()))
    plant.check(LIMITS)


def test_stream_reacts_to_what_is_measured(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(300)
    one, other = planner.stream(position), planner.stream(position)
    pan, sliding = Plant(Start(), position[0]).seen()
    first = one.step(pan, sliding)
    assert not np.array_equal(first, other.step(pan, sliding + np.array([0.01, 0.0, 0.0, 0.0])))


@pytest.mark.parametrize("missing", ["none", "nan", "absurd", "old", "future", "stale", "object only"])
def test_what_is_missing_is_predicted_for_a_fifth_of_a_second_and_then_braked_until_reset(
    stream: Stream, plant: Plant, missing: str
) -> None:
    def step() -> Array:
        pan, sliding = plant.seen()
        states: dict[str, tuple[Any, ...]] = {
            "none": (None, None),
            "nan": (np.full((CHUNK, 4), np.nan), sliding),
            "absurd": (pan * 0.0 + 1e308, sliding),
            "old": (pan, sliding, 0.2),
            "future": (pan, sliding, -0.1),
            "stale": last,
            "object only": (pan, None),
        }
        return stream.step(*states[missing])

    for _ in range(3):
        last = plant.seen()
        plant.move(stream.step(*last))
    for _ in range(200 // CHUNK):
        plant.move(step())
        assert stream.status is StreamStatus.PREDICTED
    for _ in range(4):
        plant.move(step())
        assert stream.status is StreamStatus.BRAKING
    np.testing.assert_allclose(plant.pan[-1, 3:], 0.0, atol=TOLERANCE)
    plant.move(stream.step(*plant.seen()))  # what is measured does not wake it
    assert stream.status is StreamStatus.BRAKING
    assert not plant.u[-CHUNK:].any()
    pan, sliding = plant.seen()
    stream.reset(Start(tuple(pan[-1, :2]), object_position=tuple(sliding[-1, :2])))
    plant.move(stream.step(pan, sliding))
    assert stream.status is StreamStatus.FOLLOWING
    plant.check(LIMITS)


def test_every_other_chunk_unseen_is_the_plan_where_nothing_disturbs(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(8 * CHUNK)
    plan = planner.plan(position, limits=LIMITS, candidates=1)
    stream, plant = planner.stream(position, limits=LIMITS), Plant(Start(), position[0])
    for n in range(8):
        plant.move(stream.step(*(plant.seen() if n % 2 else (None, None))))
        assert stream.status is not StreamStatus.BRAKING
    np.testing.assert_array_equal(plant.u[CHUNK:], plan.pan_acceleration)


def test_network_that_fails_is_braked_and_raises_nothing(
    watched: tuple[Planner, WatchedBundle], plant: Plant, make_curve: Curve
) -> None:
    planner, bundle = watched
    stream = planner.stream(make_curve(777), limits=LIMITS)
    for _ in range(2):
        plant.move(stream.step(*plant.seen()))
    bundle.broken.set()
    for _ in range(2):
        plant.move(stream.step(*plant.seen()))
        assert stream.status is StreamStatus.BRAKING
    np.testing.assert_allclose(plant.pan[-1, 3:], 0.0, atol=TOLERANCE)
    plant.check(LIMITS)


def test_pushed_pan_goes_no_farther_than_its_stop_needs_and_keeps_acceleration_and_jerk(
    stream: Stream, plant: Plant
) -> None:
    for _ in range(3):
        plant.move(stream.step(*plant.seen()))
    plant.pan[-1] = [0.12, 0.0, 0.0, 0.3, 0.0, 0.0]
    plant.move(stream.step(*plant.seen()))
    assert stream.status is StreamStatus.DOUBTING  # it may be a glitch
    x, _, _, vx, *_ = plant.pan[-1]
    before = len(plant.pan)
    for n in range(6):
        plant.move(stream.step(*plant.seen()))
        assert (stream.status is StreamStatus.OUTSIDE) or n > 0
    plant.check(Limits(x + vx * vx / 20.0 + abs(vx) * 0.02, acceleration=LIMITS.acceleration, jerk=LIMITS.jerk))
    assert plant.pan[before:, 0].min() > x - 2.0 * LIMITS.pan_reach  # nothing is won on the other side


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(st.tuples(st.sampled_from(HAPPENINGS), st.integers(0, 2**32)), max_size=8))
def test_limits_hold_whatever_is_measured(
    planner: Planner, make_curve: Curve, happenings: list[tuple[str, int]]
) -> None:
    position = make_curve(600)
    stream = planner.stream(position, limits=LIMITS)
    before, plant = np.zeros((1, 3)), Plant(Start(), position[0])
    for kind, seed in happenings:
        noise = np.random.default_rng(seed).standard_normal((2, CHUNK, 4)) * [0.001, 0.001, 0.01, 0.01]
        pan, sliding = plant.seen()
        states: dict[str, tuple[Any, ...]] = {
            "seen": (pan, sliding),
            "noisy": (pan[:, IN_PLANE] + noise[0], sliding + noise[1]),
            "none": (),
            "nan": (pan, sliding * np.nan),
            "late": (pan, sliding, 0.03),
            "huge": (pan[:, IN_PLANE] * 1e6 + noise[0] * 1e9, sliding + noise[1] * 1e9),
        }
        u = stream.step(*states[kind])
        assert lengths(u).max() <= LIMITS.acceleration + TOLERANCE
        assert lengths(np.diff(np.concatenate([before, u]), axis=0)).max() <= LIMITS.jerk * DT + TOLERANCE
        before = u[-1:]
        plant.move(u)


@pytest.mark.parametrize("name", ["panda", "fr3"])
def test_a_pan_that_lifts_keeps_its_limits_whatever_is_measured(planner: Planner, make_curve: Curve, name: str) -> None:
    rng, limits, position = np.random.default_rng(3), Limits.named(name), make_curve(900)
    highest = 0.0
    for _ in range(6):
        stream = planner.stream(position, Friction(0.4, 0.3), limits=limits)
        chunk = stream.chunk
        pan, sliding, last = np.zeros((chunk, 6)), np.tile([*position[0], 0.0, 0.0], (chunk, 1)), np.zeros((1, 3))
        for _ in range(14):
            noise = rng.standard_normal((2, 6)) * [0.002, 0.002, 0.002, 0.02, 0.02, 0.02]
            seen = [(pan + noise[0], sliding), (pan[-1], sliding[-1]), (None, sliding), (pan, None)][
                rng.choice(4, p=[0.6, 0.3, 0.05, 0.05])
            ]
            u = stream.step(*seen)
            stop = stream.brake(int(rng.integers(0, chunk + 1)))
            assert lengths(u).max() <= limits.acceleration + TOLERANCE
            assert lengths(np.diff(np.concatenate([last, u]), axis=0)).max() <= limits.jerk * DT + TOLERANCE
            assert min(u[:, 2].min(), stop[:, 2].min()) >= -0.8 * GRAVITY - TOLERANCE
            assert not stop[-1].any()
            pan, sliding, last = integrate_pan(pan[-1], u), slide_one(sliding[-1], u, Friction(0.4, 0.3)), u[-1:]
            # Noise of 2 mm and 20 mm/s, three times over, is what the pan can be farther or faster by than it was seen.
            assert lengths(pan[:, :2]).max() <= limits.pan_reach + 0.03
            assert np.abs(pan[:, 2]).max() <= limits.height + 0.03
            assert lengths(pan[:, 3:]).max() <= limits.speed + 0.2
            highest = max(highest, np.abs(pan[:, 2]).max())
    assert highest > 1e-4
    with pytest.raises(InputError, match=r"pan_state must be \(\d+, 6\) numbers"):
        stream.step(pan[:, IN_PLANE], sliding)


def test_brake_is_a_stop_from_any_sample(stream: Stream, plant: Plant) -> None:
    for n in range(4):
        plant.move(stream.step(*plant.seen()))
        for sample in (0, 1, 37, CHUNK - 1, CHUNK):
            u = stream.brake(sample)
            stopping = Plant(Start(), np.zeros(2))
            given_ = len(plant.u) - CHUNK + sample
            stopping.pan, stopping.sliding, stopping.u = plant.pan[:given_], plant.sliding[:given_], plant.u[:given_]
            stopping.move(u)
            stopping.check(LIMITS)
            np.testing.assert_allclose(stopping.pan[-1, 2:], 0.0, atol=TOLERANCE)
            assert not u[-1].any()
        assert n < 3 or np.hypot(*plant.u.T).max() > 1.0


def test_brake_changes_nothing(planner: Planner, make_curve: Curve) -> None:
    one, other = planner.stream(make_curve(300)), planner.stream(make_curve(300))
    one.brake(50)
    np.testing.assert_array_equal(one.step(), other.step())
    one.brake(50)
    np.testing.assert_array_equal(one.step(), other.step())


def test_retarget_follows_another_command_from_where_things_are(
    planner: Planner, make_curve: Curve, stream: Stream, plant: Plant
) -> None:
    for _ in range(3):
        plant.move(stream.step(*plant.seen()))
    other = make_curve(500, 9)
    stream.retarget(other)
    with pytest.raises(InputError, match="1 sample"):
        stream.retarget(np.zeros((1, 2)))
    pan, sliding = plant.seen()
    fresh = planner.stream(
        other,
        limits=LIMITS,
        start=Start(
            tuple(pan[-1, :3]), tuple(pan[-1, 3:]), tuple(plant.u[-1]), tuple(sliding[-1, :2]), tuple(sliding[-1, 2:])
        ),
    )
    for _ in range(3):
        u = stream.step(*plant.seen())
        np.testing.assert_array_equal(u, fresh.step(*plant.seen()))
        plant.move(u)
    plant.check(LIMITS)


@pytest.fixture(scope="module")
def shipped() -> Planner:
    return Planner()


def loop(turns: float, size: float = 0.03, samples: int = 1200) -> Array:
    """Return a closed figure, or part of one: at a whole turn it ends at speed, too."""
    t = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    return size * np.stack([1.0 - np.cos(t), np.sin(t) ** 3], axis=1)


def moved_to_rest(length: float) -> Array:
    t = np.linspace(0.0, 1.0, 777)[:, None]
    return t**3 * (10.0 - 15.0 * t + 6.0 * t * t) * np.array([length, 0.0])


def run(stream: Stream, plant: Plant, chunks: int, noise: float = 0.0) -> list[StreamStatus]:
    """Let a plant follow a stream by what is measured with some noise (m, and ten times that in m/s)."""
    rng, statuses = np.random.default_rng(1), []
    for _ in range(chunks):
        pan, sliding = plant.seen()
        spread = noise * np.array([1.0, 1.0, 10.0, 10.0])
        plant.move(
            stream.step(
                pan[:, IN_PLANE] + rng.normal(0.0, 1.0, sliding.shape) * spread,
                sliding + rng.normal(0.0, 1.0, sliding.shape) * spread,
            )
        )
        statuses.append(stream.status)
    return statuses


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize(
    "position",
    [
        np.zeros((600, 2)),
        moved_to_rest(0.1),
        loop(1.0),
        loop(0.6, 0.05),
        loop(1.3, 0.04, 1450),
        np.linspace([0, 0], [0.1, 0], 500),
    ],
    ids=["still", "move", "loop", "fast end", "odd length", "stroke at speed"],
)
def test_past_the_end_the_pan_rests_within_a_second_and_nothing_is_commanded_any_more(
    shipped: Planner, position: Array, noise: float
) -> None:
    stream, plant = shipped.stream(position), Plant(Start(), position[0])
    chunks = -(-len(position) // CHUNK)
    statuses = run(stream, plant, chunks + 1040, noise)
    assert StreamStatus.RESTING not in statuses[:chunks]
    plant.check(replace(Limits(), pan_reach=0.2 + 20.0 * noise))
    rest = plant.u[CHUNK + len(position) + 1000 :]
    assert len(rest) > 58_000
    assert not rest.any()
    np.testing.assert_allclose(plant.pan[-1, 3:], 0.0, atol=TOLERANCE)
    assert set(statuses[chunks + 10 :]) == {StreamStatus.RESTING}


def test_object_stays_on_its_mark_where_the_command_ends_with_a_rest(shipped: Planner) -> None:
    move = moved_to_rest(0.1)
    position = np.concatenate([move, np.repeat(move[-1:], 200, axis=0)])
    stream, plant = shipped.stream(position), Plant(Start(), position[0])
    run(stream, plant, 30)
    assert math.dist(plant.sliding[-1, :2], position[-1]) < 0.005


@pytest.mark.parametrize("push", [(0.03, 0.0), (-0.02, 0.05)])
def test_object_that_is_moved_at_rest_is_brought_back_and_the_pan_rests_again(
    shipped: Planner, push: tuple[float, float]
) -> None:
    position = loop(1.0)
    stream, plant = shipped.stream(position), Plant(Start(), position[0])
    run(stream, plant, 40)
    assert not plant.u[-CHUNK:].any()
    plant.sliding[-2:, :2] += push
    statuses = run(stream, plant, 100)
    assert statuses[0] is StreamStatus.FOLLOWING
    assert not plant.u[-50 * CHUNK :].any()
    assert math.dist(plant.sliding[-1, :2], position[-1]) < 0.01
    plant.check(Limits())


def test_tolerance_is_how_far_the_object_may_be_moved(shipped: Planner) -> None:
    position = np.zeros((300, 2))
    for tolerance, acts in ((0.05, False), (0.02, True)):
        stream, plant = shipped.stream(position, tolerance=tolerance), Plant(Start(), position[0])
        run(stream, plant, 10)
        plant.sliding[-1, 0] += 0.03
        assert (StreamStatus.FOLLOWING in run(stream, plant, 8)) is acts
    with pytest.raises(InputError, match="tolerance must be greater than 0 m, got -1 m"):
        shipped.stream(position, tolerance=-1.0)


def test_object_that_has_left_the_pan_is_not_shaken_after(shipped: Planner) -> None:
    stream, plant = shipped.stream(np.zeros((300, 2))), Plant(Start(), np.zeros(2))
    run(stream, plant, 10)
    plant.sliding[-1, 0] = 0.3
    assert set(run(stream, plant, 20)) == {StreamStatus.RESTING}
    assert not plant.u[-20 * CHUNK :].any()


def test_object_that_cannot_be_brought_back_does_not_keep_the_pan_busy(shipped: Planner) -> None:
    stream, plant = shipped.stream(np.zeros((300, 2))), Plant(Start(), np.zeros(2), Friction(5.0, 5.0))
    run(stream, plant, 10)
    plant.sliding[-1, 0] += 0.03
    statuses = run(stream, plant, 80)
    assert StreamStatus.FOLLOWING in statuses
    assert not plant.u[-30 * CHUNK :].any()
    plant.check(Limits())


def test_stream_at_rest_takes_another_command_and_another_start(shipped: Planner) -> None:
    stream, plant = shipped.stream(moved_to_rest(0.05)), Plant(Start(), np.zeros(2))
    run(stream, plant, 20)
    other = moved_to_rest(-0.04) + plant.sliding[-1, :2]
    stream.retarget(other)
    assert set(run(stream, plant, 8)) == {StreamStatus.FOLLOWING}
    run(stream, plant, 40)
    assert math.dist(plant.sliding[-1, :2], other[-1]) < 0.01
    stream.reset(Start((0.02, 0.0), (0.3, 0.0)))
    u = np.concatenate([stream.step() for _ in range(3)])
    assert stream.status is StreamStatus.RESTING  # there is nothing left of the command: it comes to rest from there
    np.testing.assert_allclose(integrate_pan(np.array([0.02, 0.0, 0.0, 0.3, 0.0, 0.0]), u)[-1, 3:], 0.0, atol=TOLERANCE)


def test_second_thread_is_refused(stream: Stream) -> None:
    entered, leave = threading.Event(), threading.Event()
    refused: list[Exception] = []

    class Slow:
        """A state that takes its time to be read."""

        def __array__(self, *_: Any, **__: Any) -> Array:
            entered.set()
            assert leave.wait(10.0)
            return np.zeros((CHUNK, 4))

    worker = threading.Thread(target=lambda: stream.step(Slow()))  # type: ignore[arg-type]
    worker.start()
    assert entered.wait(10.0)
    for call in (stream.step, lambda: stream.brake(0), lambda: stream.reset(Start())):
        try:
            call()
        except ConcurrentUseError as error:
            refused.append(error)
    leave.set()
    worker.join()
    assert [str(error).split(";")[0] for error in refused] == ["the stream is in use by another thread"] * 3
    stream.step(np.zeros((CHUNK, 4)))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (
            np.zeros((57, 4)),
            r"\(58, 4\).* numbers, the last states, or \(4,\).*, .* got float64 of the shape \(57, 4\)",
        ),
        (np.zeros(3), r"got float64 of the shape \(3,\)"),
        (np.full((CHUNK, 4), "a"), "got <U1"),
        ([[0.0], [0.0, 0.0]], "inhomogeneous"),
    ],
)
def test_state_of_another_shape_is_an_input_error_and_changes_nothing(planner: Planner, bad: Any, message: str) -> None:
    stream, untouched = planner.stream(np.zeros((200, 2))), planner.stream(np.zeros((200, 2)))
    rest = np.zeros((CHUNK, 4))
    with pytest.raises(InputError, match=f"pan_state.*{message}"):
        stream.step(bad, rest)
    with pytest.raises(InputError, match=f"object_state.*{message}"):
        stream.step(rest, bad)
    with pytest.raises(InputError, match="age must be a number"):
        stream.step(rest, rest, "now")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="whole number from 0 to 58, got 101"):
        stream.brake(101)
    np.testing.assert_array_equal(stream.step(rest, rest), untouched.step(rest, rest))


def test_stream_without_limits_is_refused(planner: Planner) -> None:
    with pytest.raises(InputError, match="finite limits"):
        planner.stream(np.zeros((200, 2)), limits=NO_LIMITS)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (Start(pan_position=(0.3, 0.0)), r"the pan is 0.3 m from its centre, its reach is 0.2 m"),
        (Start(pan_position=(0.19, 0.0), pan_velocity=(1.0, 0.0)), "0.19 m from its centre at 1 m/s, cannot be sure"),
        (Start(pan_velocity=(0.0, 900.0)), r"too fast to stop .* at 900 m/s it needs 1.35e\+04 m within 30 m/s\^2"),
        (Start(pan_acceleration=(0.0, 31.0)), r"pan acceleration 31 m/s\^2 exceeds the limit, 30 m/s\^2"),
        (
            Start(pan_position=(0.0, 0.0, 0.1)),
            "the pan is level, its height is 0 m, and it would begin at z 0.1 m, 0 m/s",
        ),
        (Start(pan_velocity=(0.0, 0.0, 0.1)), "the pan is level, .* at z 0 m, 0.1 m/s"),
        (Start(pan_acceleration=(0.0, 0.0, 0.1)), r"the pan is level, .* 0 m/s, 0.1 m/s\^2"),
    ],
)
def test_start_that_cannot_keep_the_limits_is_refused_with_the_numbers(
    planner: Planner, start: Start, message: str
) -> None:
    for use in (planner.plan, planner.stream):
        with pytest.raises(InputError, match=message):
            use(np.zeros((200, 2)), limits=Limits(), start=start)


def test_start_must_be_finite_pairs() -> None:
    with pytest.raises(InputError, match=r"start pan_velocity\[1\]: nan is not a finite number"):
        Start(pan_velocity=(0.0, float("nan")))
    with pytest.raises(InputError, match=r"start object_velocity must be between -1000 and 1000, got \[1e\+200, 0\]"):
        Start(object_velocity=(1e200, 0.0))
    with pytest.raises(InputError, match="start pan_position must be a pair or a triple of numbers"):
        Start(pan_position=(0.0,))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="start object_position must be a pair"):
        Start(object_position=(0.0, 0.0, 0.0))  # type: ignore[arg-type]


def test_plan_begins_where_it_is_told(planner: Planner, make_curve: Curve) -> None:
    start = Start((0.01, -0.02), (0.1, 0.2), (1.0, 0.5), (0.03, 0.0), (0.0, -0.2))
    plan = planner.plan(make_curve(300), limits=LIMITS, start=start, candidates=1)
    np.testing.assert_array_equal(plan.pan_position[0], start.pan_position)
    np.testing.assert_array_equal(plan.pan_velocity[0], start.pan_velocity)
    np.testing.assert_array_equal(plan.object_position[0], start.object_position)
    np.testing.assert_array_equal(plan.object_velocity[0], start.object_velocity)
    assert np.linalg.norm(plan.pan_acceleration[0] - start.pan_acceleration) <= LIMITS.jerk * DT + TOLERANCE
    np.testing.assert_array_equal(plan.replay()[:, :2], plan.object_position)
    assert min(value for value in plan.quality.margins.values() if value is not None) > -TOLERANCE
    batch = planner.plan_batch([make_curve(300), make_curve(300)], limits=LIMITS, start=[start, Start()])
    np.testing.assert_allclose(batch[0].object_position, plan.object_position, atol=1e-6)

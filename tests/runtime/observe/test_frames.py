"""The observer of the object: late, noisy, lost, doubled and false frames, and the friction they tell of."""

from __future__ import annotations

import numpy as np
import pytest

from runtime import Friction
from runtime.observe.frames import Verdict, Watch
from runtime.observe.sliding import Frame

from .conftest import Array, World

ACCELERATION = 30.0


def watched(world: World, told: Friction, every: int, noise: float = 0.0, seed: int = 0, until: int = 1200) -> Watch:
    rng, watch = np.random.default_rng(seed), Watch.begin(np.zeros(4), told, max(noise, 2e-4))
    for at in range(every, until + 1, every):
        frame = Frame(at, world.sliding[at, :2] + rng.normal(0.0, noise, 2))
        watch, _ = watch.see(frame, world.past(at), ACCELERATION)
    return watch


@pytest.mark.parametrize("seed", range(3))
def test_undisturbed_object_is_known_exactly(seed: int) -> None:
    world = World.shaken(Friction(0.8, 0.4), seed=seed)
    watch = watched(world, Friction(0.8, 0.4), 33)
    np.testing.assert_allclose(watch.now(world.past(1200))[-1], world.sliding[-1], atol=1e-9)
    assert not watch.last.event


@pytest.mark.parametrize("seed", range(4))
def test_friction_is_found_and_its_intervals_hold_it(seed: int) -> None:
    true = Friction(0.55, 0.45)
    world = World.shaken(true, seed=seed)
    watch = watched(world, Friction(1.0, 0.5), 10, 1e-3, seed)
    assert watch.last.friction.kinetic == pytest.approx(true.kinetic, rel=0.05)
    low, high = watch.last.kinetic_interval
    assert low < true.kinetic < high
    low, high = watch.last.static_interval
    assert low < true.static < high
    assert np.hypot(*(watch.last.state - world.sliding[1200])[:2]) < 2e-3


def test_object_that_sticks_has_no_velocity() -> None:
    world = World.shaken(Friction(5.0, 4.0))
    watch = watched(world, Friction(5.0, 4.0), 33, 1e-3)
    assert not watch.last.state[2:].any()
    assert not watch.last.spread[2:4, 2:4].any()


def frames(world: World, every: int = 33, until: int = 594) -> list[Frame]:
    return [Frame(at, world.sliding[at, :2]) for at in range(every, until + 1, every)]


def see_all(watch: Watch, seen: list[Frame], world: World, until: int = 594) -> tuple[Watch, list[Verdict]]:
    verdicts = []
    for frame in seen:
        watch, verdict = watch.see(frame, world.past(until), ACCELERATION)
        verdicts.append(verdict)
    return watch, verdicts


def test_frames_out_of_order_give_the_same_as_in_order() -> None:
    world, told = World.shaken(Friction(0.6, 0.4)), Friction()
    seen = frames(world)
    mixed = [*seen[:8], seen[10], seen[8], seen[11], seen[9], *seen[12:]]
    one, _ = see_all(Watch.begin(np.zeros(4), told, 1e-3), seen, world)
    other, verdicts = see_all(Watch.begin(np.zeros(4), told, 1e-3), mixed, world)
    np.testing.assert_array_equal(one.last.state, other.last.state)
    np.testing.assert_array_equal(one.last.spread, other.last.spread)
    assert set(verdicts) == {Verdict.TAKEN}


def test_frame_that_comes_twice_or_is_from_the_future_or_too_old_is_ignored() -> None:
    world = World.shaken(Friction(0.6, 0.4))
    watch, _ = see_all(Watch.begin(np.zeros(4), Friction(), 1e-3), frames(world), world)
    for frame in (frames(world)[-1], Frame(595, np.zeros(2)), Frame(-5, np.zeros(2)), Frame(50, np.zeros(2))):
        same, verdict = watch.see(frame, world.past(594), ACCELERATION)
        assert verdict is Verdict.IGNORED
        assert same is watch


@pytest.mark.parametrize("where", [(0.2, 0.0), (-50.0, 3.0), (1e3, 1e3)])
def test_one_false_frame_is_bridged(where: tuple[float, float]) -> None:
    world, told = World.shaken(Friction(0.6, 0.4)), Friction(0.6, 0.4)
    seen = frames(world)
    seen[10] = seen[10]._replace(position=np.array(where))
    watch, verdicts = see_all(Watch.begin(np.zeros(4), told, 1e-3), seen, world)
    assert verdicts.count(Verdict.DOUBTED) == 1
    np.testing.assert_allclose(watch.now(world.past(594))[-1], world.sliding[594], atol=1e-9)


def test_what_cannot_be_but_lasts_is_believed() -> None:
    world, told = World.shaken(Friction(0.6, 0.4)), Friction(0.6, 0.4)
    moved: Array = world.sliding.copy()
    moved[400:, :2] += [0.1, 0.0]
    seen = [Frame(at, moved[at, :2]) for at in range(10, 595, 10)]
    watch, verdicts = see_all(Watch.begin(np.zeros(4), told, 1e-3), seen, world)
    assert verdicts.count(Verdict.DOUBTED) == 1
    assert verdicts.count(Verdict.BELIEVED) == 1
    np.testing.assert_allclose(watch.now(world.past(594))[-1, :2], moved[594, :2], atol=2e-3)


def test_push_within_reason_is_an_event_and_believed_at_once() -> None:
    world, told = World.shaken(Friction(0.6, 0.4)), Friction(0.6, 0.4)
    moved: Array = world.sliding.copy()
    moved[400:, :2] += [0.02, 0.0]
    watch = Watch.begin(np.zeros(4), told, 1e-3)
    for at in range(33, 430, 33):
        watch, verdict = watch.see(Frame(at, moved[at, :2]), world.past(at), ACCELERATION)
        assert watch.last.event is (at == 429)
    assert verdict is Verdict.TAKEN
    np.testing.assert_allclose(watch.last.state[:2], moved[429, :2], atol=1e-3)


def test_object_that_is_not_seen_for_long_is_carried_along_by_the_law() -> None:
    world, told = World.shaken(Friction(0.6, 0.4), samples=2000), Friction(0.6, 0.4)
    watch = Watch.begin(np.zeros(4), told, 1e-3)
    for at in range(100, 2001, 100):
        watch = watch.carried(world.past(at))
        np.testing.assert_allclose(watch.now(world.past(at))[-1], world.sliding[at], atol=1e-9)

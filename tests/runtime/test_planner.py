from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import BundleError, Command, Friction, InputError, Limits, Plan, Planner, Sizes, Start, Status
from runtime.commands.reading import Reading
from runtime.compilation import compile_law
from runtime.network.decode import decode
from runtime.network.job import Job
from runtime.network.units import (
    AHEAD_ROWS,
    CHUNK,
    CONDITIONS,
    ENCODER_CHUNK,
    ENCODER_ROWS,
    SEEN_ROWS,
    UNREAD,
    WINDOW,
)
from runtime.physics.law import BATCHED_FROM, slide_one
from runtime.physics.pan import integrate_pan

from .conftest import WatchedBundle

Curve = Callable[..., NDArray[np.float64]]
MakeBundle = Callable[..., Path]
Watched = tuple[Planner, WatchedBundle]

UNIT = Limits(0.2, acceleration=25.0, jerk=20_000.0)
"""Limits of a pan whose units are the network's own: a chunk is CHUNK milliseconds."""

ARRAYS = ("pan_acceleration", "pan_velocity", "pan_position", "object_velocity", "object_position")


def distance(one: Plan, other: Plan) -> float:
    """Return the largest distance between the objects of two plans (m)."""
    return float(np.abs(one.object_position - other.object_position).max())


def test_plan_starts_at_the_commands_start_at_rest(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(300)
    plan = planner.plan(position)
    np.testing.assert_array_equal(plan.command_position, position)
    np.testing.assert_array_equal(plan.object_position[0], position[0])
    for array in (plan.object_velocity, plan.pan_position, plan.pan_velocity):
        assert not array[0].any()
    assert (plan.model_name, plan.model_sha256, plan.dt) == ("tiny", planner.bundle.sha256, 0.001)


@pytest.mark.parametrize("samples", [2, 99, 100, 101, 777, 1200])
def test_plan_obeys_the_law_and_the_double_integrator(planner: Planner, make_curve: Curve, samples: int) -> None:
    plan = planner.plan(make_curve(samples))
    for name in ARRAYS:
        assert getattr(plan, name).shape == (samples, 3 if name.startswith("pan_") else 2)
    start = np.concatenate([plan.object_position[0], [0.0, 0.0]])
    states = slide_one(start, plan.pan_acceleration, plan.friction)[:-1]
    np.testing.assert_array_equal(plan.object_position[1:], states[:, :2])
    np.testing.assert_array_equal(plan.object_velocity[1:], states[:, 2:])
    np.testing.assert_array_equal(plan.replay(), np.hstack([plan.object_position, plan.object_velocity]))
    pan = integrate_pan(np.zeros(6), plan.pan_acceleration)[:-1]
    np.testing.assert_allclose(plan.pan_position[1:], pan[:, :3], atol=1e-12)
    np.testing.assert_allclose(plan.pan_velocity[1:], pan[:, 3:], atol=1e-12)


def test_tiny_network_makes_the_object_stick_and_slide(planner: Planner, make_curve: Curve) -> None:
    assert 0.1 < planner.plan(make_curve(1200)).quality.sliding_share < 0.9  # or the tests above show little


def test_network_reads_the_command_and_its_own_motion_as_documented(watched: Watched, make_curve: Curve) -> None:
    _, bundle = watched
    command = Command(make_curve(250))
    motion, _ = decode(bundle, [Job(command, Friction(), UNIT, Start())])

    origin = command.position[0]
    rows = np.hstack([command.position, command.velocity])
    held = np.vstack([rows, np.tile([*command.position[-1], 0.0, 0.0], (500, 1))])
    (read,) = bundle.encoded[-1]
    for n, chunk in enumerate(read):
        seen = held[ENCODER_CHUNK * n + np.array(ENCODER_ROWS)] - [*origin, 0.0, 0.0]
        np.testing.assert_allclose(chunk[:-CONDITIONS], seen.ravel(), atol=1e-6)
    assert len(read) == 2
    states = np.hstack([motion.pan[0], motion.sliding[0]])
    observed = bundle.observed[-4:]
    for n, (observation,) in enumerate(observed):
        now = CHUNK * n
        here = np.array([0.0] * 6 + [*command.position[min(now, 249)], 0.0, 0.0])
        past = np.maximum(now - CHUNK + 1 + np.array(SEEN_ROWS), 0)
        ahead = held[now + np.array(AHEAD_ROWS)] - [*command.position[min(now, 249)], 0.0, 0.0]
        last = motion.acceleration[0, now - 1] if n else np.zeros(3)
        expected = np.concatenate([(states[past] - here).ravel(), last, ahead.ravel()])
        np.testing.assert_allclose(observation[: len(expected)], expected, atol=2e-6)
        np.testing.assert_array_equal(observation[len(expected) : -1], read[0][-CONDITIONS:])
        assert observation[-1] == 1.0


def test_padding_holds_the_last_position_at_rest(planner: Planner, make_curve: Curve) -> None:
    # To the decoder a command that ends early, and one that goes on resting, are the same if both encode the same.
    position = make_curve(777)
    position[-3:] = position[-4]  # so that the velocity at the end is zero with and without more rest
    resting = np.vstack([position, np.tile(position[-1], (23, 1))])
    short, long = planner.plan(position), planner.plan(resting)
    assert len(short) == 777
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(short, name), getattr(long, name)[:777])


def test_planning_does_not_depend_on_where_the_command_starts(planner: Planner, make_curve: Curve) -> None:
    shift = np.array([0.31, -0.17])
    plan, shifted = planner.plan(make_curve(777)), planner.plan(make_curve(777) + shift)
    np.testing.assert_allclose(shifted.pan_acceleration, plan.pan_acceleration, atol=1e-3)
    np.testing.assert_allclose(shifted.object_position, plan.object_position + shift, atol=1e-6)


def test_long_command_is_planned_by_windows_as_its_parts_are(planner: Planner, make_curve: Curve) -> None:
    second = (WINDOW - UNREAD) * ENCODER_CHUNK
    position = make_curve(4000)
    whole, part = (
        decode(planner.bundle, [Job(Command(each), Friction(), UNIT, Start())])[0].one(0)
        for each in (position, position[: WINDOW * ENCODER_CHUNK])
    )
    # Not to the last bit: where the short command ends, its last velocity is a one-sided difference.
    np.testing.assert_allclose(whole.acceleration[:second], part.acceleration[:second], atol=1e-3)
    assert np.abs(whole.acceleration[second : second + 100] - part.acceleration[second : second + 100]).max() > 1e-3
    stream = planner.stream(position, limits=UNIT)
    u, pan, sliding = [stream.step()], whole.pan, whole.sliding
    for n in range(1, 50):
        u.append(stream.step(pan[CHUNK * n], sliding[CHUNK * n]))
    np.testing.assert_allclose(np.concatenate(u), whole.acceleration[: 50 * CHUNK], atol=1e-6)


def test_windows_of_a_long_command_read_no_more_than_was_trained_on(watched: Watched, make_curve: Curve) -> None:
    planner, bundle = watched
    plan = planner.plan(make_curve(60_000))
    read = [command.shape[1] for command in bundle.encoded]
    assert set(read[:-1]) == {WINDOW}
    assert read[-1] <= WINDOW
    assert len(plan) == 60_000
    assert min(value for value in plan.quality.margins.values() if value is not None) > -1e-9


def test_friction_is_the_manifests_unless_given(planner: Planner, make_curve: Curve) -> None:
    position = make_curve(600)
    assert planner.plan(position).friction == Friction(1.0, 0.5)
    assert distance(planner.plan(position), planner.plan(position, Friction(1.0, 0.5))) == 0.0
    slippery = planner.plan(position, friction=Friction(0.5, 0.3))
    assert slippery.friction == Friction(0.5, 0.3)
    assert distance(slippery, planner.plan(position)) > 1e-3
    np.testing.assert_array_equal(slippery.replay()[:, :2], slippery.object_position)


@pytest.mark.parametrize("count", [1, 3, BATCHED_FROM + 4])
def test_batch_gives_the_lone_plans(planner: Planner, make_curve: Curve, count: int) -> None:
    lengths = [500, 777, 800, 500][:count] + [800] * (count - 4)
    commands = [make_curve(samples, seed) for seed, samples in enumerate(lengths)]
    frictions = [Friction(1.0, 0.5), Friction(0.7, 0.4), Friction(1.2, 0.6)]
    each = [frictions[index % 3] for index in range(count)]
    plans = planner.plan_batch(commands, friction=each)
    assert [len(plan) for plan in plans] == lengths
    for plan, command, friction in zip(plans, commands, each, strict=True):
        assert plan.friction == friction
        assert distance(plan, planner.plan(command, friction, candidates=1)) < 1e-6
        assert all(getattr(plan, name).base is None for name in ARRAYS)  # it does not keep the batch alive
        np.testing.assert_allclose(plan.replay()[:, :2], plan.object_position, atol=1e-12)


def test_batch_by_the_compiled_law_is_the_same_to_the_last_bit(planner: Planner, make_curve: Curve) -> None:
    pytest.importorskip("numba")
    commands = [make_curve(300, seed) for seed in range(BATCHED_FROM + 4)]
    plain = planner.plan_batch(commands)
    try:
        assert compile_law()
        compiled = planner.plan_batch(commands)
    finally:
        assert not compile_law(False)
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_array_equal(one.object_position, other.object_position)


def test_batch_takes_commands_arrays_and_none(planner: Planner, make_curve: Curve) -> None:
    assert planner.plan_batch([]) == []
    position = make_curve(200)
    plans = planner.plan_batch([Command(position), position, position.tolist()])
    assert all(distance(plan, plans[0]) < 1e-6 for plan in plans)
    assert planner.plan_batch([position], friction=Friction(0.8, 0.4))[0].friction == Friction(0.8, 0.4)


def test_planner_plans_from_several_threads(planner: Planner, make_curve: Curve) -> None:
    commands = [make_curve(400, seed) for seed in range(12)]
    with ThreadPoolExecutor(4) as threads:
        plans = list(threads.map(planner.plan, commands))
    for plan, command in zip(plans, commands, strict=True):
        np.testing.assert_array_equal(plan.pan_acceleration, planner.plan(command).pan_acceleration)


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (np.zeros((300, 3)), r"shape \(K, 2\), got \(300, 3\)"),
        (np.zeros((1, 2)), "1 sample, at least 2"),
        ([[0.0, 0.0], [0.0]], r"position\[1\] must be a pair"),
        (np.full((5, 2), np.nan), r"position\[0\], column x: nan"),
        ([["a", "b"], ["c", "d"]], "must be a number, got 'a'"),
        (None, "must be a list of pairs"),
    ],
)
def test_bad_position_is_an_input_error(planner: Planner, position: Any, message: str) -> None:
    for attempt in (planner.plan, planner.stream):
        with pytest.raises(InputError, match=message):
            attempt(position)
    with pytest.raises(InputError, match=f"command 1: .*{message}"):
        planner.plan_batch([np.zeros((5, 2)), position])


def test_bad_friction_is_an_input_error(planner: Planner) -> None:
    rest: Any = np.zeros((5, 2))
    wrong: Any = (1.0, 0.5)
    with pytest.raises(InputError, match="friction must be a Friction"):
        planner.plan(rest, wrong)
    with pytest.raises(InputError, match="friction must be a Friction"):
        planner.plan_batch([rest], 1.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="friction must be one for all or one for each: 2 for 1"):
        planner.plan_batch([rest], [Friction(), Friction()])


def test_not_finite_acceleration_is_an_error_and_no_plan(
    make_bundle: MakeBundle, make_decoder_step: Callable[..., bytes], tmp_path: Path
) -> None:
    broken = make_decoder_step(scale=float("nan"))
    with pytest.raises(BundleError, match="bundle 'tiny' gave no finite number at sample 0"):
        Planner(make_bundle(tmp_path, models={"decoder_step": broken}))


def test_limits_sizes_and_ranges_come_from_the_manifest(
    make_bundle: MakeBundle, make_curve: Curve, tmp_path: Path
) -> None:
    limits = Limits(0.02, height=0.01, acceleration=20.0, jerk=500.0)
    planner = Planner(make_bundle(tmp_path / "a", limits=limits.to_dict()))
    quality = planner.plan(make_curve(600)).quality
    assert quality.governed is not None
    assert quality.governed.samples > 0
    assert quality.limits == limits.to_dict()
    trained_on = planner.bundle.manifest.trained_on | {
        "static": [1, 1],
        "kinetic": [0.5, 0.5],
        "reach": [0, 0.05],
        "speed": [0, 0.05],
        "samples": [700, 900],
        "start_speed": [0, 0.1],
        "corner": [0, 0.001],
    }
    sizes = {"pan_radius": 0.05, "object_radius": 0.04}
    planner = Planner(make_bundle(tmp_path / "b", trained_on=trained_on, sizes=sizes))
    plan = planner.plan(make_curve(600), Friction(0.9, 0.4), start=Start(pan_velocity=(0.2, 0.0)))
    beyond = [note.split(" is outside")[0].rsplit(" ", 2)[0] for note in plan.quality.notes if "trained on" in note]
    assert {name.split()[0] for name in beyond} == {"static", "kinetic", "reach", "speed", "samples", "start", "corner"}
    assert plan.sizes == Sizes(0.05, 0.04)
    assert plan.quality.status is Status.OFF_PAN
    assert planner.plan(make_curve(600), sizes=Sizes()).sizes == Sizes()


def test_plan_says_how_its_command_was_read(planner: Planner) -> None:
    t = np.arange(0.0, 0.6, 0.02)
    command = Command.from_waypoints(t, np.stack([10.0 * t, 0.0 * t], axis=1), Reading(scale=0.005))
    assert command.notes
    plan = planner.plan(command)
    assert plan.quality.notes[-len(command.notes) :] == command.notes


def test_a_planner_tells_its_model_and_where_it_is(planner: Planner, bundle_path: Path) -> None:
    assert repr(planner) == f"<Planner with tiny from {bundle_path}>"

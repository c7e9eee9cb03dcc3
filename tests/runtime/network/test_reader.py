"""The network reads: in its own units, within any limits, asked at any time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, InputError, Limits, Planner, Start
from runtime.assess.training_range import beyond_training
from runtime.command import Command
from runtime.limits import NO_LIMITS
from runtime.network.decode import decode, decode_all
from runtime.network.job import Job
from runtime.network.reader import Frame, Reader, chunk_of, group_of, milliseconds, time_of
from runtime.network.units import CHUNK, ENCODER_CHUNK, OBSERVED, READ, WINDOW
from runtime.physics.law import DT, slide_one
from runtime.physics.pan import integrate_pan

FloatArray = NDArray[np.float64]
MakeCurve = Callable[..., FloatArray]

LIMITS = {
    "level": Limits(),
    "lifting": Limits(height=0.1),
    "panda": Limits.named("panda"),
    "fr3": Limits.named("fr3"),
    "weak": Limits(acceleration=4.0, jerk=1_000.0),
    "small": Limits(0.02, acceleration=40.0, jerk=20_000.0, height=0.01),
    "wide": Limits(0.4, acceleration=2.0, jerk=500.0, height=0.2, speed=0.5),
}


def job_of(position: FloatArray, limits: Limits, friction: Friction | None = None) -> Job:
    return Job(Command(position), friction or Friction(0.3, 0.2), limits, Start())


def keeps(limits: Limits, u: FloatArray, before: FloatArray | None = None) -> bool:
    """Whether accelerations (n, 3) from rest at the centre keep acceleration, jerk, reach, height and speed."""
    first = np.zeros((1, 3)) if before is None else before
    states = integrate_pan(np.zeros(6), u)
    step = np.linalg.norm(np.diff(np.concatenate([first, u]), axis=0), axis=1)
    figures = {
        "acceleration": np.linalg.norm(u, axis=1).max(),
        "jerk": step.max() / DT,
        "pan_reach": np.linalg.norm(states[:, :2], axis=1).max(),
        "height": np.abs(states[:, 2]).max(),
        "speed": np.linalg.norm(states[:, 3:], axis=1).max(),
    }
    return all(value <= getattr(limits, name) * (1.0 + 1e-9) + 1e-12 for name, value in figures.items())


@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_plans_keep_whatever_limits_they_are_given(planner: Planner, make_curve: MakeCurve, limits: Limits):
    for seed in range(3):
        size = limits.pan_reach
        plan = planner.plan(size * 4.0 * make_curve(700, seed), Friction(0.3, 0.2), limits=limits)
        assert keeps(limits, np.concatenate([plan.pan_acceleration, plan.stop_acceleration]))
        assert plan.pan_acceleration.shape == (700, 3)
        assert np.linalg.norm(plan.pan_acceleration, axis=1).max() > 0.3 * limits.acceleration
        assert bool(plan.pan_acceleration[:, 2].any()) is not limits.level


def test_commands_of_any_length_and_any_limits_are_planned_in_one_call_as_by_themselves(
    planner: Planner, make_curve: MakeCurve
):
    lengths = [2, 30, 58, 59, 400, 400, 1300]
    limits = [*list(LIMITS.values())[:5], Limits(), Limits(height=0.1)]
    positions = [0.5 * make_curve(length, seed) for seed, length in enumerate(lengths)]
    together = planner.plan_batch(positions, Friction(0.3, 0.2), limits=limits)
    for plan, position, each in zip(together, positions, limits, strict=True):
        alone = planner.plan(position, Friction(0.3, 0.2), limits=each, candidates=1)
        assert len(plan) == len(position)
        assert plan.pan_acceleration[:50] == pytest.approx(alone.pan_acceleration[:50], abs=1e-3)


def test_a_pan_and_its_commands_stretched_are_the_same_to_the_network(make_curve: MakeCurve):
    """Lengths four times, at the same accelerations, are times twice."""
    position = make_curve(800)
    slow = 4.0 * np.stack([np.interp(np.arange(1599) / 2.0, np.arange(800), axis) for axis in position.T], axis=1)
    limits = Limits(0.1, height=0.05, speed=1.0)
    stretched = Limits(0.4, height=0.2, speed=2.0, jerk=5_000.0)
    first, second = Frame.of([job_of(position, limits)]), Frame.of([job_of(slow, stretched)])
    assert second.step == pytest.approx(2.0 * first.step)
    assert second.conditions == pytest.approx(first.conditions, abs=1e-6)
    rows = first.window(0), second.window(0)
    assert rows[0].shape[2] == READ
    assert rows[1] == pytest.approx(rows[0], abs=0.02)  # velocities of the stretched one are a millisecond coarser


def test_a_pan_is_told_no_looser_limits_than_networks_are_made_for(planner: Planner, make_curve: MakeCurve):
    job = job_of(make_curve(400), Limits(0.4, acceleration=40.0))
    for loose in (Limits(50.0, acceleration=1e4), Limits(0.4, acceleration=9e4), Limits(99.0, acceleration=40.0)):
        frame = Frame.of([job_of(make_curve(400), loose)])
        assert frame.step == Frame.of([job]).step == time_of(loose)
        assert frame.acceleration == pytest.approx(Frame.of([job]).acceleration)
    plan = planner.plan(make_curve(400), limits=Limits(50.0, acceleration=1e9, jerk=1e9))
    assert plan.quality.acceleration_max <= 40.0 * 1.01


def test_answers_are_on_the_line_through_the_middles_or_the_means_of_a_millisecond():
    slow = milliseconds(2.0, 4)
    assert slow[:, :3] == pytest.approx(np.array([[1 / 3, 2 / 3, 0], [0, 0.75, 0.25], [0, 0.25, 0.75], [0, 0, 0.75]]))
    quick = milliseconds(0.5, 32)
    assert quick[:, 0] == pytest.approx(0.0)
    assert quick[0, :4] == pytest.approx([0.0, 0.5, 0.5, 0.0])
    for step in (0.3, 0.7, 0.913, 1.0, 1.39, 2.5):
        shares = milliseconds(step, chunk_of(step))
        assert shares.sum(axis=1) == pytest.approx(1.0)
        assert shares.min() >= -1e-12


def test_jobs_are_grouped_by_the_networks_time(planner: Planner, make_curve: MakeCurve):
    position = make_curve(400)
    usual = job_of(position, Limits())
    assert group_of(usual) == group_of(job_of(position, Limits(height=0.1)))
    assert group_of(usual) != group_of(job_of(position, Limits(0.1)))
    assert group_of(usual) != group_of(usual._replace(reach_used=0.5))
    assert time_of(Limits(), 0.25) == pytest.approx(0.5 * time_of(Limits()))
    motions = decode_all(planner.bundle, [usual, usual._replace(reach_used=0.5)])
    assert len({len(motion.acceleration) for motion, _ in motions}) == 2


def test_a_long_command_is_read_window_by_window(planner: Planner, make_curve: MakeCurve):
    job = job_of(make_curve(4000), Limits())
    reader = Reader.at(planner.bundle, [job])
    window = WINDOW * ENCODER_CHUNK * reader.frame.step
    assert reader.frame.window(0).shape == (1, WINDOW, READ)
    assert 0 < reader.next_read < window
    assert reader.frame.window(3990).shape == (1, 1, READ)
    motion, _ = decode(planner.bundle, [job])
    assert motion.acceleration.shape[1] >= 4000


def test_what_the_decoder_sees_of_itself_begins_with_where_the_pan_is(planner: Planner, make_curve: MakeCurve):
    job = job_of(make_curve(400), Limits(height=0.1))
    reader = Reader.at(planner.bundle, [job])
    pan, sliding = np.zeros((1, reader.chunk, 6)), np.zeros((1, reader.chunk, 4))
    asked, after = reader.look(pan, sliding, np.zeros((1, 3)))
    again, _ = after.after(20).look(pan, sliding, np.zeros((1, 3)))
    assert asked.shape == (1, reader.chunk, 3)
    assert (after.now, after.after(20).now, after.after(20).after(5).now) == (0, 20, 25)
    assert not np.array_equal(asked, again)
    assert planner.bundle.sessions["decoder_step"].get_inputs()[0].shape[1] == OBSERVED


def test_a_stream_asked_after_whole_chunks_gives_the_plan(planner: Planner, make_curve: MakeCurve):
    limits, friction, position = Limits(height=0.1), Friction(0.3, 0.2), make_curve(400)
    plan = planner.plan(position, friction, limits=limits, candidates=1)
    stream = planner.stream(position, friction, limits=limits)
    assert stream.chunk == round(CHUNK * time_of(limits))
    pan, sliding = np.zeros(6), np.array([*position[0], 0.0, 0.0])
    states: tuple[FloatArray | None, FloatArray | None] = (None, None)
    given = []
    for _ in range(6):
        u = stream.step(*states)
        states = integrate_pan(pan, u), slide_one(sliding, u, friction)
        pan, sliding = states[0][-1], states[1][-1]
        given.append(u)
    assert np.concatenate(given) == pytest.approx(plan.pan_acceleration[: 6 * stream.chunk], abs=1e-6)


@pytest.mark.parametrize("limits", [LIMITS["level"], LIMITS["panda"], LIMITS["small"]])
def test_a_stream_asked_at_any_time_keeps_the_limits(planner: Planner, make_curve: MakeCurve, limits: Limits):
    friction, position = Friction(0.3, 0.2), limits.pan_reach * 4.0 * make_curve(900, 5)
    stream = planner.stream(position, friction, limits=limits)
    rng, pan, sliding = np.random.default_rng(3), np.zeros(6), np.array([*position[0], 0.0, 0.0])
    given, executed, went_on, rest = [], None, 0, np.zeros((0, 3))
    states: tuple[FloatArray | None, FloatArray | None] = (None, None)
    for _ in range(60):
        u = stream.step(*states, executed=executed)
        assert u.shape == (stream.chunk, 3)
        went_on += len(rest) > 0 and np.array_equal(u[: len(rest)], rest)
        executed = int(rng.integers(1, stream.chunk + 1))
        rest = u[executed:]
        pans, slidings = integrate_pan(pan, u[:executed]), slide_one(sliding, u[:executed], friction)
        pan, sliding = pans[-1], slidings[-1]
        states = pan, sliding + rng.normal(0.0, 1e-3, 4)
        given.append(u[:executed])
    u = np.concatenate([*given, stream.brake(executed)])
    assert keeps(limits, u)
    assert np.linalg.norm(integrate_pan(np.zeros(6), u)[-1, 3:]) < 1e-9
    assert went_on < 30


def test_nothing_but_a_number_of_the_chunks_samples_has_been_executed(planner: Planner, make_curve: MakeCurve):
    stream = planner.stream(make_curve(400))
    stream.step()
    for executed in (0, stream.chunk + 1, 2.5, True):
        with pytest.raises(InputError, match=f"executed must be a whole number from 1 to {stream.chunk}"):
            stream.step(executed=executed)  # type: ignore[arg-type]


def test_candidates_are_told_less_reach_too(planner: Planner, make_curve: MakeCurve):
    position, friction = make_curve(300), Friction(0.3, 0.2)
    one, best = (planner.plan(position, friction, limits=Limits(height=0.1), candidates=count) for count in (1, 9))
    assert best.quality.tracking_rmse <= one.quality.tracking_rmse
    assert keeps(Limits(height=0.1), np.concatenate([best.pan_acceleration, best.stop_acceleration]))


def test_there_is_no_plan_without_limits(planner: Planner, make_curve: MakeCurve):
    with pytest.raises(InputError, match="tiny plans within finite limits, and there are none"):
        planner.plan(make_curve(300), limits=NO_LIMITS)
    with pytest.raises(InputError, match="limits"):
        planner.plan_batch([make_curve(300)], limits=NO_LIMITS)


@pytest.mark.parametrize(
    ("limits", "friction", "line"),
    [
        (Limits(), Friction(1.0, 0.5), None),
        (Limits.named("panda"), Friction(0.5, 0.3), None),
        (Limits(height=0.1, speed=50.0), Friction(), None),
        (Limits(acceleration=50.0), Friction(), "acceleration 50 m/s^2 is outside the range trained on, 2 to 40 m/s^2"),
        (Limits(0.5), Friction(), "pan reach 0.5 m is outside the range trained on, 0.02 to 0.4 m"),
        (Limits(height=0.3), Friction(), "height 0.3 m is outside the range trained on, 0 to 0.2 m"),
        (Limits(speed=0.3), Friction(), "pan speed 0.3 m/s is outside the range trained on, 0.5 to 3 m/s"),
        (Limits(), Friction(0.04, 0.03), "static 0.04 is outside the range trained on, 0.05 to 1.5"),
        (
            Limits(acceleration=10.0),
            Friction(1.0, 0.5),
            "push 0.98 of the acceleration limit is outside the range trained on",
        ),
        (Limits(acceleration=9.0, height=0.1), Friction(1.0, 0.5), None),
    ],
)
def test_what_is_beyond_training_is_told_in_the_units_it_was_trained_in(
    planner: Planner, make_curve: MakeCurve, limits: Limits, friction: Friction, line: str | None
):
    lines = beyond_training(planner.bundle.manifest, job_of(make_curve(1200), limits, friction))
    assert [each for each in lines if line is None or not each.startswith(line)] == []
    assert bool(lines) is (line is not None)


def test_shipped_network_plans_the_same_to_the_last_bit_whatever_is_planned_with_it(make_curve: MakeCurve):
    planner, friction = Planner(), Friction(0.5, 0.3)
    positions = [0.8 * make_curve(400, seed) for seed in range(5)]
    for limits in (Limits.named("panda"), Limits(0.1)):
        together = planner.plan_batch(positions, friction, limits=limits)
        for plan, position in zip(together, positions, strict=True):
            alone = planner.plan(position, friction, limits=limits, candidates=1)
            assert np.array_equal(plan.pan_acceleration, alone.pan_acceleration)


def test_limits_decide_how_long_a_chunk_lasts(make_curve: MakeCurve):
    planner, position = Planner(), make_curve(300)
    chunks = [planner.stream(position, limits=limits).chunk for limits in (None, Limits.named("panda"), Limits(0.05))]
    assert chunks == [58, 89, 29]
